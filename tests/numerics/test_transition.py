"""Transition matrices and Gramians against SciPy's integrators and closed forms."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from occontrol.core.errors import SolveFailed
from occontrol.core.signal import TableSignal, as_signal
from occontrol.numerics.transition import transitions


def integrated(A, noise, a, b):
    n = A.shape[0]

    def rate(t, y):
        F, Q = y[: n * n].reshape(n, n), y[n * n :].reshape(n, n)
        At = A.at(t)
        return np.concatenate([(At @ F).ravel(), (At @ Q + Q @ At.T + noise.at(t)).ravel()])

    y0 = np.concatenate([np.eye(n).ravel(), np.zeros(n * n)])
    y = solve_ivp(rate, (a, b), y0, method="DOP853", rtol=1e-12, atol=1e-14, max_step=(b - a) / 50).y[:, -1]
    return y[: n * n].reshape(n, n), y[n * n :].reshape(n, n)


@pytest.mark.parametrize("entries", [[[0, 1], [-1, -0.4]], [[0, 1], ["-(1+0.5*sin(3*t))", "-0.1*t"]]])
def test_against_adaptive_integration(entries):
    A, noise = as_signal(entries), as_signal([["0.1*exp(-t)" if isinstance(entries[1][0], str) else 0.1, 0], [0, 0.5]])
    starts, ends = np.array([0.0, 0.7, 2.0]), np.array([0.7, 2.0, 2.0])
    F, Q = transitions(A, noise, starts, ends)
    for i, (a, b) in enumerate(zip(starts[:2], ends[:2], strict=True)):
        f, q = integrated(A, noise, a, b)
        np.testing.assert_allclose(F[i], f, rtol=1e-10, atol=1e-11)
        np.testing.assert_allclose(Q[i], q, rtol=1e-10, atol=1e-11)
    np.testing.assert_array_equal(F[2], np.eye(2))
    np.testing.assert_array_equal(Q[2], np.zeros((2, 2)))


def test_stiff_plant_over_a_long_step_keeps_the_slow_mode():
    # van Loan's exponential alone would overflow here: exp(+2000) beside exp(-1)
    A = np.diag([-200.0, -0.1])
    F, Q = transitions(as_signal(A), as_signal(np.eye(2)), np.zeros(1), np.array([10.0]))
    np.testing.assert_allclose(F[0], expm(10 * A), atol=1e-15)
    exact = np.diag([1 / 400, (1 - np.exp(-2.0)) / 0.2])
    np.testing.assert_allclose(Q[0], exact, rtol=1e-12, atol=1e-15)


def test_table_with_kinks_inside_the_span():
    times = np.array([0.0, 0.3, 0.35, 1.0])
    values = np.array([[[0.0]], [[2.0]], [[-1.0]], [[0.5]]])
    A = TableSignal(times, values)
    F, _ = transitions(A, as_signal([[0.0]]), np.zeros(1), np.ones(1))
    integral = np.sum(np.diff(times) * (values[1:, 0, 0] + values[:-1, 0, 0]) / 2)
    np.testing.assert_allclose(F[0, 0, 0], np.exp(integral), rtol=1e-13)


def test_held_table_jumps_where_it_says():
    A = TableSignal(np.array([0.0, 0.4]), np.array([[[1.0]], [[-3.0]]]), "previous")
    F, _ = transitions(A, as_signal([[0.0]]), np.zeros(1), np.ones(1))
    np.testing.assert_allclose(F[0, 0, 0], np.exp(0.4 - 1.8), rtol=1e-13)


def test_too_wild_a_plant_is_refused_with_the_time():
    with pytest.raises(SolveFailed, match="cannot be integrated between"):
        transitions(as_signal([["sin(1e7*t)*1e6"]]), as_signal([[0.0]]), np.zeros(1), np.ones(1))


def test_a_plant_that_overflows_is_refused():
    with pytest.raises(SolveFailed, match="grows beyond all numbers"):
        transitions(as_signal([[1e4]]), as_signal([[1.0]]), np.zeros(1), np.ones(1))


def test_jumps_and_kinks_of_a_formula_are_found_wherever_they_are():
    """sign, abs, max inside a span, against integrals by hand; also where the noise jumps from nothing."""
    A = as_signal([["sign(t - 0.3123456789) + abs(t - 0.7)"]])
    F, _ = transitions(A, as_signal([[0.0]]), np.zeros(1), np.ones(1))
    exponent = (1 - 2 * 0.3123456789) + (0.7**2 + 0.3**2) / 2
    np.testing.assert_allclose(F[0, 0, 0], np.exp(exponent), rtol=1e-12)
    noise = as_signal([["max(0, sign(t - 0.123))*(1 + t)"]])
    _, Q = transitions(as_signal([[0.0]]), noise, np.zeros(1), np.ones(1))
    np.testing.assert_allclose(Q[0, 0, 0], (2**2 - 1.123**2) / 2, rtol=1e-11)

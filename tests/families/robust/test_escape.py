"""Finite escape: closed forms for one state, theorem against theorem for more."""

import numpy as np
import pytest

from occontrol.core.signal import as_signal
from occontrol.families.robust.escape import escape_time, first_lost, free_weights, gain_that_fits, horizon, smallest
from occontrol.families.robust.scattering import Flow


def scalar(a, b, k, c, varying):
    def signal(x):
        return as_signal([[f"{x!r}+0*t"]]) if varying else as_signal([[x]])

    return Flow(signal(a), signal(b), signal(k), [signal(c)])


def closed_form(a, b, k, c, P0):
    square = k * k - c * c
    w = np.sqrt(square * b * b - a * a)
    return (np.pi / 2 - np.arctan((square * P0 + a) / w)) / w


def oscillating_cases(count):
    rng = np.random.default_rng(1)
    while count:
        a, b, k, P0 = rng.normal() * 0.5, rng.uniform(0.3, 2), rng.uniform(0.8, 3), rng.uniform(0.1, 3)
        c = rng.uniform(0, 0.95 * k)
        if (k * k - c * c) * b * b > 1.05 * a * a:
            count -= 1
            yield float(a), float(b), float(k), float(c), float(P0)


@pytest.mark.parametrize("varying", [False, True])
def test_escape_of_one_state_matches_the_closed_form(varying):
    for a, b, k, c, P0 in oscillating_cases(3 if varying else 12):
        flow, weight = scalar(a, b, k, c, varying), np.array([[1 / P0]])
        free, used = closed_form(a, b, k, 0.0, P0), closed_form(a, b, k, c, P0)
        assert horizon(flow, weight, limit=2 * free) == pytest.approx(free, abs=1e-8)
        edges = np.linspace(0, 1.3 * used, 4)
        assert escape_time(flow, weight, edges, [0, 0, 0]) == pytest.approx(used, abs=1e-8)
        assert escape_time(flow, weight, np.linspace(0, 0.999 * used, 4), [0, 0, 0]) is None


def test_a_saddle_below_its_threshold_never_escapes():
    """a < 0, k b < -a: P stays bounded exactly when P(0) is below the larger root of the algebraic equation."""
    a, b, k = -1.0, 0.5, 1.0
    largest = (-a + np.sqrt(a * a - k * k * b * b)) / k**2
    flow = scalar(a, b, k, 0.0, False)
    assert horizon(flow, np.array([[1 / (0.999 * largest)]])) is None
    assert horizon(flow, np.array([[1 / (1.001 * largest)]])) is not None


def test_without_uncertainty_in_the_model_nothing_escapes():
    flow = Flow(as_signal([[0.5, 1], [0, 2.0]]), as_signal([[0], [1]]), as_signal([[0.0, 0.0]]))
    assert horizon(flow, np.eye(2)) is None


def test_an_unstable_state_that_K_does_not_see_is_harmless():
    blind = Flow(as_signal([[-1, 0], [0, 3.0]]), as_signal([[0.5], [1]]), as_signal([[1.0, 0.0]]))
    assert horizon(blind, np.eye(2)) is None
    alone = Flow(as_signal([[-1.0]]), as_signal([[0.5]]), as_signal([[1.0]]))
    assert horizon(alone, np.eye(1)) is None


@pytest.mark.parametrize("varying", [False, True])
def test_the_horizon_is_where_the_free_weight_reaches_the_weight(varying):
    """Route two: X(0) < X0 fails just beyond it, holds just before it."""
    extra = "+0*t" if varying else ""
    flow = Flow(as_signal([[f"0{extra}", 1], [-1, -0.4]]), as_signal([[0], [1]]), as_signal([[0.5, 0.2]]))
    weight = np.diag([2.0, 1.0])
    reach = horizon(flow, weight, limit=40.0)
    assert reach is not None
    for factor, holds in ((1 - 1e-8, True), (1 + 1e-8, False)):
        X = free_weights(flow, np.array([0.0, reach * factor]))
        assert X is not None
        assert (smallest(weight - X[0]) > 0) is holds


def test_where_the_free_weight_is_lost():
    """Scalar with T large: X escapes a fixed time before the end; -dX/dt = 2aX + k^2 + b^2 X^2."""
    a, b, k, T = 0.2, 1.0, 1.5, 6.0
    flow = scalar(a, b, k, 0.0, False)
    w = np.sqrt(k * k * b * b - a * a)
    life = (np.pi / 2 - np.arctan(a / w)) / w
    assert first_lost(flow, np.linspace(0, T, 7)) == pytest.approx(T - life, abs=1e-8)
    assert first_lost(flow, np.linspace(0, 0.9 * life, 3)) is None


def test_the_gain_that_fits_puts_the_horizon_at_the_end():
    flow = Flow(as_signal([[0, 1], [-1, -0.4]]), as_signal([[0], [1]]), as_signal([[0.5, 0.2]]))
    weight, edges = np.diag([2.0, 1.0]), np.linspace(0, 12.0, 5)
    factor = gain_that_fits(flow, weight, edges)
    assert 0 < factor < 1
    assert horizon(flow.scaled(factor), weight) == pytest.approx(12.0, rel=1e-6)


def test_a_stable_plant_without_noise_keeps_a_bounded_free_weight():
    """B = 0: X(0) tends to the observability Gramian, so everything hangs on whether that is below the weight."""
    A, K = np.array([[-100.0, 1], [0, -0.5]]), np.array([[0.7, 0.3]])
    flow = Flow(as_signal(A), as_signal([[0], [0]]), as_signal(K))
    from scipy.linalg import solve_continuous_lyapunov

    gramian = solve_continuous_lyapunov(A.T, -K.T @ K)
    assert horizon(flow, gramian * 1.001 + 1e-6 * np.eye(2)) is None
    assert horizon(flow, gramian * 0.9 + 1e-6 * np.eye(2)) is not None

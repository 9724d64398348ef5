"""exp(a) and its noise integral against 60-digit arithmetic, stiff, growing, coupled in chains, many at once."""

from decimal import localcontext
from math import factorial

import numpy as np
import pytest

from occontrol.numerics.short_flow import short_flow
from tests.decimal_recursion import exact, exponential


def truth(a, x):
    n = len(a)
    with localcontext() as context:
        context.prec = 120
        A, X = exact(a), exact(x)
        E = exponential(np.block([[-A, X], [exact(np.zeros((n, n))), A.T]]))
        F = E[n:, n:].T
        return F.astype(float), (F @ E[:n, n:]).astype(float)


@pytest.mark.parametrize("size", [1e-12, 1e-3, 0.1, 0.25, 0.7, 3.0, 20.0])
@pytest.mark.parametrize("n", [1, 3])
def test_flow_and_noise_are_exact_to_rounding(n, size):
    rng = np.random.default_rng(int(1000 * size) + n)
    a = size * rng.normal(size=(4, n, n)) / n
    G = rng.normal(size=(4, n, n))
    x = G @ np.swapaxes(G, 1, 2)
    F, Q = short_flow(a, x)
    for k in range(4):
        f, q = truth(a[k], x[k])
        assert np.max(np.abs(F[k] - f)) <= 1e-14 * (1 + size) * np.max(np.abs(f))
        assert np.max(np.abs(Q[k] - q)) <= 1e-14 * (1 + size) * np.max(np.abs(q))


def test_a_stiff_decay_keeps_its_digits():
    F, Q = short_flow(np.array([[[-800.0]]]), np.array([[[2.0]]]))
    assert F[0, 0, 0] == pytest.approx(np.exp(-800.0), rel=1e-12, abs=1e-300)
    assert Q[0, 0, 0] == pytest.approx(2.0 / 1600.0, rel=1e-12)


def test_the_corner_of_a_chain_of_integrators_is_exact_however_short_the_step():
    # entry (0, 0) of Q is h^(2n-1) / ((2n-1) ((n-1)!)^2)
    for n, h in ((2, 1e-6), (4, 1e-5), (6, 1e-3)):
        x = np.zeros((1, n, n))
        x[0, -1, -1] = h
        _, Q = short_flow(h * np.diag(np.ones(n - 1), 1)[None], x)
        exact_corner = h ** (2 * n - 1) / ((2 * n - 1) * factorial(n - 1) ** 2)
        assert Q[0, 0, 0] == pytest.approx(exact_corner, rel=1e-13)


def test_a_result_depends_on_its_own_matrices_alone():
    rng = np.random.default_rng(0)
    a = rng.normal(size=(6, 3, 3)) * 10.0 ** rng.uniform(-6, 1, size=(6, 1, 1))
    G = rng.normal(size=(6, 3, 3))
    x = G @ np.swapaxes(G, 1, 2)
    F, Q = short_flow(a, x)
    for k in range(6):
        f, q = short_flow(a[k : k + 1], x[k : k + 1])
        assert np.array_equal(F[k], f[0]) and np.array_equal(Q[k], q[0])


def test_what_overflows_is_not_finite_and_does_not_spoil_the_rest():
    with np.errstate(over="ignore", invalid="ignore"):
        F, Q = short_flow(np.array([[[2000.0]], [[0.5]]]), np.ones((2, 1, 1)))
        lost, _ = short_flow(np.full((1, 1, 1), np.nan), np.ones((1, 1, 1)))
    assert not np.isfinite(F[0, 0, 0]) and not np.isfinite(Q[0, 0, 0]) and not np.isfinite(lost[0, 0, 0])
    assert F[1, 0, 0] == pytest.approx(np.exp(0.5), rel=1e-15)
    assert Q[1, 0, 0] == pytest.approx(np.e - 1.0, rel=1e-14)

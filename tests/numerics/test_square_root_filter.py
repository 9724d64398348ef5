"""The compiled square-root filter against plain NumPy, against rational arithmetic, and over a million steps."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit

from occontrol.numerics.square_root_filter import (
    advance,
    condition,
    gain_of,
    predict,
    triangularise,
    update,
    whitened,
)
from tests.numerics.exact_kalman import exact, floats, plus, solve, step, times, transpose

SIZES = [(1, 1, 1), (1, 3, 2), (2, 5, 1), (3, 2, 3), (6, 2, 0), (5, 7, 5), (10, 3, 4), (23, 9, 30)]


def draw(n, m, p, seed=0):
    g = np.random.default_rng([n, m, p, seed])
    return g, g.standard_normal((n, n)), g.standard_normal((n, n)), g.standard_normal((n, p)), g.standard_normal((m, n))


@pytest.mark.parametrize(("n", "m", "p"), SIZES)
def test_predict_is_the_triangle_of_a_qr_decomposition(n, m, p):
    _, S, F, G, _ = draw(n, m, p)
    found = predict(S, F, G)
    plain = np.linalg.qr(np.hstack([F @ S, G]).T, mode="r").T
    assert np.array_equal(found, np.tril(found))
    assert np.allclose(np.abs(found), np.abs(plain), rtol=1e-11, atol=1e-12)
    assert np.allclose(found @ found.T, F @ S @ S.T @ F.T + G @ G.T, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(("n", "m", "p"), SIZES)
def test_update_is_the_joseph_form_with_its_gain_and_its_innovation(n, m, p):
    g, S, _, _, C = draw(n, m, p)
    after, normalised, innovation = update(S, C)
    P, e = S @ S.T, g.standard_normal(m)
    Y = C @ P @ C.T + np.eye(m)
    K = np.linalg.solve(Y, C @ P).T
    A = np.eye(n) - K @ C
    scale = np.max(np.abs(P))
    assert np.allclose(after @ after.T, A @ P @ A.T + K @ K.T, rtol=1e-11, atol=1e-13 * scale)
    assert np.array_equal(innovation, np.tril(innovation)) and np.allclose(innovation @ innovation.T, Y, rtol=1e-12)
    assert np.allclose(gain_of(normalised, innovation), K, rtol=1e-10, atol=1e-12)
    white = whitened(innovation, e)
    assert np.allclose(normalised @ white, K @ e, rtol=1e-10, atol=1e-12)
    assert white @ white == pytest.approx(e @ np.linalg.solve(Y, e), rel=1e-10)


@pytest.mark.parametrize(("n", "m", "p"), SIZES)
def test_advance_with_correlated_noises(n, m, p):
    g, S, F, _, H = draw(n, m, p, 1)
    N = g.standard_normal((m + n, m + n))
    R, cross, Q = N[:m] @ N[:m].T, N[m:] @ N[:m].T, N[m:] @ N[m:].T
    after, normalised, innovation = advance(S, F, H, N)
    P = S @ S.T
    Y = H @ P @ H.T + R
    K = np.linalg.solve(Y, (F @ P @ H.T + cross).T).T
    closed = F - K @ H
    expected = closed @ P @ closed.T + Q - K @ cross.T - cross @ K.T + K @ R @ K.T
    assert np.allclose(innovation @ innovation.T, Y, rtol=1e-11, atol=1e-11)
    assert np.allclose(gain_of(normalised, innovation), K, rtol=1e-9, atol=1e-10)
    assert np.allclose(after @ after.T, expected, rtol=1e-9, atol=1e-11 * np.max(np.abs(P)))


def test_nothing_read_is_a_prediction():
    _, S, F, G, _ = draw(4, 1, 4)
    after, normalised, innovation = advance(S, F, np.zeros((0, 4)), G)
    assert normalised.shape == (4, 0) and innovation.shape == (0, 0)
    assert np.allclose(after, predict(S, F, G), atol=1e-14)


def test_rows_below_the_count_keep_what_the_array_says():
    g = np.random.default_rng(2)
    array = g.standard_normal((7, 9))
    before = array @ array.T
    triangularise(array, 3)
    assert np.allclose(array @ array.T, before, atol=1e-13)
    assert np.all(np.triu(array[:3], 1) == 0) and np.any(np.triu(array[3:], 1) != 0)


def test_zero_matrices_are_no_trouble():
    zero = np.zeros((3, 3))
    assert np.array_equal(predict(zero, np.eye(3), zero), zero)
    after, normalised, innovation = update(zero, np.ones((2, 3)))
    assert np.array_equal(after, zero) and np.array_equal(normalised, np.zeros((3, 2)))
    assert np.allclose(np.abs(innovation), np.eye(2))


GRADED_PRIOR, TINY_NOISE = np.diag([1e6, 1e-6, 1e6, 1e-6]), 1e-12


def joseph(P, F, Q, H, R):
    """The textbook's careful form, in floating point."""
    K = np.linalg.solve(H @ P @ H.T + R, H @ P @ F.T).T
    closed = F - K @ H
    after = closed @ P @ closed.T + Q + K @ R @ K.T
    return (after + after.T) / 2


def test_a_graded_prior_and_a_tiny_noise_against_rational_arithmetic():
    """Where Joseph's form is indefinite the root is right, in units of the standard deviations."""
    h = 0.1
    block = np.array([[1.0, h], [0.0, 1.0]])
    F = np.kron(np.eye(2), block)
    G = 1e-6 * np.kron(np.eye(2), np.array([[h], [1.0]]))
    H = np.array([[1.0, 0.0, 1.0, 0.0]])
    S, P, plain = np.sqrt(GRADED_PRIOR), exact(GRADED_PRIOR), GRADED_PRIOR
    Q, R = times(exact(G), transpose(exact(G))), exact([[TINY_NOISE]])
    worst, indefinite, lost = 0.0, 0.0, 0.0
    for _ in range(25):
        S, X, D = advance(S, F, H, np.block([[np.array([[1e-6]]), np.zeros((1, 2))], [np.zeros((4, 1)), G]]))
        gain, Y, P = step(P, exact(F), Q, exact(H), R, exact(np.zeros((4, 1))))
        true = floats(P)
        sd = np.sqrt(np.diag(true))
        worst = max(worst, np.max(np.abs(S @ S.T - true) / np.outer(sd, sd)))
        assert np.max(np.abs(X - floats(gain) * D[0, 0])[:, 0] / sd) < 1e-6
        assert D[0, 0] ** 2 == pytest.approx(float(Y[0][0]), rel=1e-5)  # 1e-6 out of 1e3: a digit in 1e9 of D
        lost = max(lost, abs(float((H @ plain @ H.T)[0, 0]) + TINY_NOISE - float(Y[0][0])) / float(Y[0][0]))
        plain = joseph(plain, F, floats(Q), H, np.array([[TINY_NOISE]]))
        values = np.linalg.eigvalsh(plain)
        indefinite = min(indefinite, values[0] / values[-1])
        roots = np.linalg.eigvalsh(S @ S.T)
        assert roots[0] >= -1e-14 * roots[-1]
    assert worst < 1e-8
    assert indefinite < -1e-14 and lost > 1.0, "the case is harmless, the test says nothing"


def test_a_huge_prior_keeps_the_small_directions():
    """P0 = 1e16 I, one value at a time: every entry and the direction just measured, against exact numbers."""
    g = np.random.default_rng(5)
    n = 4
    F, G = g.standard_normal((n, n)) / 2 + np.eye(n), 0.1 * g.standard_normal((n, 2))
    S, P = 1e8 * np.eye(n), exact(1e16 * np.eye(n))
    one = [[exact([[1.0]])[0][0]]]
    for _ in range(6):
        C = g.standard_normal((1, n))
        Y = plus(times(times(exact(C), P), transpose(exact(C))), one)
        seen = times(exact(C), P)
        P = plus(P, times(transpose(seen), solve(Y, seen)), -1)
        S = update(S, C)[0]
        true = floats(P)
        assert np.max(np.abs(S @ S.T - true)) < 1e-11 * np.max(np.abs(true))
        along = float(times(times(exact(C), P), transpose(exact(C)))[0][0])
        assert np.sum((C @ S) ** 2) == pytest.approx(along, rel=1e-6)
        P = plus(times(times(exact(F), P), transpose(exact(F))), times(exact(G), transpose(exact(G))))
        S = predict(S, F, G)


def test_condition_of_triangles():
    g = np.random.default_rng(3)
    ratios = []
    for n in (1, 2, 5, 12):
        for _ in range(20):
            S = np.tril(g.standard_normal((n, n))) * 10.0 ** g.uniform(-3, 3, n)
            ratios.append(condition(S) / np.linalg.cond(S))
    assert 0.05 < min(ratios) and max(ratios) < 5
    assert condition(np.diag([1.0, 0.0])) == np.inf


@njit
def _walk(S, F, rows, N, steps, luck):
    """Least ratio of eigenvalues and least normalised innovation squared of a walk that loses one sample in five."""
    n, m = S.shape[0], rows.shape[0]
    ratio, least, none = 1.0, np.inf, np.zeros((0, n))
    for k in range(steps):
        here = luck[k % len(luck)]
        if here[0] > 0.84:  # of a normal number: one in five
            S, _, D = advance(S, F, none, N[m:])
        else:
            S, _, D = advance(S, F, rows, N)
            white = whitened(D, here[1 : m + 1] * D[0, 0])
            least = min(least, np.sum(white * white))
        if k % 50 == 0:
            values = np.linalg.eigvalsh(np.dot(S, S.T))
            ratio = min(ratio, values[0] / values[-1])
    return ratio, least, S


@pytest.mark.slow
def test_a_million_steps_stay_definite():
    """Three plants: slowly growing, oscillating without damping, decaying; a prior of 1e6 beside 1e-6, noise 1e-12."""
    turn = np.array([[np.cos(0.3), np.sin(0.3)], [-np.sin(0.3), np.cos(0.3)]])
    plants = [np.kron(np.eye(2), np.array([[1.0, 0.01], [0.0, 1.0]])), np.kron(np.eye(2), turn), 0.3 * np.eye(4)]
    plants[2][0, 3] = 0.2
    rows = np.array([[1.0, 0.0, 1.0, 0.0], [0.0, 0.0, 1e-3, 1.0]])
    for i, F in enumerate(plants):
        N = np.zeros((6, 4))
        N[0, 0], N[1, 1] = 1e-6, 1.0
        N[3, 2], N[5, 3] = 1e-7, 1e-3
        N[5, 0] = 1e-8  # plant noise that the reading shares
        luck = np.random.default_rng(i).standard_normal((1009, 3))
        ratio, least, S = _walk(np.sqrt(GRADED_PRIOR), F, rows, N, 340_000, luck)
        assert ratio >= -1e-14 and least >= 0 and np.all(np.isfinite(S))

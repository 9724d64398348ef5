"""The corrected Y equation and the structure behind it, against routes that do not use it."""

import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from occontrol.core.signal import as_signal
from occontrol.families.robust.check import integrate
from occontrol.families.robust.ellipsoid_size import Size
from occontrol.families.robust.escape import free_weights
from occontrol.families.robust.game import center_weight, from_ordinary, ordinary_start, shape_rate
from occontrol.families.robust.scattering import Flow
from occontrol.families.robust.slots import slot_table

A, B, K = np.array([[0, 1.0], [-1, -0.4]]), np.array([[0.0], [1]]), np.array([[0.5, 0.2]])
C = [np.array([[1.0, 0]]), np.array([[0, 1.0]])]
WEIGHT, CENTER, LEVEL = np.diag([2.0, 1.0]), np.array([1.0, -0.5]), 1.0
EDGES = np.linspace(0, 2.0, 6)
FLOW = Flow(as_signal(A), as_signal(B), as_signal(K), [as_signal(c) for c in C])


def slots():
    found = slot_table(FLOW, EDGES, WEIGHT, CENTER, LEVEL, Size.of("trace"))
    assert found is not None
    return found


def test_check_values_of_the_oscillator():
    table = slots()
    assert table.free[0] == pytest.approx(np.array([[0.144736478, 0.114619079], [0.114619079, 0.29664942]]), abs=1e-8)
    Y = center_weight(table.free[0], np.linalg.inv(WEIGHT))
    assert Y == pytest.approx(np.array([[0.177955254, 0.177461449], [0.177461449, 0.436225778]]), abs=1e-8)
    assert table.level == pytest.approx(1.1095502497, abs=1e-8)
    ranked = sorted((table.cost(s), s) for s in itertools.product(range(2), repeat=5))
    assert ranked[0] == (pytest.approx(1.6498563079, abs=1e-8), (1, 1, 0, 0, 1))
    assert ranked[-1] == (pytest.approx(2.1006110874, abs=1e-8), (0, 0, 1, 1, 1))


def test_the_center_weight_is_the_same_for_all_schedules():
    """Each schedule's own P and the corrected (25), integrated directly; no X anywhere."""
    found = [
        integrate(FLOW, EDGES, s, WEIGHT, CENTER, LEVEL, Size.of("trace"))
        for s in itertools.product(range(2), repeat=5)
    ]
    weights = np.array([f.center_weight for f in found if f is not None])
    assert len(weights) == 32
    assert np.max(np.abs(weights - weights[0])) < 1e-10
    assert weights[0] == pytest.approx(center_weight(slots().free[0], np.linalg.inv(WEIGHT)), abs=1e-9)


def largest_spent_energy(sequence, pieces):
    """sup of rho over y that are constant on `pieces` pieces: rho is quadratic in (y, 1), its maximum is a solve.

    Uses only (4), (5) and (7): responses of the center to every piece, and Simpson's rule.
    """
    per_slot = pieces // len(sequence)
    fine = 8  # steps of a piece
    span = np.diff(EDGES)[0] / per_slot
    h = span / fine
    P, responses = np.linalg.inv(WEIGHT), np.zeros((pieces + 1, 2))
    responses[-1] = CENTER
    gram = np.zeros((pieces + 1, pieces + 1))
    for k in range(pieces):
        c = C[sequence[k // per_slot]]
        path = solve_ivp(
            lambda t, z, c=c: shape_rate(z.reshape(2, 2), A, B, K, c).ravel(),
            (0, span), P.ravel(), "DOP853", t_eval=np.linspace(0, span, 2 * fine + 1), rtol=1e-12, atol=1e-13,
        ).y.T.reshape(-1, 2, 2)  # fmt: skip
        P = path[-1]
        y = np.zeros((pieces + 1, 1))
        y[k] = 1.0

        def rate(p, x, c=c, y=y):
            return x @ A.T + (x @ K.T @ K - (x @ c.T - y) @ c) @ p

        for s in range(fine):
            p0, p1, p2 = path[2 * s], path[2 * s + 1], path[2 * s + 2]
            k1 = rate(p0, responses)
            k2 = rate(p1, responses + h / 2 * k1)
            k3 = rate(p1, responses + h / 2 * k2)
            k4 = rate(p2, responses + h * k3)
            after = responses + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            middle = (responses + after) / 2 + h / 8 * (k1 - rate(p2, after))
            for weight, x in ((1, responses), (4, middle), (1, after)):
                z, e = x @ K.T, x @ c.T - y
                gram += h / 6 * weight * (z @ z.T - e @ e.T)
            responses = after
    H, g, rest = gram[:-1, :-1], gram[:-1, -1], gram[-1, -1]
    assert np.linalg.eigvalsh(H)[-1] < 0
    return rest - g @ np.linalg.solve(H, g)


def test_the_level_is_the_supremum_over_measurements():
    """Piecewise-constant y reach the level from below, second order in the length of the pieces."""
    sequence = (1, 1, 0, 0, 1)
    coarse, fine = (LEVEL + largest_spent_energy(sequence, m) for m in (40, 80))
    level = slots().level
    assert coarse < fine < level
    assert (4 * fine - coarse) / 3 == pytest.approx(level, abs=1e-7)

    def printed(t, z, path):
        Y, P = z[:4].reshape(2, 2), path(t).reshape(2, 2)
        KK = K.T @ K
        M = A + P @ KK
        return -(M.T @ Y + Y @ M + KK + Y @ P @ KK @ KK @ P @ Y).ravel()

    P, paths = np.linalg.inv(WEIGHT).ravel(), []
    for i, a in zip(sequence, EDGES[:-1], strict=True):
        done = solve_ivp(
            lambda t, z, i=i: shape_rate(z.reshape(2, 2), A, B, K, C[i]).ravel(),
            (a, a + 0.4),
            P,
            dense_output=True,
            rtol=1e-10,
        )
        P = done.y[:, -1]
        paths.append(done.sol)
    Y = np.zeros(4)
    for path, a in zip(reversed(paths), reversed(EDGES[:-1]), strict=True):
        Y = solve_ivp(printed, (a + 0.4, a), Y, args=(path,), rtol=1e-10, atol=1e-12).y[:, -1]
    assert abs(LEVEL + CENTER @ Y.reshape(2, 2) @ CENTER - level) > 1e-3


def test_the_ordinary_coordinates_carry_the_same_shapes():
    """N obeys a Kalman Riccati equation with A + BB'X; P from it is the game's own."""
    table, sequence = slots(), [0, 1, 1, 0, 1]
    N = ordinary_start(WEIGHT, free_weights(FLOW, EDGES)[0]).ravel()
    judged = integrate(FLOW, EDGES, sequence, WEIGHT, CENTER, LEVEL, Size.of("trace"))
    for k, i in enumerate(sequence):

        def rate(t, z, k=k, i=i):
            M = z.reshape(2, 2)
            F = A + B @ B.T @ free_weights(FLOW, np.array([t, 2.0]))[0] if t < 2.0 else A
            return (F @ M + M @ F.T - M @ C[i].T @ C[i] @ M + B @ B.T).ravel()

        N = solve_ivp(rate, (EDGES[k], EDGES[k + 1]), N, rtol=1e-9, atol=1e-11).y[:, -1]
        assert N.reshape(2, 2) == pytest.approx(table.ordinary(sequence)[k + 1], abs=1e-7)
    assert from_ordinary(N.reshape(2, 2), np.zeros((2, 2))) == pytest.approx(judged.shape, abs=1e-7)

"""The compiled sweeps against the slow obvious recursion, finite differences, and the exact flow."""

import numpy as np
import pytest
from scipy.linalg import expm, solve_continuous_are

from occontrol.core.plant import LinearPlant
from occontrol.core.sensor import Sensor
from occontrol.families.athans.discretise import discretise, feasible_set, half_predicts
from occontrol.families.athans.node_path import node_path
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.scheduling.exchange import best_exchanges
from occontrol.scheduling.sweep import Sweep
from tests.families.athans.random_problems import random_policy, random_problem

FEATURES = [
    {},
    {"states": 1, "sensors": 1, "intervals": 1},
    {"rows": 2, "select": 2},
    {"running": True},
    {"idle": True, "windows": True, "select": 2},
    {"varying": True, "running": True, "rows": 2},
    {"stiff": True},
    {"stiff": True, "rows": 2, "varying": True},
    {"states": 12, "sensors": 5, "rows": 2},
    {"states": 12, "sensors": 5, "running": True, "stiff": True},
    {"states": 5, "sensors": 40, "stiff": True},
]


def information_form(problem, weights):
    """J by plain inverses in extended precision: the obvious recursion."""
    r = discretise(problem)
    per_row = np.repeat(np.arange(r.sensors), np.diff(r.offsets))
    S = r.initial.astype(np.longdouble)
    total = np.longdouble(np.vdot(r.cost, weights))

    def solve(A, B):
        # Gauss-Jordan with pivots: numpy has no long double solver
        A, B = A.copy(), B.copy()
        for i in range(len(A)):
            p = i + int(np.argmax(np.abs(A[i:, i])))
            A[[i, p]], B[[i, p]] = A[[p, i]], B[[p, i]]
            B[i] /= A[i, i]
            A[i] /= A[i, i]
            for k in range(len(A)):
                if k != i:
                    B[k] -= A[k, i] * B[i]
                    A[k] -= A[k, i] * A[i]
        return B

    for k in range(r.intervals):
        F, Q = r.transition[r.predict[k]].astype(np.longdouble), r.noise[r.predict[k]].astype(np.longdouble)
        S = F @ S @ F.T + Q
        if len(r.running):
            total += r.steps[k] / 2 * np.sum(r.running[r.running_set[k]] * S)
        C = (r.rows[r.row_set[k]] * np.sqrt(r.steps[k] * weights[k, per_row])[:, None]).astype(np.longdouble)
        S = S - S @ C.T @ solve(np.eye(len(C), dtype=np.longdouble) + C @ S @ C.T, C @ S)
        if len(r.running):
            total += r.steps[k] / 2 * np.sum(r.running[r.running_set[k]] * S)
    F, Q = r.transition[r.predict[-1]], r.noise[r.predict[-1]]
    return float(total + np.sum(r.terminal * (F @ S @ F.T + Q)))


@pytest.mark.parametrize("features", FEATURES, ids=str)
@pytest.mark.parametrize("small", [0, 1000], ids=["blas", "loops"])
def test_cost_gradient_and_memory_saving_agree(features, small):
    problem = random_problem(7, **features)
    r = discretise(problem)
    rng = np.random.default_rng(0)
    v = random_policy(problem, rng)
    sweep = Sweep(r, small=small)
    J, g = sweep.cost_and_gradient(v)
    # extended precision gives the reference; stiff cases lose at most eps times the condition of the first update
    tolerance = 1e-10 if not features.get("stiff") else 1e-8
    assert J == pytest.approx(information_form(problem, v), rel=tolerance)
    assert sweep.cost(v) == J
    # checkpoints: the same numbers from a tenth of the memory
    J2, g2 = Sweep(r, memory_budget=8 * r.states**2 * 3, small=small).cost_and_gradient(v)
    assert J2 == pytest.approx(J, rel=1e-14)
    np.testing.assert_allclose(g, g2, rtol=1e-13)
    # the plain path's switching functions are the gradient per unit time, wherever the sensor is available
    switching = node_path(r, half_predicts(problem), v).switching * r.steps[:, None]
    open_ = problem.upper > 0
    np.testing.assert_allclose(g[open_], switching[open_], rtol=1e-6, atol=1e-8 * np.max(np.abs(g)))


@pytest.mark.parametrize("features", [f for f in FEATURES if not f.get("stiff")], ids=str)
def test_gradient_against_finite_differences(features):
    problem = random_problem(3, **features)
    sweep = Sweep(discretise(problem))
    rng = np.random.default_rng(1)
    v, w = random_policy(problem, rng), random_policy(problem, rng)
    _, g = sweep.cost_and_gradient(0.5 * (v + w))
    e = 1e-5
    difference = (sweep.cost((0.5 + e) * v + (0.5 - e) * w) - sweep.cost((0.5 - e) * v + (0.5 + e) * w)) / (2 * e)
    assert np.vdot(g, v - w) == pytest.approx(difference, rel=2e-6, abs=1e-9)


def test_covariance_stays_semidefinite_from_a_huge_start_with_a_sharp_sensor():
    plant = LinearPlant([[0, 1], [0, 0]], [[0, 0], [0, 0.1]], 1e6 * np.eye(2))
    problem = SchedulingProblem("stiff", plant, [Sensor("s", [[1, 0]], [[1e-3]])], np.linspace(0, 10, 6), [[1, 0]])
    path = node_path(discretise(problem), half_predicts(problem), np.ones((5, 1)))
    for S in [*path.covariance, *path.updated]:
        assert np.array_equal(S, S.T)
        assert np.linalg.eigvalsh(S)[0] >= -1e-12 * np.linalg.eigvalsh(S)[-1]
    # a singular start stays singular only as long as no noise enters
    still = SchedulingProblem(
        "singular", LinearPlant([[0, 1], [0, 0]], np.zeros((2, 2)), np.diag([1.0, 0.0])),
        [Sensor("s", [[1, 0]], [[0.1]])], np.linspace(0, 1, 4), [[1, 0]],
    )  # fmt: skip
    path = node_path(discretise(still), half_predicts(still), np.ones((3, 1)))
    assert path.covariance[-1][0, 0] == pytest.approx(1 / (1 + 10), rel=1e-12)
    assert path.covariance[-1][1, 1] == 0


def exact_flow(plant, information, span):
    """Riccati flow by the exponential of the Hamiltonian matrix, in small pieces."""
    n, S = plant.states, plant.covariance
    A, Xi = plant.A.at(0), plant.noise.at(0)
    E = expm(np.block([[A, Xi], [information, -A.T]]) * (span / 64))
    for _ in range(64):
        X, Y = E[:n, :n] @ S + E[:n, n:], E[n:, :n] @ S + E[n:, n:]
        S = np.linalg.solve(Y.T, X.T).T
    return S


def test_second_order_in_the_step_against_the_exact_flow():
    plant = LinearPlant([[0, 1], [-1, -0.4]], [[0, 0], [0, 0.5]], np.diag([2.0, 1.0]))
    sensor = Sensor("s", [[1.0, 0.3]], [[0.5]])
    exact = exact_flow(plant, sensor.C.at(0).T @ sensor.C.at(0) / 0.5, 3.0)
    errors = []
    for N in (20, 40, 80, 160):
        problem = SchedulingProblem("p", plant, [sensor], np.linspace(0, 3, N + 1), np.eye(2))
        path = node_path(discretise(problem), half_predicts(problem), np.ones((N, 1)))
        errors.append(np.max(np.abs(path.covariance[-1] - exact)))
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    np.testing.assert_allclose(orders, 2.0, atol=0.05)


def test_long_horizon_reaches_the_algebraic_riccati_equation():
    A, Xi, C, theta = np.array([[0, 1], [0.3, -0.4]]), np.diag([0.1, 0.5]), np.array([[1.0, 0.3]]), 0.5
    care = solve_continuous_are(A.T, C.T, Xi, [[theta]])
    errors = []
    for N in (1000, 2000):
        plant = LinearPlant(A, Xi, np.eye(2))
        problem = SchedulingProblem("p", plant, [Sensor("s", C, [[theta]])], np.linspace(0, 40, N + 1), np.eye(2))
        path = node_path(discretise(problem), half_predicts(problem), np.ones((N, 1)))
        errors.append(np.max(np.abs(path.covariance[-1] - care)))
    assert errors[0] < 1e-3
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.05)


@pytest.mark.parametrize("seed", range(60))
def test_convex_on_random_pairs(seed):
    problem = random_problem(
        seed, states=1 + seed % 4, running=seed % 3 == 0, varying=seed % 5 == 0, rows=1 + seed % 2, stiff=seed % 7 == 0
    )
    rng = np.random.default_rng(seed)
    sweep = Sweep(discretise(problem))
    v, w = random_policy(problem, rng), random_policy(problem, rng)
    Jv, Jw = sweep.cost(v), sweep.cost(w)
    lam = rng.uniform()
    assert sweep.cost(lam * v + (1 - lam) * w) <= lam * Jv + (1 - lam) * Jw + 1e-10 * max(abs(Jv), abs(Jw))
    # and the tangent lies below
    J, g = sweep.cost_and_gradient(v)
    assert Jw >= J + np.vdot(g, w - v) - 1e-9 * max(abs(Jv), abs(Jw))


@pytest.mark.parametrize("features", [f for f in FEATURES if not (f.get("running") or f.get("stiff"))], ids=str)
def test_exchange_gains_are_exact(features):
    problem = random_problem(11, **features)
    r = discretise(problem)
    sweep = Sweep(r)
    sweep.remember_products()
    v = random_policy(problem, np.random.default_rng(2), integral=True)
    J, _ = sweep.cost_and_gradient(v)
    gain, leaving, entering = best_exchanges(sweep, feasible_set(problem), v)
    other = Sweep(r)
    for k in range(r.intervals):
        best = 0.0
        for j in np.flatnonzero(v[k] > 0.5):
            for e in np.flatnonzero(v[k] < problem.upper[k] - 0.5):
                if e != j:
                    trial = v.copy()
                    trial[k, j] -= 1
                    trial[k, e] += 1
                    best = min(best, other.cost(trial) - J)
        assert gain[k] == pytest.approx(best, rel=1e-5, abs=1e-7 * abs(J))
        assert (leaving[k] >= 0) == (gain[k] < 0) == (entering[k] >= 0)


@pytest.mark.parametrize("rows", [1, 2])
def test_with_a_running_weight_an_exchange_saves_at_least_what_is_said(rows):
    problem = random_problem(11, running=True, rows=rows, select=2, windows=True)
    r = discretise(problem)
    sweep = Sweep(r)
    sweep.remember_products()
    v = random_policy(problem, np.random.default_rng(2), integral=True)
    J, _ = sweep.cost_and_gradient(v)
    gain, leaving, entering = best_exchanges(sweep, feasible_set(problem), v)
    assert np.any(gain < 0)
    changes = []
    for k in np.flatnonzero(gain < 0):
        trial = v.copy()
        trial[k, leaving[k]] -= 1
        trial[k, entering[k]] += 1
        assert np.all(trial >= 0) and np.all(trial <= problem.upper)
        changes.append(Sweep(r).cost(trial) - J)
    assert np.all(changes <= gain[gain < 0] + 1e-10 * abs(J))


@pytest.mark.parametrize("rows", [1, 2])
def test_on_the_last_interval_an_exchange_saves_exactly_what_is_said(rows):
    """After it there is nothing concave: the covariance enters the rest of the cost linearly."""
    problem = random_problem(11, running=True, rows=rows, intervals=1, sensors=4)
    sweep = Sweep(discretise(problem))
    costs = [sweep.cost(np.eye(4)[None, j]) for j in range(4)]
    for j in range(4):
        J, _ = sweep.cost_and_gradient(np.eye(4)[None, j])
        (gain,), (leaving,), (entering,) = best_exchanges(sweep, feasible_set(problem), np.eye(4)[None, j])
        if costs[j] == min(costs):
            assert (gain, leaving, entering) == (0.0, -1, -1)
        else:
            assert (leaving, entering) == (j, int(np.argmin(costs)))
            assert gain == pytest.approx(min(costs) - J, rel=1e-8)

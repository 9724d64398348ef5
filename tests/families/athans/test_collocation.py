"""Direct collocation against closed forms, re-integration, and the multipliers against an integrated costate."""

import dataclasses
import itertools
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from occontrol.api import read_problem
from occontrol.core.errors import ProblemError
from occontrol.core.monitor import Monitor
from occontrol.core.plant import LinearPlant
from occontrol.core.schedule import Schedule
from occontrol.core.sensor import Sensor, idle_sensor
from occontrol.core.signal import TableSignal
from occontrol.core.solution import Status
from occontrol.families.athans.collocation import program as collocation_program
from occontrol.families.athans.collocation.mesh import coarse_breaks, simulate_mesh
from occontrol.families.athans.collocation.simulation import Data, simulate_interval
from occontrol.families.athans.collocation.solve import feasible_policy, solve_collocation, uniform_policy
from occontrol.families.athans.continuous.reintegration import reintegrate
from occontrol.families.athans.discretise import discretise, feasible_set, half_predicts
from occontrol.families.athans.methods import Collocation
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.scheduling.relaxation import RelaxedOptions, minimise_relaxed
from occontrol.scheduling.sweep import Sweep


def scalar(data=(0.0, 1, 1, 1, 5, 1, 0.1), intervals=40):
    a, noise, rate, start, end, weight, price = data
    sensors = [Sensor("on", [[1.0]], [[1 / rate]], cost=1.0), idle_sensor(1)]
    plant = LinearPlant([[a]], [[noise]], [[start]])
    edges = np.linspace(0, end, intervals + 1)
    return SchedulingProblem("scalar", plant, sensors, edges, [[np.sqrt(weight)]], cost_weight=price)


def oscillator(**changes):
    given = {
        "name": "oscillator",
        "plant": LinearPlant([[0, 1], ["-(1+0.2*sin(t))", -0.4]], [[0, 0], [0, 0.5]], np.diag([5.0, 5.0])),
        "sensors": [
            Sensor("range", [[1, 0]], [[0.1]], cost=0.6),
            Sensor("doppler", [[0, 1]], [[0.4]], cost="0.3+0.1*t"),
            idle_sensor(2),
        ],
        "edges": np.linspace(0, 3, 13),
        "output": [[1, 0]],
        "cost_weight": 0.1,
        "predict_at": 3.5,
        "running": [[0.05, 0], [0, 0]],
    }
    return SchedulingProblem(**{**given, **changes})


def check(problem, found):
    return reintegrate(problem, Schedule(problem.edges, found.weights, tuple(problem.sensors.names)))


@pytest.mark.parametrize("scheme", ["radau", "legendre"])
@pytest.mark.parametrize(
    ("data", "switch", "best"),
    [((0.0, 1, 1, 1, 5, 1, 0.1), 3.340036, 1.2122712), ((0.5, 1, 1, 1, 3, 1, 0.2), 1.59131, 1.9753688)],
)
def test_scalar_closed_form(data, switch, best, scheme):
    problem = scalar(data)
    found = solve_collocation(problem, Collocation(scheme=scheme))
    assert found.status is Status.FEASIBLE
    h = problem.steps[0]
    assert np.sum(found.weights[:, 1]) * h == pytest.approx(switch, abs=h)  # the grid's accuracy
    assert best * (1 - 1e-5) <= found.cost <= best * (1 + 1e-3)
    again = check(problem, found)
    assert found.cost == pytest.approx(again.cost, rel=1e-5)
    assert again.lower_bound <= best * (1 + 1e-7)


@pytest.mark.parametrize("scheme", ["radau", "legendre"])
def test_cost_and_costate_of_varying_data(scheme):
    problem = oscillator()
    found = solve_collocation(problem, Collocation(scheme=scheme, relative_gap=1e-6))
    again = check(problem, found)
    assert found.cost == pytest.approx(again.cost, rel=1e-6)
    np.testing.assert_allclose(found.covariance, again.covariance_at_edges, rtol=1e-4, atol=1e-5)
    assert uniform_policy(problem).shape == found.weights.shape
    uniform = reintegrate(problem, Schedule(problem.edges, uniform_policy(problem), tuple(problem.sensors.names)))
    assert found.cost < uniform.cost * 0.99

    def backward(t, y, v, S):
        P, covariance, A = y.reshape(2, 2), S(t)[:4].reshape(2, 2), problem.plant.A.at(t)
        L = v[0] * np.diag([1 / 0.1, 0]) + v[1] * np.diag([0, 1 / 0.4])
        return (-P @ A - A.T @ P + P @ covariance @ L + L @ covariance @ P - problem.running.at(t)).ravel()

    def forward(t, y, v):
        S, A = y.reshape(2, 2), problem.plant.A.at(t)
        L = v[0] * np.diag([1 / 0.1, 0]) + v[1] * np.diag([0, 1 / 0.4])
        return (A @ S + S @ A.T + problem.plant.noise.at(t) - S @ L @ S).ravel()

    S, paths, tight = problem.plant.covariance.ravel(), [], {"method": "DOP853", "rtol": 1e-11, "atol": 1e-13}
    for k in range(problem.intervals):
        span = (problem.edges[k], problem.edges[k + 1])
        paths.append(solve_ivp(forward, span, S, dense_output=True, args=(found.weights[k],), **tight))
        S = paths[-1].y[:, -1]
    P = found.costate[-1].ravel()  # W: integrated apart
    worst = 0.0
    for k in reversed(range(problem.intervals)):
        span = (problem.edges[k + 1], problem.edges[k])
        P = solve_ivp(backward, span, P, args=(found.weights[k], paths[k].sol), **tight).y[:, -1]
        worst = max(worst, np.abs(P.reshape(2, 2) - found.costate[k]).max() / np.abs(P).max())
    assert worst <= 2e-4


@pytest.mark.slow
def test_cost_is_stationary_for_finite_differences_of_the_policy():
    """No feasible direction lowers the continuous cost: the gradient by re-integration is the multipliers' business."""
    problem = oscillator(edges=np.linspace(0, 3, 5), running=None)
    found = solve_collocation(problem, Collocation(relative_gap=1e-6))
    names = tuple(problem.sensors.names)
    base = reintegrate(problem, Schedule(problem.edges, found.weights, names)).cost
    seen = 0
    for k in range(problem.intervals):
        for j in range(3):
            toward = found.weights.copy()
            toward[k] = np.eye(3)[j]
            if np.abs(toward - found.weights).max() < 0.05:
                continue
            seen += 1
            moved = found.weights + 1e-3 * (toward - found.weights)
            assert reintegrate(problem, Schedule(problem.edges, moved, names)).cost >= base - 1e-8
    assert seen >= 6


def test_windows_and_two_at_a_time():
    sensors = [
        Sensor("range", [[1, 0]], [[0.1]], cost=0.6, windows=[(0, 1), (2, 3)]),
        Sensor("doppler", [[0, 1]], [[0.4]], cost=0.3),
        Sensor("sum", [[1, 1]], [[0.5]], cost=0.1),
        idle_sensor(2),
    ]
    problem = oscillator(sensors=sensors, select=2, edges=np.linspace(0, 3, 7))
    found = solve_collocation(problem)
    assert found.status is Status.FEASIBLE
    assert np.all(found.weights >= 0) and np.all(found.weights <= problem.upper)
    np.testing.assert_allclose(found.weights.sum(axis=1), 2, atol=1e-12)
    assert np.all(found.weights[2:4, 0] == 0)
    assert found.cost == pytest.approx(check(problem, found).cost, rel=1e-5)


def test_nothing_to_choose():
    one = SchedulingProblem(
        "one", LinearPlant([[0.1]], [[1.0]], [[2.0]]), [Sensor("s", [[1.0]], [[1.0]])], [0.0, 1.0], [[1.0]]
    )
    found = solve_collocation(one)
    assert found.weights.tolist() == [[1.0]]
    assert found.cost == pytest.approx(check(one, found).cost, rel=1e-5)


@pytest.mark.parametrize(("prior", "theta"), [(250.0, 0.1), (0.0, 0.1), (1e6, 0.01)])
def test_stiff_and_singular_starts(prior, theta):
    problem = oscillator(
        plant=LinearPlant([[0, 1], [-1, -0.4]], [[0, 0], [0, 0.5]], prior * np.eye(2)),
        sensors=[
            Sensor("range", [[1, 0]], [[theta]], cost=0.6),
            Sensor("mixed", [[0.6, 0.8]], [[2 * theta]], cost=0.3),
            idle_sensor(2),
        ],
        edges=np.linspace(0, 3, 7),
        running=None,
    )
    found = solve_collocation(problem)
    again = check(problem, found)
    assert found.status is Status.FEASIBLE
    assert found.cost == pytest.approx(again.cost, rel=1e-4)
    assert again.relative_gap < 0.2


def test_interrupt_returns_a_feasible_policy():
    def show(record):
        if record["iteration"] == 2:
            monitor.interrupted = 2

    monitor = Monitor(show=show)
    problem = oscillator()
    found = solve_collocation(problem, None, monitor)
    assert found.status is Status.INTERRUPTED
    np.testing.assert_allclose(found.weights.sum(axis=1), 1, atol=1e-12)
    assert check(problem, found).lower_bound < check(problem, found).cost


def test_iteration_limit_and_unknown_scheme():
    found = solve_collocation(oscillator(), Collocation(max_iterations=2))
    assert found.status is Status.LIMIT and "max_iterations" in found.message
    with pytest.raises(ProblemError, match="'euler'\n  hint: one of: radau, legendre"):
        Collocation(scheme="euler")


def test_feasible_policy_keeps_bounds_and_sums():
    problem = oscillator(select=2)
    weights = np.random.default_rng(0).normal(0.6, 0.5, size=problem.upper.shape)
    mended = feasible_policy(problem, weights)
    assert np.all(mended >= 0) and np.all(mended <= problem.upper)
    np.testing.assert_allclose(mended.sum(axis=1), 2, atol=1e-9)


def test_mesh_follows_a_steep_start():
    problem = scalar((0.0, 1, 10, 250, 5, 1, 0.1), 5)
    mesh = simulate_mesh(problem, uniform_policy(problem), np.array([1.0]), 0.7)
    first = mesh.lengths[mesh.interval == 0]
    assert len(first) > 8 and np.all(np.diff(first)[:-1] > 0)
    assert mesh.starts[-1] + mesh.lengths[-1] == pytest.approx(5.0)
    np.testing.assert_allclose(mesh.ends[mesh.first[1]], check_scalar(250, 0.5 * 10, 1.0), rtol=1e-7)


def check_scalar(start, rate, t):
    root = rate**-0.5
    return root * (start + root * np.tanh(t / root)) / (root + start * np.tanh(t / root))


class Enough(Exception):
    """The program has been seen."""


@pytest.mark.parametrize("scheme", ["radau", "legendre"])
@pytest.mark.parametrize("changes", [{}, {"running": None, "edges": np.linspace(0, 3, 2)}])
def test_the_jacobian_of_blocks_is_the_one_that_casadi_finds(scheme, changes, monkeypatch):
    seen = []

    def keep(program, start, options, monitor):
        seen.append((program, start))
        raise Enough

    monkeypatch.setattr(collocation_program, "solve_nlp", keep)
    with pytest.raises(Enough):
        solve_collocation(oscillator(**changes), Collocation(scheme=scheme))
    import casadi

    program, start = seen[0]
    both = [casadi.jacobian(program.constraints, program.variables), program.jacobian]
    at = start + 0.05 * np.random.default_rng(0).normal(size=len(start))
    found, given = casadi.Function("both", [program.variables], both)(at)
    assert np.count_nonzero(np.array(found)) > 50
    np.testing.assert_allclose(np.array(given), np.array(found), rtol=1e-12, atol=1e-13)


def test_only_corners_of_tables_end_elements():
    times = np.linspace(0, 3, 31)
    smooth = TableSignal(times, np.stack([[[np.cos(t), 0.0]] for t in times]))
    corner = TableSignal(np.array([0, 1.7, 3]), np.array([[[0.3]], [[0.1]], [[0.3]]]))
    held = TableSignal(np.array([0, 0.9]), np.array([[[0.4]], [[0.2]]]), "previous")
    sensors = [Sensor("a", smooth, corner), Sensor("b", [[0, 1]], held), idle_sensor(2)]
    breaks = coarse_breaks(oscillator(sensors=sensors))
    np.testing.assert_allclose(breaks, [0, 0.9, 1.7])


@pytest.mark.parametrize("prior", [5.0, 1e4])  # the second is integrated in the information form
def test_simulation_from_kink_to_kink(prior):
    times = np.array([0, 0.2, 0.35, 0.5, 1.0])
    C = TableSignal(times, np.array([[[1, 0]], [[0.2, 1]], [[2, -1]], [[0, 1]], [[1, 1.0]]]))
    held = TableSignal(np.array([0, 0.6]), np.array([[[0.1]], [[0.02]]]), "previous")
    plant = LinearPlant([[0, 1], [-1, -0.4]], [[0, 0], [0, 0.5]], prior * np.eye(2))
    problem = oscillator(plant=plant, sensors=[Sensor("a", C, held), idle_sensor(2)], edges=np.array([0, 1.0]))
    path = simulate_interval(Data(problem), 0.0, 1.0, plant.covariance, np.array([0.8, 0.2]))

    def rate(t, y, theta):
        Y, A, c = y.reshape(2, 2), plant.A.at(t), C.at(t)
        return (0.8 / theta * c.T @ c - Y @ A - A.T @ Y - Y @ plant.noise.at(t) @ Y).ravel()

    Y = np.linalg.inv(plant.covariance).ravel()
    for a, b in itertools.pairwise([0, 0.2, 0.35, 0.5, 0.6, 1.0]):
        given = {"method": "LSODA", "rtol": 1e-11, "atol": 1e-14, "args": (0.1 if a < 0.6 else 0.02,)}
        Y = solve_ivp(rate, (a, b), Y, **given).y[:, -1]
        np.testing.assert_allclose(path(np.array([b]))[0], np.linalg.inv(Y.reshape(2, 2)), rtol=1e-6, atol=1e-7)
    mixed = path(np.array([0.7, 0.1, 0.35]))
    np.testing.assert_allclose(mixed[2], path(np.array([0.35]))[0], rtol=1e-12)


@pytest.mark.slow
def test_two_orbits_of_the_tracking_network_agree_with_the_relaxation():
    """Tables of hundreds of breakpoints, six states, sensors that see something: few elements, the same optimum."""
    whole = read_problem(Path(__file__).parents[3] / "problems" / "tracking_network.yaml")
    last = int(np.searchsorted(whole.edges, 10956.0))
    sensors = [s for s in whole.sensors if s.windows is None or any(a < 10956.0 for a, _ in s.windows)]
    edges = whole.edges[: last + 1]
    problem = dataclasses.replace(whole, edges=edges, predict_at=16500.0, sensors=sensors)
    found = solve_collocation(problem, Collocation(relative_gap=3e-4, max_iterations=40))
    assert found.status is Status.FEASIBLE, found.message
    assert found.elements <= 2 * problem.intervals
    sweep = Sweep(discretise(problem, half_predicts(problem)))
    relaxed = minimise_relaxed(sweep, feasible_set(problem), None, RelaxedOptions(1e-6, 5000), Monitor()).weights
    again = check(problem, found)
    best = reintegrate(problem, Schedule(problem.edges, relaxed, tuple(problem.sensors.names)))
    uniform = reintegrate(problem, Schedule(problem.edges, uniform_policy(problem), tuple(problem.sensors.names)))
    assert uniform.cost > 1.05 * best.cost
    assert again.cost == pytest.approx(best.cost, rel=1e-4)
    assert found.cost == pytest.approx(again.cost, rel=3e-5)

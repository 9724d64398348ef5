"""The continuous re-integration against SciPy's integrators, closed forms and the algebraic Riccati equation."""

import itertools

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.linalg import expm, solve_continuous_are

from occontrol.core.plant import LinearPlant
from occontrol.core.schedule import Schedule, constant_schedule
from occontrol.core.sensor import Sensor, idle_sensor
from occontrol.core.signal import TableSignal
from occontrol.families.athans.continuous.reintegration import reintegrate
from occontrol.families.athans.integration.options import Integration
from occontrol.families.athans.problem import SchedulingProblem


def judge(problem, schedule, rtol=1e-12):
    """Cost and bound from DOP853 on full matrices, interval by interval, and adaptive quadrature of the gap."""
    n, plant, alpha = problem.states, problem.plant, problem.cost_weight
    t0, end, later = problem.edges[0], problem.edges[-1], problem.predict_at

    def rate(j, t):
        C = problem.sensors[j].C.at(t)
        return C.T @ np.linalg.solve(problem.sensors[j].noise.at(t), C) if len(C) else np.zeros((n, n))

    def R(t):
        return np.zeros((n, n)) if problem.running is None else problem.running.at(t)

    def spread(t, y):
        phi = y[: n * n].reshape(n, n)
        return np.concatenate([(plant.A.at(t) @ phi).ravel()])

    phi = np.eye(n)
    if later > end:
        phi = (
            solve_ivp(spread, (end, later), phi.ravel(), method="DOP853", rtol=rtol, atol=1e-13).y[:, -1].reshape(n, n)
        )
    D = problem.output.at(later) @ phi
    costs = lambda t: alpha * np.array([s.cost.at(t)[0, 0] for s in problem.sensors])  # noqa: E731

    def forward(t, y, v, a, b):
        t = min(max(t, a + 1e-13), b - 1e-13)  # tables may jump at the ends of a piece
        S = y[: n * n].reshape(n, n)
        A, L = plant.A.at(t), sum(w * rate(j, t) for j, w in enumerate(v))
        dS = A @ S + S @ A.T + plant.noise.at(t) - S @ L @ S
        return np.concatenate([dS.ravel(), [np.trace(R(t) @ S), costs(t) @ v]])

    inner = [s.breaks(t0, end) for s in problem.signals.values()]
    breaks = np.unique(np.clip(np.concatenate([schedule.edges, *inner]), t0, end))
    policy = lambda a, b: schedule.weights[np.searchsorted(schedule.edges, (a + b) / 2) - 1]  # noqa: E731
    y, pieces = np.concatenate([plant.covariance.ravel(), [0.0, 0.0]]), []
    for a, b in itertools.pairwise(breaks):
        piece = solve_ivp(
            forward, (a, b), y, method="DOP853", rtol=rtol, atol=1e-13, dense_output=True, args=(policy(a, b), a, b)
        )
        y = piece.y[:, -1]
        pieces.append((a, b, policy(a, b), piece.sol))
    cost = y[-1] + y[-2] + np.trace(D @ y[: n * n].reshape(n, n) @ D.T)
    P, gap = (D.T @ D).ravel(), 0.0
    for a, b, v, sol in reversed(pieces):

        def backward(t, p, v=v, sol=sol, a=a, b=b):
            t = min(max(t, a + 1e-13), b - 1e-13)
            P, S, A = p.reshape(n, n), sol(t)[: n * n].reshape(n, n), plant.A.at(t)
            L = sum(w * rate(j, t) for j, w in enumerate(v))
            return (-P @ A - A.T @ P + P @ S @ L + L @ S @ P - R(t)).ravel()

        piece = solve_ivp(backward, (b, a), P, method="DOP853", rtol=rtol, atol=1e-14, dense_output=True)
        P = piece.y[:, -1]

        def integrand(t, v=v, sol=sol, costate=piece.sol):
            S, P = sol(t)[: n * n].reshape(n, n), costate(t).reshape(n, n)
            s = costs(t) - np.array([np.trace(rate(j, t) @ S @ P @ S) for j in range(len(v))])
            inside = [x.windows is None or any(c <= t <= d for c, d in x.windows) for x in problem.sensors]
            room = [x.is_idle * problem.select or float(y) for x, y in zip(problem.sensors, inside, strict=True)]
            left, least = problem.select, 0.0
            for j in np.argsort(s):
                least, left = least + min(room[j], left) * s[j], left - min(room[j], left)
            return v @ s - least

        windows = [w for s in problem.sensors if s.windows for pair in s.windows for w in pair if a < w < b]
        grid = np.unique([*np.linspace(a, b, 9), *windows])
        gap += sum(quad(integrand, c, d, epsabs=1e-11, epsrel=1e-10, limit=200)[0] for c, d in itertools.pairwise(grid))
    return cost, cost - gap, y[: n * n].reshape(n, n)


def agree(problem, schedule, cost_tolerance=2e-9, bound_tolerance=2e-8):
    found = reintegrate(problem, schedule)
    cost, bound, last = judge(problem, schedule)
    assert abs(found.cost - cost) <= cost_tolerance * abs(cost)
    assert abs(found.lower_bound - bound) <= bound_tolerance * max(abs(cost), abs(bound))
    assert found.lower_bound <= bound + 1e-9 * abs(cost)
    np.testing.assert_allclose(found.covariance_at_edges[-1], last, rtol=1e-7, atol=1e-9 * np.abs(last).max())
    parts = problem.cost_weight * found.observation_cost + found.running_cost + found.prediction_error
    assert found.cost == pytest.approx(parts, rel=1e-14)
    return found


def oscillator(**changes):
    given = {
        "name": "oscillator",
        "plant": LinearPlant([[0, 1], [-1, -0.4]], [[0, 0], [0, 0.5]], np.diag([5.0, 5.0])),
        "sensors": [
            Sensor("range", [[1, 0]], [[0.1]], cost=2.0),
            Sensor("doppler", [[0, 1]], [[0.4]], cost=0.5),
            idle_sensor(2),
        ],
        "edges": np.linspace(0, 3, 7),
        "output": [[1, 0]],
        "cost_weight": 0.1,
    }
    return SchedulingProblem(**{**given, **changes})


def fractions(problem, seed=1, places=None):
    weights = np.random.default_rng(seed).dirichlet(np.ones(len(problem.sensors)), size=problem.intervals)
    return Schedule(problem.edges, weights * problem.select, tuple(problem.sensors.names))


def test_constant_data_against_an_explicit_integrator():
    problem = oscillator(predict_at=4.0)
    found = agree(problem, fractions(problem))
    assert found.relative_gap > 1e-3  # an arbitrary policy: the bound is really tested


def test_varying_data_running_cost_and_costs_of_time():
    problem = oscillator(
        plant=LinearPlant([[0, 1], ["-(1+0.2*sin(3*t))", -0.4]], [["0.1*exp(-t)", 0], [0, 0.5]], np.diag([5.0, 5.0])),
        sensors=[
            Sensor("range", [["1+0.3*cos(t)", 0]], [["0.1+0.05*t"]], cost="1+sin(t)**2"),
            Sensor("both", np.eye(2), np.eye(2)),
        ],
        running=[["0.3*t", 0], [0, 0.2]],
        edges=np.array([0.0, 0.4, 1.1, 2.0, 3.0]),
        predict_at=3.5,
    )
    found = agree(problem, fractions(problem))
    assert found.running_cost > 0.1


def test_tables_with_jumps_and_windows_off_the_grid():
    table = TableSignal(
        np.array([0.0, 0.7, 1.9, 3.0]), np.array([[[0, 1], [-a, -0.4]] for a in (1, 3, 0.5, 2)]), "previous"
    )
    problem = oscillator(
        plant=LinearPlant(
            table, TableSignal(np.array([0.0, 1.3, 3.0]), np.array([np.eye(2) * a for a in (0.1, 1, 0.2)])), np.eye(2)
        ),
        sensors=[
            Sensor("range", [[1, 0]], [[0.1]], cost=0.3, windows=[(0.0, 1.25), (1.9, 3.0)]),
            Sensor("doppler", [[0, 1]], [[0.4]], cost=0.2),
            idle_sensor(2),
        ],
        edges=np.linspace(0, 3, 4),
        integration=Integration(substeps=1, windows="cover"),
    )
    weights = np.array([[0.5, 0.2, 0.3], [0.0, 0.9, 0.1], [0.3, 0.3, 0.4]])
    schedule = Schedule(problem.edges, weights, ("range", "doppler", "idle"))
    windowed = agree(problem, schedule)
    # what the window allows beyond the grid counts: closing it to the grid can only raise the bound
    closed = oscillator(
        plant=problem.plant,
        sensors=[
            Sensor("range", [[1, 0]], [[0.1]], cost=0.3, windows=[(0.0, 1.0), (2.0, 3.0)]),
            *list(problem.sensors)[1:],
        ],
        edges=problem.edges,
        integration=problem.integration,
    )
    assert reintegrate(closed, schedule).lower_bound > windowed.lower_bound + 1e-6


def test_two_of_three_sensors():
    problem = oscillator(select=2)
    weights = np.random.default_rng(4).uniform(0.5, 0.8, size=(problem.intervals, 3))
    weights[:, 2] = 2 - weights[:, 0] - weights[:, 1]
    agree(problem, Schedule(problem.edges, weights, ("range", "doppler", "idle")))


@pytest.mark.parametrize(
    ("data", "switch", "best"),
    [((0.0, 1, 1, 1, 5, 1, 0.1), 3.340036, 1.2122712), ((0.5, 1, 1, 1, 3, 1, 0.2), 1.59131, 1.9753688)],
)
def test_scalar_closed_form(data, switch, best):
    a, noise, rate, start, end, weight, price = data
    problem = SchedulingProblem(
        "on or off",
        LinearPlant([[a]], [[noise]], [[start]]),
        [Sensor("on", [[1.0]], [[1 / rate]], cost=1.0), idle_sensor(1)],
        np.linspace(0, end, 11),
        [[np.sqrt(weight)]],
        cost_weight=price,
    )

    def exact(at):  # idle until `at`: a Lyapunov flow; then tanh-like, from the two roots of the Riccati equation
        S = start + noise * at if a == 0 else (start + noise / (2 * a)) * np.exp(2 * a * at) - noise / (2 * a)
        Z = expm((end - at) * np.array([[-a, rate], [noise, a]]))
        return price * (end - at) + weight * (Z[1, 0] + Z[1, 1] * S) / (Z[0, 0] + Z[0, 1] * S)

    found = reintegrate(problem, Schedule([0, switch, end], [[0, 1], [1, 0]], ("on", "idle")))
    assert found.cost == pytest.approx(exact(switch), rel=1e-11)
    assert found.cost == pytest.approx(best, rel=1e-7)
    assert best * (1 - 1e-6) <= found.lower_bound <= found.cost  # the policy is optimal, so its own bound is tight
    for at in (0.3, 0.9 * end):
        poor = reintegrate(problem, Schedule([0, at, end], [[0, 1], [1, 0]], ("on", "idle")))
        assert poor.lower_bound < best < poor.cost
        assert poor.cost == pytest.approx(exact(at), rel=1e-10)


def test_long_horizon_reaches_the_algebraic_riccati_equation():
    control = pytest.importorskip("control")
    rng = np.random.default_rng(2)
    A, C = rng.normal(size=(4, 4)), rng.normal(size=(2, 4))
    noise, theta = np.eye(4), np.diag([0.3, 2.0])
    problem = SchedulingProblem(
        "care", LinearPlant(A, noise, 9 * np.eye(4)), [Sensor("s", C, theta)], np.linspace(0, 40, 5), np.eye(4)
    )
    last = reintegrate(problem, constant_schedule(problem.edges, ["s"], [1.0])).covariance_at_edges[-1]
    np.testing.assert_allclose(last, solve_continuous_are(A.T, C.T, noise, theta), rtol=1e-9)
    np.testing.assert_allclose(last, control.lqe(A, np.eye(4), C, noise, theta)[1], rtol=1e-8)


def test_large_prior_and_sharp_sensor():
    """Sigma0 = 1e6 I, Theta = 1e-3, with a running cost, against SciPy's Radau on the information matrix."""
    A = np.array([[0.2, 1.0], [-1.0, 0.1]])
    C = np.array([[0.6, 0.8]])
    R = 0.3 * np.eye(2)
    problem = SchedulingProblem(
        "stiff",
        LinearPlant(A, 0.1 * np.eye(2), 1e6 * np.eye(2)),
        [Sensor("sharp", C, [[1e-3]], cost=1.0), idle_sensor(2)],
        np.linspace(0, 2, 9),
        [[1, 0]],
        cost_weight=0.1,
        running=R,
    )
    found = reintegrate(problem, constant_schedule(problem.edges, ["sharp", "idle"], [0.7, 0.3]))

    def field(t, y):
        Y = y[:4].reshape(2, 2)
        dY = -A.T @ Y - Y @ A - Y @ (0.1 * np.eye(2)) @ Y + 0.7 * C.T @ C / 1e-3
        return np.concatenate([dY.ravel(), [0.3 * np.trace(Y) / np.linalg.det(Y)]])

    y = solve_ivp(field, (0, 2), [1e-6, 0, 0, 1e-6, 0], method="Radau", rtol=1e-11, atol=1e-14).y[:, -1]
    last = np.linalg.inv(y[:4].reshape(2, 2))
    np.testing.assert_allclose(found.covariance_at_edges[-1], last, rtol=1e-7)
    assert found.running_cost == pytest.approx(y[4], rel=1e-7)
    assert found.error <= 1e-6 * found.cost
    assert found.lower_bound < found.cost


def test_bound_with_large_prior_is_the_derivative_of_the_cost():
    """s_idle = 0: int_k s_j dt is the derivative of the cost when sensor j takes idle's share on interval k."""
    problem = SchedulingProblem(
        "stiff",
        LinearPlant([[0.0, 1.0], [0.0, 0.0]], np.diag([0.0, 0.1]), 1e6 * np.eye(2)),
        [Sensor("position", [[1, 0]], [[1e-3]], cost=1.0), Sensor("speed", [[0, 1]], [[1e-3]]), idle_sensor(2)],
        np.concatenate([[0.0, 0.02], np.linspace(0, 2, 9)[1:]]),
        [[1, 0]],
        cost_weight=0.05,
        running=0.01 * np.eye(2),
    )
    names, rng = ("position", "speed", "idle"), np.random.default_rng(3)
    weights = rng.dirichlet(4 * np.ones(3), size=problem.intervals)
    base = reintegrate(problem, Schedule(problem.edges, weights, names))
    slopes = np.zeros_like(weights)
    for k in range(problem.intervals):
        for j in range(2):
            costs = []
            for step in (1e-4, -1e-4):
                moved = weights.copy()
                moved[k, j] += step
                moved[k, 2] -= step
                costs.append(reintegrate(problem, Schedule(problem.edges, moved, names)).cost)
            slopes[k, j] = (costs[0] - costs[1]) / 2e-4
    by_interval = np.sum(weights * slopes) - np.sum(np.min(slopes, axis=1))
    gap = base.cost - base.lower_bound
    # switching inside the intervals can only gain on switching at their edges
    assert by_interval - 1e-6 * base.cost <= gap <= 1.15 * by_interval
    assert gap > 1e-3 * base.cost


def test_singular_prior_and_no_plant_noise():
    problem = oscillator(plant=LinearPlant([[0.3, 1], [-1, -0.4]], np.zeros((2, 2)), [[1.0, 1.0], [1.0, 1.0]]))
    found = agree(problem, fractions(problem))
    assert abs(np.linalg.det(found.covariance_at_edges[-1])) < 1e-9
    nothing = oscillator(plant=LinearPlant([[0.3, 1], [-1, -0.4]], np.zeros((2, 2)), np.zeros((2, 2))))
    assert reintegrate(nothing, fractions(nothing)).prediction_error == 0.0


def test_unstable_plant_without_measurement_grows_as_the_lyapunov_equation():
    A = np.array([[1.0, 2.0], [0.0, 0.5]])
    problem = oscillator(plant=LinearPlant(A, np.eye(2), np.eye(2)), edges=np.linspace(0, 8, 5))
    found = reintegrate(problem, constant_schedule(problem.edges, ["range", "doppler", "idle"], [0, 0, 1.0]))
    block = expm(8 * np.block([[-A, np.eye(2)], [np.zeros((2, 2)), A.T]]))
    phi = block[2:, 2:].T
    np.testing.assert_allclose(found.covariance_at_edges[-1], phi @ block[:2, 2:] + phi @ phi.T, rtol=1e-10)


def test_noise_after_the_end_is_predicted():
    problem = oscillator(predict_at=5.0)
    found = reintegrate(problem, fractions(problem))
    after = oscillator(
        plant=LinearPlant([[0, 1], [-1, -0.4]], [[0, 0], [0, 0.5]], np.zeros((2, 2))), edges=np.array([0.0, 2.0])
    )
    drift = reintegrate(
        after, constant_schedule(after.edges, ["range", "doppler", "idle"], [0, 0, 1.0])
    ).prediction_error
    assert found.predicted_mean_square_error - found.prediction_error == pytest.approx(drift, rel=1e-9)


def test_schedule_columns_follow_their_names():
    problem = oscillator()
    schedule = fractions(problem)
    turned = Schedule(problem.edges, schedule.weights[:, ::-1], tuple(problem.sensors.names[::-1]))
    assert reintegrate(problem, turned).cost == pytest.approx(reintegrate(problem, schedule).cost, rel=1e-14)


def test_unbalanced_units_do_not_matter():
    units = np.array([1e4, 1e-5])
    problem = oscillator()
    plant = LinearPlant(
        problem.plant.A.at(0) * units[:, None] / units,
        problem.plant.noise.at(0) * np.outer(units, units),
        5 * np.diag(units**2),
    )
    sensors = [
        Sensor("range", [[1 / units[0], 0]], [[0.1]], cost=2.0),
        Sensor("doppler", [[0, 1 / units[1]]], [[0.4]], cost=0.5),
    ]
    other = oscillator(plant=plant, sensors=[*sensors, idle_sensor(2)], output=[[1 / units[0], 0]])
    one, two = reintegrate(problem, fractions(problem)), reintegrate(other, fractions(other))
    assert two.cost == pytest.approx(one.cost, rel=1e-9)
    assert two.lower_bound == pytest.approx(one.lower_bound, rel=1e-7)


@pytest.mark.slow
def test_thirty_states_four_hundred_intervals(monkeypatch):
    """The work is counted in panels that are integrated: on any machine the same."""
    from occontrol.families.athans.continuous.reintegration import _Sweep

    panels, forward = [], _Sweep.forward
    monkeypatch.setattr(_Sweep, "forward", lambda self: (panels.append(len(self.panels.lengths)), forward(self)))
    rng = np.random.default_rng(0)
    n, M, N = 30, 20, 400
    A = rng.normal(size=(n, n)) / np.sqrt(n) - 0.3 * np.eye(n)
    sensors = [
        Sensor(f"s{j}", rng.normal(size=(1 + j % 2, n)), np.eye(1 + j % 2) * 0.1, cost=rng.random()) for j in range(M)
    ]
    problem = SchedulingProblem(
        "big", LinearPlant(A, 0.5 * np.eye(n), 250 * np.eye(n)), sensors, np.linspace(0, 10, N + 1), np.eye(n)[:2]
    )
    found = reintegrate(problem, fractions(problem))
    assert sum(panels) < 4000, panels
    assert found.error < 1e-8 * found.cost

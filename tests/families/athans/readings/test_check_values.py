"""Problems of readings whose answers are known: by enumeration, by closed forms, by other people's filters."""

import numpy as np
import pytest

from occontrol.api import read_problem, solve
from occontrol.core.plant import DiscretePlant, LinearPlant
from occontrol.core.sensor import Sensor
from occontrol.core.signal import ExpressionSignal, TableSignal
from occontrol.families.athans.methods import RelaxRoundPolish
from occontrol.families.athans.readings.clock import SampleTimes, Steps
from occontrol.families.athans.readings.problem import ReadingsProblem


def discrete(**more) -> ReadingsProblem:
    plant = DiscretePlant(
        F=[[1, 0.5, 0], [-0.3, 0.9, 0.2], [0, 0, "0.95+0.05*cos(0.7*k)"]], Q=np.diag([0, 0.04, 0.09]),
        covariance=np.diag([4.0, 1, 2]),
    )  # fmt: skip
    sensors = [
        Sensor("one", [[1, 0, 0]], [[0.25]], 0.02, variable="k"),
        Sensor("two", [[0, 1, 0]], [[0.1]], 0.01, variable="k"),
        Sensor("three", [[0, 0, 1], [1, 0, 0]], [[0.5, 0.1], [0.1, 1.0]], 0.05, variable="k"),
    ]
    output = [[1, 0, 0], [0, np.sqrt(0.5), 0]]
    return ReadingsProblem("discrete", plant, sensors, Steps(6), output, **more)


def sampled() -> ReadingsProblem:
    plant = LinearPlant(A=[[0, 1], [-1, -0.4]], noise=np.diag([0, 0.5]), covariance=np.diag([5.0, 5.0]))
    sensors = [Sensor("range", [[1, 0]], [[0.1]], 0.2), Sensor("doppler", [[0, 1]], [[0.4]], 0.05)]
    clock = SampleTimes([0, 0.3, 0.5, 1.2, 1.6, 2.5], 0, 3)
    return ReadingsProblem("sampled", plant, sensors, clock, [[1, 0]], running=np.diag([1, 0.1]))


def chosen(solution) -> list[str]:
    return [";".join(entry["sensors"]) for entry in solution.result["schedule"]]


def test_discrete_time_with_a_weight_on_the_predicted_covariance():
    solution = solve(discrete())
    assert solution.cost == pytest.approx(0.34410135554766275, rel=1e-12)
    assert chosen(solution) == ["two", "one", "two", "two", "one", "two"]
    assert solution.result["relaxed_lower_bound"] == pytest.approx(0.32857043, rel=2e-4)
    assert solution.result["relaxed_lower_bound"] <= 0.32857044
    assert solution.result["lower_bound"] == pytest.approx(0.34410135554766275, rel=1e-6)
    assert solution.result["top"]["of"] == "problem"
    assert "continuous" not in solution.result


def test_samples_of_a_continuous_plant_with_a_running_integral():
    solution = solve(sampled())
    assert solution.cost == pytest.approx(1.608598017728358, rel=1e-12)
    assert chosen(solution) == ["range", "doppler", "doppler", "range", "doppler", "range"]
    assert solution.result["relaxed_cost"] == pytest.approx(1.313297874, rel=1e-5)
    assert solution.result["relaxed_cost"] >= 1.313297873


def oshman(before: bool) -> ReadingsProblem:
    """Oshman's example with the sum of posterior traces; `before`: the plant moves before the first reading."""
    given = read_problem("problems/oshman_example.yaml")
    F, Q, P = given.plant.F, given.plant.Q, given.plant.covariance
    if before:
        P = F.at(0.0) @ P @ F.at(0.0).T + Q.at(0.0)
        later = [[e.replace("k", "(k+1)") if isinstance(e, str) else e for e in row] for row in F.entries]
        F = ExpressionSignal(tuple(map(tuple, later)), "k")
    sensors = [Sensor(s.name, s.H, s.R, variable="k") for s in given.sensors]
    plant = DiscretePlant(F=F, Q=Q, covariance=P)
    return ReadingsProblem("oshman", plant, sensors, Steps(300, 25), np.zeros((1, 3)), running=np.eye(3))


@pytest.mark.parametrize(
    "before, cost, choices, plain, bound",
    [
        (False, 626.8439469508902, "322232121222", 27.38, 530.0),
        (True, 126.63129859355934, "222232121222", 27.32, 31.0),
    ],
    ids=["measure-first", "propagate-first"],
)
def test_oshmans_example_off_line(before, cost, choices, plain, bound):
    solution = solve(oshman(before))
    assert solution.cost == pytest.approx(cost, rel=1e-13)
    letters = {"one": "1", "two": "2", "three": "3"}
    assert "".join(letters[name] for name in chosen(solution)[::25]) == choices
    assert len(solution.result["schedule"]) == 300
    assert solution.result["relaxed_lower_bound"] <= plain
    # the relaxation reads all sensors a little at once: fixing the first choices takes most of the gap away
    assert bound <= solution.result["lower_bound"] <= cost


def test_without_branching_the_bound_is_the_relaxations():
    plain = solve(oshman(False), RelaxRoundPolish(branch_first=False, strengthen=False))
    assert plain.result["lower_bound"] == pytest.approx(plain.result["relaxed_lower_bound"], rel=1e-6)
    assert "nodes" not in plain.result


@pytest.mark.parametrize(
    "noise, end, cost, at, plain",
    [
        (0.1, 1.0, 0.290400298314, 0.5361596, 0.22656444),
        (1.0, 1.0, 0.409830149333, 0.6184539, 0.40625039),
        (0.1, 2.0, 1.089175401762, 1.0423940, 0.70321793),
    ],
)
def test_one_look_at_brownian_motion(noise, end, cost, at, plain):
    """J = int_0^T S dt with one reading of covariance r in all; tau = 215/401 of T in the first case."""
    plant = LinearPlant(A=[[0.0]], noise=[[1.0]], covariance=[[0.0]])
    clock = SampleTimes(end * np.arange(1, 401) / 401, 0.0, end)
    sensor = Sensor("look", [[1.0]], [[noise]])
    problem = ReadingsProblem("brown", plant, [sensor], clock, [[0.0]], running=[[1.0]], budget={"look": 1})
    solution = solve(problem)
    assert solution.cost == pytest.approx(cost, rel=1e-11)
    (tau,) = [entry["t"] for entry in solution.result["schedule"] if entry["sensors"] == ["look"]]
    assert tau == pytest.approx(at, abs=1e-7)
    # the closed form at that tau: S = t before, t - tau^2/(tau + r) after
    assert solution.cost == pytest.approx(end**2 / 2 - (end - tau) * tau**2 / (tau + noise), rel=1e-12)
    assert solution.result["relaxed_lower_bound"] <= plain <= solution.result["relaxed_cost"]
    assert solution.result["relaxed_lower_bound"] <= solution.result["lower_bound"] <= cost


TIMES = [0, 0.166, 0.333, 0.5, 0.666, 1, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10, 12, 24, 30, 48]


@pytest.mark.parametrize("kappa, cost", [(1e3, 0.821751657290), (1e6, 0.8222402961)])
def test_six_assays_of_a_compartment_model(kappa, cost):
    """Sensitivities of three parameters at nineteen times, six readings, prior kappa I; all designs enumerated."""
    from itertools import combinations

    a, b, c = 0.05884, 4.298, 21.80
    t = np.array(TIMES)
    rows = np.column_stack([-c * t * np.exp(-a * t), c * t * np.exp(-b * t), np.exp(-a * t) - np.exp(-b * t)])
    table = TableSignal(t, rows[:, None, :])
    plant = LinearPlant(A=np.zeros((3, 3)), noise=np.zeros((3, 3)), covariance=kappa * np.eye(3))
    clock = SampleTimes(TIMES, 0.0, 48.0)
    sensor = Sensor("assay", table, [[1.0]])
    problem = ReadingsProblem("compartment", plant, [sensor], clock, np.eye(3), budget={"total": 6})
    solution = solve(problem)
    chosen = [entry["t"] for entry in solution.result["schedule"] if entry["sensors"] == ["assay"]]
    designs = np.array(list(combinations(range(19), 6)))
    F = np.einsum("dki,dkj->dij", rows[designs], rows[designs]) + np.eye(3) / kappa
    traces = np.trace(np.linalg.inv(F), axis1=1, axis2=2)
    assert chosen == [TIMES[k] for k in designs[np.argmin(traces)]] == [0.166, 0.333, 1.0, 1.5, 2.0, 24.0]
    assert solution.cost == pytest.approx(cost, rel=1e-10)
    assert solution.cost == pytest.approx(float(traces.min()), rel=1e-7)
    assert solution.result["lower_bound"] <= float(traces.min())
    assert solution.result["relative_gap"] < 0.02


def test_two_of_six_sensors_at_four_steps_are_proven_optimal():
    """All 50,625 schedules enumerated by a plain filter."""
    from itertools import combinations

    rng = np.random.default_rng(600)
    F = rng.standard_normal((6, 6))
    F *= 0.9 / np.max(np.abs(np.linalg.eigvals(F)))
    C = np.eye(6)[rng.permutation(6)]
    plant = DiscretePlant(F=F, Q=0.5 * np.eye(6), covariance=np.eye(6))
    sensors = [Sensor(f"s{j}", C[j : j + 1], [[0.5]], variable="k") for j in range(6)]
    problem = ReadingsProblem("six", plant, sensors, Steps(4), np.zeros((1, 6)), running=np.eye(6), select=2)
    solution = solve(problem, RelaxRoundPolish(exact={"max_nodes": 10_000}))
    level = np.array([np.eye(6)])
    total = np.zeros(1)
    for k in range(4):
        S = level if k == 0 else F @ level @ F.T + 0.5 * np.eye(6)
        found = []
        for pair in combinations(range(6), 2):
            H = C[list(pair)]
            HS = H @ S
            found.append(S - np.swapaxes(HS, 1, 2) @ np.linalg.solve(HS @ H.T + 0.5 * np.eye(2), HS))
        level = np.concatenate(found)
        total = np.tile(total, 15) + np.trace(level, axis1=1, axis2=2)
    assert len(total) == 50_625
    assert solution.cost == pytest.approx(float(total.min()), rel=1e-12)
    assert solution.result["proven_optimal"] is True and solution.result["nodes"] > 100
    assert total.min() * (1 - 2e-6) <= solution.result["lower_bound"] <= total.min() * (1 + 1e-12)
    short = solve(problem, RelaxRoundPolish(exact={"max_nodes": 20}))
    assert short.result["proven_optimal"] is False
    assert short.result["lower_bound"] <= total.min()


def test_dense_samples_come_near_continuous_sensing():
    """Readings of covariance Theta/h every h: the cost of one sensor tends to the Riccati equation's, first order."""
    from scipy.integrate import solve_ivp

    A, Xi, S0, theta, T = np.array([[0.0, 1], [-1, -0.4]]), np.diag([0, 0.5]), np.diag([5.0, 5.0]), 0.1, 2.0
    C = np.array([[1.0, 0]])

    def rate(t, y):
        S = y[:4].reshape(2, 2)
        return (A @ S + S @ A.T + Xi - S @ C.T @ C @ S / theta).ravel()

    exact = float(solve_ivp(rate, (0, T), S0.ravel(), "DOP853", rtol=1e-12, atol=1e-14).y[0, -1])
    off = []
    for count in (40, 80, 160):
        h = T / count
        clock = SampleTimes(np.arange(count) * h, 0.0, T)
        plant = LinearPlant(A=A, noise=Xi, covariance=S0)
        problem = ReadingsProblem("dense", plant, [Sensor("one", C, [[theta / h]])], clock, C)
        off.append(solve(problem).cost - exact)
    assert off[0] / off[1] == pytest.approx(2.0, abs=0.15)
    assert off[1] / off[2] == pytest.approx(2.0, abs=0.08)

"""Problems of readings whose answers are known: by enumeration, by closed forms, by other people's filters."""

import numpy as np
import pytest

from occontrol.api import read_problem, solve
from occontrol.core.plant import DiscretePlant, LinearPlant
from occontrol.core.sensor import Sensor
from occontrol.core.signal import ExpressionSignal
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

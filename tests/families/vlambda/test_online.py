"""The on-line object and the filter over data: same numbers step by step, missing samples, consistency, refusals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from occontrol.api import read_problem
from occontrol.core.errors import ProblemError, SolveFailed, UsageError
from occontrol.core.measurement import Measurement
from occontrol.core.plant import DiscretePlant
from occontrol.families.vlambda.baselines import FixedChooser
from occontrol.families.vlambda.family import FAMILY
from occontrol.families.vlambda.methods import Optimal
from occontrol.families.vlambda.online import OnlineSelector
from occontrol.families.vlambda.problem import Problem
from occontrol.families.vlambda.sensor import DiscreteSensor, Region
from occontrol.families.vlambda.sensor_choice import EigenspaceChooser

PROBLEMS = Path(__file__).parents[3] / "problems"
solve, simulate, run_filter, online = FAMILY.solve, FAMILY.simulate, FAMILY.run_filter, FAMILY.online


@pytest.fixture(scope="module")
def oshman():
    return read_problem(PROBLEMS / "oshman_example.yaml")


def by_step(measurements):
    found: dict[int, dict[str, np.ndarray]] = {}
    for m in measurements:
        found.setdefault(int(m.time), {})[m.sensor] = m.values
    return found


def test_a_loop_that_measures_what_it_is_told_equals_the_run(oshman):
    """The loop is told the next sensors, measures only those, and its estimate is a Joseph-form Kalman filter's."""
    solution = solve(oshman)
    data = by_step(simulate(oshman, solution, 5)[0])
    loop = OnlineSelector(oshman.sampled, oshman.starts, 1, EigenspaceChooser())
    P, x, told = 250 * np.eye(3), np.zeros(3), loop.sensors
    chosen = []
    while not loop.finished:
        k = loop.step_number
        if k % 25 == 0:
            chosen.append(told[0])
        assert tuple(data[k]) == told
        j = oshman.sensors.index(told[0])
        H, R = oshman.sensors[j].H.at(k), oshman.sensors[j].R.at(k)
        done = loop.step(data[k])
        K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
        A = np.eye(3) - K @ H
        innovation = data[k][told[0]] - H @ x
        nis = innovation @ np.linalg.solve(H @ P @ H.T + R, innovation)
        P, x = A @ P @ A.T + K @ R @ K.T, x + K @ innovation
        assert done.estimate == pytest.approx(x, rel=1e-9, abs=1e-10)
        assert done.standard_deviation == pytest.approx(np.sqrt(np.diag(P)), rel=1e-9)
        assert done.nis == pytest.approx(nis, rel=1e-7, abs=1e-10)
        assert (done.time, done.dimension, done.missing) == (k, 2, ())
        F = oshman.plant.F.at(k)
        P, x = F @ P @ F.T + oshman.plant.Q.at(k), F @ x
        told = done.next_sensors
        assert done.next_step == (k + 1 if k < 299 else None)
    assert told == ()
    assert chosen == [e["sensors"][0] for e in solution.result["schedule"]]
    with pytest.raises(UsageError, match="the horizon of 300 steps is over"):
        loop.step({})


@pytest.mark.slow
def test_the_filter_over_a_file_equals_the_run_and_is_consistent(oshman):
    solution = solve(oshman)
    nees, nis = [], []
    for seed in range(20):
        measurements, truth = simulate(oshman, solution, seed)
        estimate = run_filter(oshman, solution, measurements)
        assert estimate.notes == ()
        assert estimate.standard_deviation == pytest.approx(solution.arrays["standard_deviations"], rel=1e-9)
        error = estimate.mean - truth.values
        nees.append(np.einsum("ki,ki->k", error, np.linalg.solve(estimate.covariance, error[:, :, None])[:, :, 0]))
        nis.append(estimate.nis)
    # 20 runs x 300 steps: innovations are independent chi-square with 2 degrees, states are correlated over k
    count = 20 * 300
    assert np.mean(nis) == pytest.approx(2.0, abs=4 * np.sqrt(4 / count))
    assert np.mean(nees) == pytest.approx(3.0, abs=4 * np.sqrt(6 / (count / 10)))
    assert np.array_equal(simulate(oshman, solution, 3)[0][7].values, simulate(oshman, solution, 3)[0][7].values)
    assert not np.array_equal(simulate(oshman, solution, 3)[0][7].values, simulate(oshman, solution, 4)[0][7].values)


def test_missing_and_unplanned_samples_are_used_as_they_are_and_announced(oshman):
    solution = solve(oshman)
    measurements, _ = simulate(oshman, solution, 1)
    kept = [m for m in measurements if m.time not in (10.0, 11.0)]
    estimate = run_filter(oshman, solution, kept)
    assert estimate.notes == ("2 planned samples missing: no update there, the covariance is not the run's",)
    assert np.isnan(estimate.nis[10])
    assert estimate.dimension[10] == 0
    F, Q = oshman.plant.F.at(10.0), oshman.plant.Q.at(10.0)
    assert np.allclose(estimate.covariance[11], F @ estimate.covariance[10] @ F.T + Q, atol=1e-12)
    extra = [*measurements, Measurement(12.0, "one", np.array([0.1, 0.2]))]
    more = run_filter(oshman, solution, extra)
    assert more.dimension[12] == 4
    assert more.standard_deviation[12, 0] < solution.arrays["standard_deviations"][12, 0]
    assert any("1 sample of sensors that were not selected" in note for note in more.notes)


def test_missing_values_of_a_sample_are_left_out_and_announced(oshman):
    """With values lost the filter is a Kalman filter with the other rows of H and R."""
    solution = solve(oshman)
    measurements, _ = simulate(oshman, solution, 1)
    lost = {4: [0], 30: [1], 31: [0, 1]}
    holes = []
    for m in measurements:
        values = m.values.copy()
        values[lost.get(int(m.time), [])] = np.nan
        holes.append(Measurement(m.time, m.sensor, values))
    estimate = run_filter(oshman, solution, holes)
    assert estimate.notes == (
        "1 planned sample missing: no update there, the covariance is not the run's",
        "2 values missing: what else the sensor read is used, the covariance is not the run's",
    )
    x, P = np.zeros(3), 250 * np.eye(3)
    for m in holes[:60]:
        k, sensor = int(m.time), oshman.sensors[oshman.sensors.index(m.sensor)]
        there = [i for i in range(2) if i not in lost.get(k, [])]
        H, R = sensor.H.at(k)[there], sensor.R.at(k)[np.ix_(there, there)]
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        x, P = x + K @ (m.values[there] - H @ x), (np.eye(3) - K @ H) @ P @ (np.eye(3) - K @ H).T + K @ R @ K.T
        assert estimate.mean[k] == pytest.approx(x, rel=1e-9, abs=1e-10)
        assert estimate.covariance[k] == pytest.approx(P, rel=1e-9, abs=1e-12)
        assert estimate.dimension[k] == len(there)
        F = oshman.plant.F.at(k)
        x, P = F @ x, F @ P @ F.T + oshman.plant.Q.at(k)


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        (Measurement(3.0, "one", np.array([1.0, np.inf]), 9), r"line 9: the sample of sensor 'one' is infinite"),
        (Measurement(3.0, "four", np.zeros(2), 9), r"line 9: there is no sensor 'four'"),
        (
            Measurement(3.5, "one", np.zeros(2), 9),
            r"sensor 'one' at t = 3.5 is not at a step\n  hint: the nearest steps are 3 and 4",
        ),
        (
            Measurement(300.0, "one", np.zeros(2), 9),
            r"line 9: .* outside the horizon \[0, 299\]\n  hint: t is 0, 1, \.\. 299",
        ),
        (Measurement(3.0, "one", np.zeros(1), 9), r"line 9: the sample of sensor 'one' has 1 value, it must have 2"),
        (Measurement(3.0, "three", np.zeros(2), 9), r"line 9: sensor 'three' has a second sample at t = 3"),
    ],
)
def test_samples_that_do_not_fit_are_refused_with_their_line(oshman, bad, words):
    solution = solve(oshman)
    measurements, _ = simulate(oshman, solution, 1)
    with pytest.raises(ProblemError, match=words):
        run_filter(oshman, solution, [*measurements, bad])


def movable():
    plant = DiscretePlant([[1.0, 0.1], [-0.1, 0.98]], 0.05 * np.eye(2), np.diag([4.0, 1.0]))
    arm = DiscreteSensor("arm", [["cos(p1)", "sin(p1)"]], 0.3, Region([[0.0, 3.0]]))
    return Problem("movable", plant, [arm, DiscreteSensor("still", [[1.0, 0.3]], 0.4)], 12, 3)


def test_a_movable_sensor_says_where_to_be_and_is_nowhere_when_not_chosen():
    problem = movable()
    loop = OnlineSelector(problem.sampled, problem.starts, 1, FixedChooser((1,)))
    with pytest.raises(UsageError, match="sensor 'arm' was not selected at k = 0, so its location is not known"):
        loop.step({"arm": np.array([1.0])})
    loop = OnlineSelector(problem.sampled, problem.starts, 1, FixedChooser((0,)))
    done = loop.step({"arm": np.array([1.0])})
    assert done.next_sensors == ("arm",)
    assert 0 <= done.next_locations["arm"][0] <= 3
    with pytest.raises(UsageError, match="there is no sensor 'leg'"):
        loop.step({"leg": np.array([1.0])})
    with pytest.raises(UsageError, match="sensor 'arm' has 1 values, 2 came at k = 1"):
        loop.step({"arm": np.array([1.0, 2.0])})


def test_a_recorded_run_with_locations_filters_its_own_data():
    problem = movable()
    solution = solve(problem)
    measurements, _ = simulate(problem, solution, 2)
    estimate = run_filter(problem, solution, measurements)
    assert estimate.standard_deviation == pytest.approx(solution.arrays["standard_deviations"], rel=1e-10)
    assert estimate.notes == ()


def test_an_unstable_direction_that_nobody_measures_is_a_message():
    plant = DiscretePlant(np.diag([2.0, 0.5]), np.eye(2), np.eye(2))
    problem = Problem("unstable", plant, [DiscreteSensor("a", [[0.0, 1.0]], 1.0)], 600, 50)
    with pytest.raises(SolveFailed, match=r"the error covariance overflows at k = 46\d\n  hint: an unstable direction"):
        solve(problem)


def test_the_loop_of_a_problem_follows_any_method(oshman):
    assert online(oshman).sensors == ("three",)
    assert online(oshman, method="fixed:two").sensors == ("two",)
    assert online(oshman, method="round-robin").sensors == ("one",)
    best = online(oshman, method="optimal")
    chosen = []
    while not best.finished:
        chosen.append(best.sensors[0])
        best.step()
    assert chosen[::25] == [e["sensors"][0] for e in solve(oshman, Optimal()).result["schedule"]]
    with pytest.raises(UsageError, match="family vlambda has no method 'best'"):
        online(oshman, method="best")

"""The hybrid family as its users meet it: methods, results, measurement files, refusals."""

from __future__ import annotations

import dataclasses
import pickle

import numpy as np
import pytest

from occontrol.core.errors import ProblemError, UsageError
from occontrol.core.measurement import Measurement
from occontrol.core.monitor import Monitor
from occontrol.core.solution import Status
from occontrol.families.hybrid.family import FAMILY as hybrid
from occontrol.families.hybrid.methods import Alternate, ExpectedCovariance, Fixed, Random, Scheduled
from occontrol.families.hybrid.plant import JumpPlant, Mode
from occontrol.families.hybrid.problem import Problem
from occontrol.families.hybrid.sensor import JumpSensor

NAMED = ("average_rms", "peak_rms", "mode_errors")


def make(**changes) -> Problem:
    modes = [
        Mode("stay", [[1, 0.5], [0, 0.2]], [[0.1]], [[0.5], [1]]),
        Mode("go", [[1, 1], [0, 1]], [[0.1]], [[0.5], [1]], [[0], [1]], ["0.2*cos(k/5)"]),
    ]
    plant = JumpPlant(modes, np.eye(2), transition_matrix=[[0.9, 0.1], [0.2, 0.8]])
    sensors = [JumpSensor("near", [[1, 0]], [[0.5]]), JumpSensor("far", [[0, 1]], [[0.2]])]
    return Problem(
        **{"name": "walker", "plant": plant, "sensors": sensors, "steps": 25, "runs": 20, "position": [0], **changes}
    )


@pytest.mark.parametrize("method", [Scheduled(), ExpectedCovariance(), Fixed(), Fixed("far"), Alternate(), Random()])
def test_every_method_gives_the_named_numbers(method):
    solution = hybrid.solve(make(), method)
    result = solution.result
    assert solution.status is Status.FEASIBLE
    assert solution.method == method.name
    for name in NAMED:
        assert isinstance(result[name], float)
        assert 0 < result[f"{name}_standard_error"] < result[name]
    assert sum(result["use"].values()) == pytest.approx(1)
    assert result["average_rms"] == pytest.approx(np.mean(solution.arrays["rms"]))
    assert result["peak_rms"] == pytest.approx(np.max(solution.arrays["rms"]))
    assert solution.arrays["use"].mean(axis=0) == pytest.approx(list(result["use"].values()))
    again = pickle.loads(pickle.dumps(solution))
    assert again.result == result
    assert hybrid.summarise(make(), solution)
    assert len(solution.schedule.weights) == 25


def test_shares_of_the_baselines():
    assert hybrid.solve(make(), Fixed("far")).result["use"] == {"near": 0.0, "far": 1.0}
    turns = hybrid.solve(make(steps=24), Alternate())
    assert turns.result["use"] == {"near": 0.5, "far": 0.5}
    assert [s["sensors"] for s in turns.result["schedule"][:3]] == [["near"], ["far"], ["near"]]
    assert hybrid.solve(make(steps=400), Random()).result["use"]["near"] == pytest.approx(0.5, abs=0.03)


def test_groups_count_as_one_sensor():
    both = make(groups=[["near"], ["far"], ["near", "far"]])
    result = hybrid.solve(both, Scheduled()).result
    # more values cannot make a wrong mode likelier: the pair is always chosen
    assert result["use"] == {"near": 1.0, "far": 1.0}
    assert result["group_use"] == {"near": 0.0, "far": 0.0, "near+far": 1.0}
    alone = hybrid.solve(both, Fixed("near+far")).result
    assert alone["average_rms"] == result["average_rms"]
    assert alone["average_rms"] < hybrid.solve(both, Fixed("near")).result["average_rms"]


def test_fixed_without_a_name_takes_the_best_and_shows_the_others():
    result = hybrid.solve(make(), Fixed()).result
    values = {c["sensor"]: c["average_rms"] for c in result["candidates"]}
    assert set(values) == {"near", "far"}
    assert result["average_rms"] == min(values.values()) == values[result["sensor"]]


def test_position_weight_moves_from_modes_to_position():
    averages, errors = [], []
    for weight in (0.0, 0.3, 1e6):
        result = hybrid.solve(make(runs=300, position_weight=weight), Scheduled()).result
        averages.append(result["average_rms"])
        errors.append(result["mode_errors"])
    assert averages[0] > averages[2]
    assert errors[0] < errors[2]
    covariance = hybrid.solve(make(runs=300), ExpectedCovariance()).result
    assert averages[2] == pytest.approx(covariance["average_rms"], rel=0.02)


def test_first_scores_do_not_depend_on_chance():
    one, two = (hybrid.solve(make(seed=seed, runs=2), Scheduled()).result["first_scores"] for seed in (1, 2))
    assert one == two
    first = hybrid.solve(make(), Scheduled()).arrays["weights"][0]
    assert one[["near", "far"][int(np.argmax(first))]] == min(one.values())


def test_limit_and_interrupt_keep_the_runs_that_were_done():
    monitor = Monitor(show=lambda record: setattr(monitor, "time_limit", -1.0))  # it passes at the first record
    limited = hybrid.solve(make(runs=400_000), Scheduled(), monitor)
    assert limited.status is Status.LIMIT
    assert limited.result["runs"] == monitor.history[0]["iteration"] < 400_000
    assert limited.message == f"{limited.result['runs']} of 400000 runs before the time limit"
    assert len(monitor.history) == 1
    at_once = hybrid.solve(make(runs=400_000), Scheduled(time_limit=1e-9))
    assert at_once.status is Status.LIMIT and at_once.result["runs"] == 1
    interrupted = hybrid.solve(make(), Scheduled(), Monitor(interrupted=2))
    assert interrupted.status is Status.INTERRUPTED
    assert interrupted.result["runs"] == 1


def test_progress_is_reported():
    monitor = Monitor()
    hybrid.solve(make(runs=300), Scheduled(), monitor)
    assert monitor.history[-1]["iteration"] == 300
    assert monitor.history[-1]["cost"] > 0


def test_measurements_of_a_run_can_be_filtered():
    problem = make()
    solution = hybrid.solve(problem, Scheduled())
    measurements, truth = hybrid.simulate(problem, solution, 4)
    assert [m.time for m in measurements] == list(range(1, 26))
    assert truth.values.shape == (26, 2)
    again, _ = hybrid.simulate(problem, solution, 4)
    assert [m.sensor for m in again] == [m.sensor for m in measurements]
    estimate = hybrid.run_filter(problem, solution, measurements)
    assert estimate.mean.shape == (26, 2)
    error = estimate.mean - truth.values
    assert np.mean(np.abs(error) < 4 * estimate.standard_deviation) > 0.95
    assert any("most probable mode" in note for note in estimate.notes)


@pytest.mark.parametrize(
    ("measurement", "words"),
    [
        (Measurement(1.0, "nowhere", np.array([1.0]), 2), "line 2: there is no sensor 'nowhere'"),
        (
            Measurement(1.5, "near", np.array([1.0]), 3),
            "line 3: the sample of sensor 'near' at t = 1.5 is not at",
        ),
        (Measurement(26.0, "near", np.array([1.0])), r"sensor 'near' at t = 26 lies outside the horizon \[1, 25\]"),
        (Measurement(1.0, "near", np.array([1.0, 2.0])), "sensor 'near' has 2 values, it must have 1"),
    ],
)
def test_measurements_that_do_not_fit(measurement, words):
    problem = make()
    with pytest.raises(ProblemError, match=words):
        hybrid.run_filter(problem, hybrid.solve(problem, Alternate()), [measurement])


def test_missing_values_are_left_out_and_announced():
    """A value that is not there is a row of C and R that is not there, whether alone or with the whole sample."""
    both = JumpSensor("both", [[1, 0], [0, 1]], [[0.5, 0.2], [0.2, 0.3]])
    upper, lower = JumpSensor("both", [[1, 0]], [[0.5]]), JumpSensor("both", [[0, 1]], [[0.3]])
    nan = float("nan")
    read = [[0.4, 0.3], [nan, 0.1], [nan, nan], [0.9, nan]]
    given = [Measurement(k + 1.0, "both", np.array(z), k + 2) for k, z in enumerate(read)]
    estimates = {}
    for name, sensor, kept in (
        ("both", both, given),
        ("whole lines", both, [m for m in given if not np.all(np.isnan(m.values))]),
        ("upper", upper, [Measurement(1.0, "both", np.array([0.4]))]),
        ("lower", lower, [Measurement(1.0, "both", np.array([0.3])), Measurement(2.0, "both", np.array([0.1]))]),
    ):
        problem = make(sensors=[sensor], steps=4)
        estimates[name] = hybrid.run_filter(problem, hybrid.solve(problem, Alternate()), kept)
    found, whole = estimates["both"], estimates["whole lines"]
    assert np.array_equal(found.mean, whole.mean)
    assert list(found.dimension) == [0, 2, 1, 0, 1]
    assert "1 of 4 steps have no measurement: the estimate is predicted there" in found.notes
    assert any("4 values missing" in note for note in found.notes)
    # the same step with the sensor that has only the other row
    for name, rest, k in (("lower", [0.3, 0.1], 2), ("upper", [0.4], 1)):
        problem = make(sensors=[both], steps=4)
        holes = [[nan, z] if name == "lower" else [z, nan] for z in rest]
        filled = [Measurement(i + 1.0, "both", np.array(z)) for i, z in enumerate(holes)]
        partial = hybrid.run_filter(problem, hybrid.solve(problem, Alternate()), filled)
        assert partial.mean[: k + 1] == pytest.approx(estimates[name].mean[: k + 1], abs=1e-14)
        assert partial.covariance[: k + 1] == pytest.approx(estimates[name].covariance[: k + 1], abs=1e-14)


def test_several_wrong_measurements_are_reported_together():
    wrong = [Measurement(0.0, "near", np.ones(1), 2), Measurement(1.0, "nera", np.ones(1), 3)]
    wrong.append(Measurement(2.0, "far", np.array([np.inf]), 4))
    with pytest.raises(ProblemError) as caught:
        hybrid.run_filter(make(), hybrid.solve(make(), Alternate()), wrong)
    assert [m.place for m in caught.value.mistakes] == ["line 2", "line 3", "line 4"]


def test_a_sensor_that_reports_twice_at_a_step():
    problem = make()
    twice = [Measurement(3.0, "near", np.array([1.0]))] * 2
    with pytest.raises(ProblemError, match="sensor 'near' has a second sample at t = 3"):
        hybrid.run_filter(problem, hybrid.solve(problem, Alternate()), twice)


def test_choosing_a_method_by_name():
    problem = make(method=Scheduled(time_limit=9.0))
    assert hybrid.choose(problem, "alternate") == Alternate(time_limit=9.0)
    assert hybrid.choose(problem, "fixed") == Fixed(time_limit=9.0)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"steps": 0}, "steps is 0"),
        ({"runs": 10_000_000, "steps": 1000}, "10000000 runs of 1000 steps are more than"),
        ({"seed": -1}, "seed is -1"),
        ({"position": [2]}, "position names component 2 of the state, it has 2"),
        ({"position": [0, 0]}, "position names component 0 twice"),
        ({"position_weight": float("nan")}, "position_weight is nan"),
        ({"groups": [["near"], ["farr"]]}, "group 2 names the unknown sensor 'farr'"),
        ({"groups": [["near", "near"]]}, "group 1 names the sensor 'near' twice"),
        ({"groups": []}, "groups is empty"),
        ({"truth_mode": "run"}, "the truth begins in the unknown mode 'run'"),
        ({"truth_mean": [0]}, "mean of the truth has 1 entry, it must have 2"),
        ({"truth_covariance": [[1]]}, "covariance of the truth is 1x1, it must be 2x2"),
        ({"sensors": []}, "there is no sensor"),
        ({"sensors": [JumpSensor("s", [[1]], [[1]])]}, "C of sensor 's' is 1x1, but the modes have 2 states"),
        ({"sensors": [JumpSensor("s", [[1, 0]], [["3-k"]])]}, "R of sensor 's' is not positive definite at k = 3"),
        ({"method": Fixed("nera")}, "there is no sensor or group 'nera'"),
    ],
)
def test_refusals(changes, words):
    with pytest.raises(ProblemError) as caught:
        make(**changes)
    assert words in str(caught.value)


def test_several_mistakes_are_reported_together():
    with pytest.raises(ProblemError) as caught:
        make(position=[5], groups=[["x"]], truth_mode="run", position_weight=-1.0)
    assert len(caught.value.mistakes) == 4


def test_one_mode_and_one_sensor_are_an_ordinary_filter():
    problem = make()
    plant = JumpPlant([problem.plant.modes[0]], np.eye(2), transition_matrix=[[1]])
    single = dataclasses.replace(problem, plant=plant, sensors=[problem.sensors[0]], groups=None)
    solution = hybrid.solve(single)
    assert solution.result["mode_errors"] == 0
    P = np.eye(2)
    A, Q, C = plant.modes[0].A.at(1), np.array([[0.025, 0.05], [0.05, 0.1]]), np.array([[1.0, 0]])
    for k in range(1, 26):
        P = A @ P @ A.T + Q
        K = P @ C.T / (C @ P @ C.T + 0.5)
        P = P - K @ C @ P
        assert solution.arrays["covariance"][k] == pytest.approx(P, abs=1e-12)


def test_a_group_is_named_in_any_order_or_as_a_list():
    groups = [["near", "far"], ["far"]]
    problem = make(groups=groups)
    expected = hybrid.solve(problem, Fixed("near+far")).result
    for name in ("far+near", ["far", "near"], ["near", "far"]):
        made = make(groups=groups, method=Fixed(name))
        assert hybrid.solve(made).result["average_rms"] == expected["average_rms"]
    assert hybrid.solve(make(groups=groups, method=Fixed(["far"]))).result["use"] == {"near": 0.0, "far": 1.0}
    with pytest.raises(ProblemError, match=r"there is no sensor or group 'near\+nowhere'"):
        make(groups=groups, method=Fixed("near+nowhere"))
    with pytest.raises(ProblemError, match=r"there is no sensor or group 'near\+far'"):
        make(method=Fixed(["near", "far"]))


def test_fixed_groups_are_methods_of_their_own():
    problem = make()
    names = hybrid.compare_names(problem)
    assert names == ["scheduled", "expected-covariance", "alternate", "random", "fixed:near", "fixed:far"]
    assert hybrid.choose(problem, "fixed:far") == Fixed("far")
    with pytest.raises(UsageError, match="method fixed:fra: there is no sensor or group 'fra'"):
        hybrid.choose(problem, "fixed:fra")
    many = make(sensors=[JumpSensor(str(j), [[1, 0]], [[0.5]]) for j in range(9)])
    assert hybrid.compare_names(many)[-1] == "fixed"

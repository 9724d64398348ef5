"""Methods as values: wrong options and foreign methods are refused by name; results are data with keys in order."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from occontrol.core.errors import ProblemError, UsageError
from occontrol.core.method import Method
from occontrol.core.monitor import Monitor
from occontrol.core.solution import Status
from occontrol.families.family import Ability
from occontrol.families.hybrid.chooser import at_random, in_turn
from occontrol.families.hybrid.family import FAMILY
from occontrol.families.hybrid.guard import Guard
from occontrol.families.hybrid.methods import Alternate, ExpectedCovariance, Fixed, Random, Scheduled
from occontrol.families.hybrid.plant import JumpPlant, Mode
from occontrol.families.hybrid.problem import Problem
from occontrol.families.hybrid.result import Candidate, HybridResult, numbers_of
from occontrol.families.hybrid.sensor import JumpSensor
from occontrol.files.plain_json import to_json

MODES = [Mode("stay", [[1, 0.5], [0, 0.2]], 0.1 * np.eye(2)), Mode("go", [[1, 1], [0, 1]], 0.1 * np.eye(2))]


def make(**changes) -> Problem:
    plant = JumpPlant(MODES, np.eye(2), transition_matrix=[[0.9, 0.1], [0.2, 0.8]])
    sensors = [JumpSensor("near", [[1, 0]], [[0.5]]), JumpSensor("far", [[0, 1]], [[0.2]])]
    return Problem(**{"name": "walker", "plant": plant, "sensors": sensors, "steps": 12, "runs": 6, **changes})


def guarded() -> Problem:
    guards = [Guard("stay", "go", [[1.0, 0.0]], [0.0]), Guard("go", "stay", [[-1.0, 0.0]], [0.0])]
    return make(plant=JumpPlant(MODES, np.eye(2), guards=guards))


@pytest.mark.parametrize("name", FAMILY.methods)
def test_every_method_is_one_by_contract_and_its_measurements_are_those_of_the_run(name):
    problem, method = make(), FAMILY.methods[name]()
    assert isinstance(method, Method)
    assert list(method.check(problem)) == []
    solution = FAMILY.solve(problem, method)
    assert solution.method == name
    # run 1 of a solution has the problem's seed, and so has this simulation: the same choices from the same data
    measurements, truth = FAMILY.simulate(problem, solution, problem.seed)
    used = [solution.schedule.names[int(np.argmax(row))] for row in solution.schedule.weights]
    assert [m.sensor for m in measurements] == used
    assert np.array_equal(truth.values, solution.arrays["truth"])
    estimate = FAMILY.run_filter(problem, solution, measurements)
    assert estimate.mean == pytest.approx(solution.arrays["estimate"], rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("kind", [Scheduled, ExpectedCovariance, Alternate, Random, Fixed])
@pytest.mark.parametrize("limit", [0, -3.0, float("nan"), float("inf"), "1"])
def test_a_time_limit_that_is_none_is_refused_when_the_method_is_made(kind, limit):
    with pytest.raises(ProblemError, match=f"time_limit of method {kind.name} is {limit!r}"):
        kind(time_limit=limit)


@pytest.mark.parametrize(
    ("sensor", "words"), [(3, "sensor of method fixed is 3"), ([1], r"sensor of method fixed is \[1\]")]
)
def test_a_sensor_that_is_no_name_is_refused_when_the_method_is_made(sensor, words):
    with pytest.raises(ProblemError, match=words):
        Fixed(sensor)


def test_a_fixed_sensor_that_does_not_fit_the_problem_is_refused_wherever_it_comes_from():
    words = "method.sensor: there is no sensor or group 'fra'\n  hint: did you mean 'far'?"
    for attempt in (lambda: make(method=Fixed("fra")), lambda: FAMILY.solve(make(), Fixed("fra"))):
        with pytest.raises(ProblemError) as caught:
            attempt()
        assert str(caught.value) == words


@dataclasses.dataclass(frozen=True)
class Foreign:
    name = "random"
    time_limit = None

    def check(self, problem):
        return ()

    def run(self, problem, monitor):
        raise AssertionError("must never run")


@pytest.mark.parametrize("foreign", [Foreign(), 7, Scheduled])
def test_a_method_of_another_family_is_refused(foreign):
    with pytest.raises(UsageError, match="is not a method of family hybrid"):
        FAMILY.solve(make(), foreign)
    with pytest.raises(ProblemError, match=r"method: .* is not a method of family hybrid"):
        make(method=foreign)


def test_what_the_family_declares_it_can_and_the_rest_it_refuses():
    can = {Ability.SIMULATE, Ability.FILTER, Ability.COMPARE, Ability.MONTE_CARLO, Ability.CLOSED_LOOP}
    assert can == FAMILY.abilities
    for attempt, words in (
        (lambda: FAMILY.certify(make(), None), "certify schedules"),
        (lambda: FAMILY.online(make()), "run on line"),
        (lambda: FAMILY.tradeoff(make(), [1.0], None), "trade observation cost against prediction error"),
    ):
        with pytest.raises(UsageError, match=f"family hybrid cannot {words}"):
            attempt()


def test_choosers_of_groups():
    luck = np.array([[0.0, 0.34, 0.99999, 0.66]])
    assert in_turn(luck, 3).tolist() == [[0, 1, 2, 0]]
    assert at_random(luck, 3).tolist() == [[0, 1, 2, 1]]
    assert at_random(np.array([[1.0]]), 3).tolist() == [[2]]  # rounding never leads to a group that is not there


KEYS = ["average_rms", "peak_rms", "mode_errors", "average_nees"]
KEYS = [key for name in KEYS for key in (name, f"{name}_standard_error")]
KEYS += ["use", "group_use", "runs", "states", "first_scores", "schedule"]


@pytest.mark.parametrize("method", [Scheduled(), Random(), Fixed("far"), Fixed()])
@pytest.mark.parametrize("problem", [make(), guarded()], ids=["Markov", "guards"])
def test_result_keys_keep_their_order_and_come_back_from_a_file(problem, method):
    solution = FAMILY.solve(problem, method)
    numbers = solution.numbers
    assert isinstance(numbers, HybridResult)
    fixed = isinstance(method, Fixed)
    more = ["sensor"] * fixed + ["guard_excess", "guard_error"] * (problem.plant.guards is not None)
    more += ["candidates"] * (method == Fixed())
    assert list(numbers.as_dict()) == [*KEYS, *more]
    assert dict(solution.result) == numbers.as_dict()
    again = HybridResult.from_dict(json.loads(to_json(dict(solution.result))))
    assert again == numbers
    assert numbers_of(dataclasses.replace(solution, numbers=again)) == numbers
    if method == Fixed():
        assert all(isinstance(candidate, Candidate) for candidate in again.candidates)
        order = ["sensor", "average_rms", "average_rms_standard_error", "mode_errors", "mode_errors_standard_error"]
        assert list(solution.result["candidates"][0]) == order
        assert dict(FAMILY.summarise(problem, solution))["only near"].startswith("average RMS ")


def test_after_a_single_run_there_is_no_standard_error_in_words_either():
    solution = FAMILY.solve(make(runs=1), Fixed())
    back = dataclasses.replace(solution, numbers=HybridResult.from_dict(json.loads(to_json(dict(solution.result)))))
    assert numbers_of(back).average_rms_standard_error is None
    for known in (solution, back):
        lines = dict(FAMILY.summarise(make(runs=1), known))
        assert "±" not in "".join(lines.values())
        assert set(FAMILY.figures(make(runs=1), known)) == {"overview", "trajectory", "rms", "modes", "sensors"}


def test_a_limit_of_the_method_holds_for_the_method_only():
    monitor = Monitor()
    limited = FAMILY.solve(make(runs=400_000), Scheduled(time_limit=1e-9), monitor)
    assert limited.status is Status.LIMIT and numbers_of(limited).runs == 1
    assert limited.history == () and not monitor.history  # it passed before the first record
    assert monitor.time_limit is None
    whole = FAMILY.solve(make(runs=300), Alternate(), monitor)
    assert whole.status is Status.FEASIBLE
    assert numbers_of(whole).runs == 300
    # the history of a solution is its last record, the monitor has all; how many there are is a matter of time
    timeless = [{key: value for key, value in record.items() if key != "seconds"} for record in monitor.history]
    (last,) = whole.history
    assert {key: value for key, value in last.items() if key != "seconds"} == timeless[-1]


def test_the_limit_of_fixed_is_one_for_each_group():
    solution = FAMILY.solve(make(runs=400_000, steps=25), Fixed(time_limit=1e-9))
    assert solution.status is Status.LIMIT and numbers_of(solution).runs == 1
    assert solution.message.startswith(f"{numbers_of(solution).sensor} is the best of 2 in average RMS; ")


def test_the_readme_names_every_file_of_the_family():
    folder = Path(__file__).parents[3] / "occontrol" / "families" / FAMILY.name
    text = (folder / "README.md").read_text(encoding="utf-8")
    assert [p.name for p in folder.glob("*.py") if p.name != "__init__.py" and f"`{p.name}`" not in text] == []

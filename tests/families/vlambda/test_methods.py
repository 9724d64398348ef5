"""Methods as values: wrong options and foreign methods are refused by name, every method runs and leads a loop."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from occontrol.core.errors import ProblemError, UsageError
from occontrol.core.method import Method
from occontrol.core.plant import DiscretePlant
from occontrol.core.solution import Status
from occontrol.families.family import Ability
from occontrol.families.vlambda.family import FAMILY
from occontrol.families.vlambda.methods import Eigenspace, Fixed, Lookahead, Optimal, Random, RoundRobin, Trace
from occontrol.families.vlambda.problem import Problem
from occontrol.families.vlambda.result import EpochEntry, SelectionResult, numbers_of
from occontrol.families.vlambda.sensor import DiscreteSensor, Region
from occontrol.files.plain_json import to_json


def make(**changes) -> Problem:
    plant = DiscretePlant([[1.0, 0.1], [-0.1, 0.98]], 0.05 * np.eye(2), np.diag([4.0, 1.0]))
    sensors = [DiscreteSensor("a", [[1.0, 0.0]], 0.3), DiscreteSensor("b", [[0.2, 1.0]], 0.4)]
    return Problem(**{"name": "small", "plant": plant, "sensors": sensors, "steps": 9, "epoch": 3, **changes})


def movable() -> Problem:
    arm = DiscreteSensor("arm", [["cos(p1)", "sin(p1)"]], [["0.3+0.1*p1"]], Region([[0.0, 3.0]]))
    return make(sensors=[arm, DiscreteSensor("still", [[1.0, 0.3]], 0.4)])


@pytest.mark.parametrize("name", FAMILY.methods)
def test_every_method_is_one_by_contract_and_leads_a_loop_as_it_leads_the_run(name):
    method = FAMILY.methods[name]()
    assert isinstance(method, Method)
    for problem in (make(), movable()):
        assert list(method.check(problem)) == []
        solution = FAMILY.solve(problem, method)
        assert solution.method == name
        loop = FAMILY.online(problem, method=method)
        again = FAMILY.online(problem, solution)
        for k in range(problem.steps):
            entry = numbers_of(solution).schedule[k // 3]
            assert list(loop.sensors) == list(again.sensors) == entry.sensors
            places = {problem.sensors.names[j]: p.tolist() for j, p in loop.choice.locations.items()}
            assert places == (entry.locations or {})
            loop.step()
            again.step()
    with pytest.raises(UsageError, match="a solution or a method, not both"):
        FAMILY.online(problem, solution, method)


@pytest.mark.parametrize(
    ("make_method", "words"),
    [
        (lambda: Eigenspace(tolerance=-1e-9), "tolerance of method eigenspace is -1e-09"),
        (lambda: Eigenspace(tolerance=1.0), "tolerance of method eigenspace is 1.0"),
        (lambda: Eigenspace(tolerance=float("nan")), "tolerance of method eigenspace is nan"),
        (lambda: Random(seed=-1), "seed of method random is -1"),
        (lambda: Random(seed=0.5), "seed of method random is 0.5"),
        (lambda: Lookahead(depth=0), "depth of method lookahead is 0"),
        (lambda: Lookahead(depth=True), "depth of method lookahead is True"),
        (lambda: Lookahead(grid=1), "grid of method lookahead is 1"),
        (lambda: Lookahead(grid=1001), "grid of method lookahead is 1001"),
        (lambda: Optimal(grid=1), "grid of method optimal is 1"),
        (lambda: Optimal(max_nodes=0), "max_nodes of method optimal is 0"),
        (lambda: Optimal(width=0), "width of method optimal is 0"),
        (lambda: Optimal(time_limit=0.0), "time_limit of method optimal is 0.0"),
        (lambda: Optimal(time_limit=float("inf")), "time_limit of method optimal is inf"),
        (lambda: Fixed(3), "sensor of method fixed is 3"),
        (lambda: Fixed([1, 2]), r"sensor of method fixed is \[1, 2\]"),
    ],
)
def test_options_that_fit_no_problem_are_refused_when_the_method_is_made(make_method, words):
    with pytest.raises(ProblemError, match=words):
        make_method()


def test_several_wrong_options_are_named_together():
    with pytest.raises(ProblemError) as caught:
        Optimal(max_nodes=0, width=-1)
    assert [m.path for m in caught.value.mistakes] == [("max_nodes",), ("width",)]


def test_options_without_a_limit_are_taken():
    assert Optimal(time_limit=None).time_limit is None
    assert Random(np.int64(4)).seed == 4
    assert Fixed(("a", "b")).names == ["a", "b"]


@pytest.mark.parametrize(
    ("sensor", "words"),
    [
        ("nowhere", "method.sensor: there is no sensor 'nowhere'"),
        (["a", "b"], "method.sensor: 2 sensors are named, select is 1"),
        ([], "method.sensor: 0 sensors are named, select is 1"),
    ],
)
def test_a_fixed_sensor_that_does_not_fit_the_problem_is_refused_wherever_it_comes_from(sensor, words):
    for attempt in (
        lambda: make(method=Fixed(sensor)),
        lambda: FAMILY.solve(make(), Fixed(sensor)),
        lambda: FAMILY.online(make(), method=Fixed(sensor)),
    ):
        with pytest.raises(ProblemError, match=words):
            attempt()


def test_a_sensor_named_twice():
    with pytest.raises(ProblemError, match="a sensor is named twice"):
        make(select=2, method=Fixed(["a", "a"]))


@dataclasses.dataclass(frozen=True)
class Foreign:
    name = "round-robin"

    def check(self, problem):
        return ()

    def run(self, problem, monitor):
        raise AssertionError("must never run")


@pytest.mark.parametrize("foreign", [Foreign(), 7, Eigenspace])
def test_a_method_of_another_family_is_refused(foreign):
    with pytest.raises(UsageError, match="is not a method of family vlambda"):
        FAMILY.solve(make(), foreign)
    with pytest.raises(UsageError, match="is not a method of family vlambda"):
        FAMILY.online(make(), method=foreign)
    with pytest.raises(ProblemError, match=r"method: .* is not a method of family vlambda"):
        make(method=foreign)


def test_what_the_family_declares_it_can_and_the_rest_it_refuses():
    assert FAMILY.abilities == set(Ability) - {Ability.TRADEOFF, Ability.MONTE_CARLO, Ability.SENSITIVITY}
    with pytest.raises(UsageError, match="family vlambda cannot trade observation cost against prediction error"):
        FAMILY.tradeoff(make(), [1.0], None)


def test_the_compared_methods_are_all_of_them_and_few_fixed_choices_stand_by_themselves():
    names = ["eigenspace", "fixed:a", "fixed:b", "round-robin", "random", "trace", "lookahead", "optimal"]
    assert FAMILY.compare_names(make()) == names
    many = make(sensors=[DiscreteSensor(str(j), [[1.0, j]], 0.3) for j in range(13)])
    assert FAMILY.compare_names(many) == list(FAMILY.methods)


KEYS = ["cost", "criterion", "schedule", "sum_trace", "sum_largest_eigenvalue", "peak_largest_eigenvalue"]
KEYS += ["standard_deviations", "switches", "notes"]
PROOF = ["lower_bound", "nodes", "log10_sequences", "candidates", "relative_gap"]


@pytest.mark.parametrize("method", [Eigenspace(), Trace(), RoundRobin(), Optimal()])
@pytest.mark.parametrize("problem", [make(), movable()], ids=["fixed places", "movable"])
def test_result_keys_keep_their_order_and_come_back_from_a_file(problem, method):
    solution = FAMILY.solve(problem, method)
    numbers = solution.numbers
    assert isinstance(numbers, SelectionResult)
    proof = PROOF if method == Optimal() else []
    if proof and problem.movable:
        proof = [*PROOF[:-1], "bound_holds_for", "relative_gap"]
    assert list(numbers.as_dict()) == [*KEYS, *proof]
    assert dict(solution.result) == numbers.as_dict()
    for entry in numbers.schedule:
        located = ["locations"] if entry.location is not None else []
        assert list(entry.as_dict()) == ["epoch", "k", "sensors", "scores", "location", *located]
    again = SelectionResult.from_dict(json.loads(to_json(dict(solution.result))))
    assert again == numbers
    assert all(isinstance(entry, EpochEntry) for entry in again.schedule)
    assert numbers_of(dataclasses.replace(solution, numbers=again)) == numbers
    certified = FAMILY.certify(problem, solution.schedule, FAMILY.claims_of(problem, solution))
    assert certified.cost == pytest.approx(solution.cost, rel=1e-12)
    assert certified.status is (Status.FEASIBLE if problem.movable else Status.CERTIFIED)  # every rule finds the best
    assert list(certified.result) == [*KEYS, *([] if problem.movable else ["lower_bound", "nodes", "relative_gap"])]


def test_the_readme_names_every_file_of_the_family():
    folder = Path(__file__).parents[3] / "occontrol" / "families" / FAMILY.name
    text = (folder / "README.md").read_text(encoding="utf-8")
    assert [p.name for p in folder.glob("*.py") if p.name != "__init__.py" and f"`{p.name}`" not in text] == []

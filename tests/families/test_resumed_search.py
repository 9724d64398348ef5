"""A search that goes on from an earlier solution is never worse, and believes nothing it can see to be wrong."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

import occontrol
from occontrol.cli import run
from occontrol.core.monitor import Monitor
from occontrol.core.plant import DiscretePlant
from occontrol.core.sensor import Sensor
from occontrol.core.solution import Certificate, Solution, Status
from occontrol.families.robust.methods import Optimal as RobustOptimal
from occontrol.families.robust.plant import UncertainPlant
from occontrol.families.robust.problem import Problem as RobustProblem
from occontrol.families.vlambda.methods import Optimal
from occontrol.families.vlambda.problem import Problem
from occontrol.families.vlambda.sensor import DiscreteSensor, Region

HARSH = Optimal(max_nodes=1, width=1, time_limit=None)  # stops before anything is proven
FULL = Optimal(time_limit=None)


def selection(steps: int = 24, **changes) -> Problem:
    plant = DiscretePlant([[1.0, 0.3], [-0.2, 1.02]], 0.3 * np.eye(2), np.diag([40.0, 10.0]))
    sensors = [
        DiscreteSensor("a", [[1.0, 0.0]], 0.3), DiscreteSensor("b", [[0.2, 1.0]], 0.4),
        DiscreteSensor("c", [[1, 1]], 0.6)
    ]  # fmt: skip
    return Problem(**{"name": "s", "plant": plant, "sensors": sensors, "steps": steps, "epoch": 2, **changes})


def switching(slots: int = 6) -> RobustProblem:
    plant = UncertainPlant([[0, 1], [-1, -0.4]], [[0], [1]], [[0.5, 0.2]], np.diag([2.0, 1.0]))
    sensors = [Sensor("one", [[1, 0]], [[1]]), Sensor("two", [[0, 1]], [[1]])]
    return RobustProblem(name="osc", plant=plant, sensors=sensors, edges=np.linspace(0, 2, slots + 1))


def bound_of(solution: Solution) -> float:
    """What the result states, with a certificate or without."""
    return float(solution.result["lower_bound"])


def go_on(problem, method, earlier: Solution) -> tuple[Solution, Monitor]:
    """The solution that goes on from `earlier`, and its monitor."""
    monitor = Monitor(resume=earlier)
    return occontrol.solve(problem, method, monitor), monitor


def interrupted() -> Monitor:
    """A monitor that says stop from the first moment on."""
    return Monitor(interrupted=2)


def stated(earlier: Solution, **numbers) -> Solution:
    """A solution that states other numbers than its own."""
    found = dataclasses.replace(earlier.numbers, **numbers)
    certificate = Certificate(found.cost, found.lower_bound)
    return dataclasses.replace(earlier, numbers=found, certificate=certificate)


def test_a_selection_keeps_cost_and_bound_of_what_it_goes_on_from() -> None:
    problem = selection()
    best, poor = occontrol.solve(problem, FULL), occontrol.solve(problem, HARSH)
    assert best.status is Status.CERTIFIED and poor.status is Status.LIMIT
    assert bound_of(poor) < bound_of(best) * (1 - 1e-6), "nothing is left to prove, the test says nothing"
    again, monitor = go_on(problem, HARSH, best)
    assert monitor.resumed and again.status is Status.LIMIT
    assert again.cost <= best.cost * (1 + 1e-12) and bound_of(again) >= bound_of(best) * (1 - 1e-12)
    assert "the bound is that of the result that this one goes on from" in again.message
    finished, _ = go_on(problem, FULL, poor)
    assert finished.status is Status.CERTIFIED and finished.cost == pytest.approx(best.cost, rel=1e-10)
    assert "goes on from" not in finished.message


def test_a_better_schedule_of_any_method_is_where_the_search_begins() -> None:
    problem = selection()
    eigenspace = occontrol.solve(problem, "eigenspace")
    best = occontrol.solve(problem, FULL)
    assert best.cost < eigenspace.cost * (1 - 1e-6)
    choices = dataclasses.replace(best, method="somebody's")  # whose bound is nobody's
    again, monitor = go_on(problem, HARSH, choices)
    assert monitor.resumed and again.cost <= best.cost * (1 + 1e-12)
    assert bound_of(again) < bound_of(best) * (1 - 1e-6)


@pytest.mark.parametrize("kind", ["bound above its cost", "cost of nobody", "bound that a sequence refutes"])
def test_a_bound_that_can_be_seen_to_be_wrong_is_not_taken_over(kind: str) -> None:
    problem = selection()
    best, poor = occontrol.solve(problem, FULL), occontrol.solve(problem, HARSH)
    if kind == "bound that a sequence refutes":
        fixed = occontrol.solve(problem, "fixed:a")
        assert fixed.cost > 1.01 * best.cost
        liar = dataclasses.replace(fixed, method="optimal", numbers=dataclasses.replace(
            fixed.numbers, lower_bound=fixed.cost))  # fmt: skip
    elif kind == "cost of nobody":
        liar = stated(best, cost=1.1 * best.cost)
    else:
        liar = stated(best, lower_bound=1.1 * best.cost)
    again, _ = go_on(problem, HARSH, liar)
    assert bound_of(again) <= best.cost * (1 + 1e-9) and "goes on from" not in again.message
    assert bound_of(again) == pytest.approx(bound_of(poor), rel=0.3)


def test_movable_sensors_stand_where_they_stood() -> None:
    arm = DiscreteSensor("arm", [["cos(p1)", "sin(p1)"]], [["0.3+0.1*p1"]], Region([[0.0, 3.0]]))
    problem = selection(6, sensors=[arm, DiscreteSensor("still", [[1.0, 0.3]], 0.4)])
    best = occontrol.solve(problem, Optimal(time_limit=None, grid=4))
    again, monitor = go_on(problem, dataclasses.replace(HARSH, grid=4), best)
    assert monitor.resumed and again.cost <= best.cost * (1 + 1e-12)
    assert bound_of(again) >= bound_of(best) * (1 - 1e-12)
    coarser, monitor = go_on(problem, dataclasses.replace(HARSH, grid=3), best)
    # a bound over other locations is none of this search
    assert monitor.resumed and "goes on from" not in coarser.message and coarser.cost <= best.cost * (1 + 1e-12)
    entry = dataclasses.replace(best.numbers.schedule[0], sensors=["arm"], locations={"arm": [3.5]})
    outside = dataclasses.replace(best.numbers, schedule=[entry, *best.numbers.schedule[1:]])
    _, monitor = go_on(problem, HARSH, dataclasses.replace(best, numbers=outside))
    assert not monitor.resumed


def test_choices_of_another_problem_are_left_alone() -> None:
    problem = selection()
    for other in (selection(20), selection(select=2), selection(sensors=[DiscreteSensor("z", [[1, 0]], 1.0)])):
        _, monitor = go_on(problem, HARSH, occontrol.solve(other, "eigenspace"))
        assert not monitor.resumed
    assert not go_on(problem, HARSH, occontrol.solve(switching(), RobustOptimal()))[1].resumed
    assert not go_on(switching(), RobustOptimal(), occontrol.solve(problem, HARSH))[1].resumed
    assert not go_on(switching(), RobustOptimal(), occontrol.solve(switching(5), RobustOptimal()))[1].resumed
    assert not go_on(switching(), RobustOptimal(), occontrol.solve(switching(), "relaxed"))[1].resumed


def test_a_switching_sequence_keeps_cost_and_bound_of_what_it_goes_on_from() -> None:
    problem = switching(8)
    best = occontrol.solve(problem, RobustOptimal(relative_gap=1e-9))
    assert best.status is Status.CERTIFIED
    monitor = interrupted()
    monitor.resume = best
    again = occontrol.solve(problem, RobustOptimal(), monitor)
    assert monitor.resumed and again.status is Status.INTERRUPTED
    assert again.cost <= best.cost * (1 + 1e-12) and bound_of(again) >= bound_of(best) * (1 - 1e-12)
    poor = occontrol.solve(problem, RobustOptimal(), interrupted())
    assert bound_of(poor) < bound_of(best) * (1 - 1e-6), "nothing is left to prove, the test says nothing"
    finished, monitor = go_on(problem, RobustOptimal(relative_gap=1e-9), poor)
    assert monitor.resumed and finished.cost == pytest.approx(best.cost, rel=1e-10)
    for liar in (stated(best, lower_bound=1.1 * best.cost), stated(best, cost=1.1 * best.cost)):
        monitor = interrupted()
        monitor.resume = liar
        assert bound_of(occontrol.solve(problem, RobustOptimal(), monitor)) <= bound_of(poor) * (1 + 1e-9)


@pytest.mark.parametrize(
    ("name", "words"),
    [("hybrid", "a result holds the averages over its runs"), ("precision", "an interior-point method starts well")],
)
def test_families_that_begin_anew_say_why(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, words: str
) -> None:
    path = tmp_path / "p.yaml"
    assert run(["init", name, str(path)]) == 0
    path.write_text(path.read_text().replace("runs: 100", "runs: 2"))
    capsys.readouterr()
    run(["solve", str(path), "--out", str(tmp_path / "run"), "--no-figures", "--resume"])
    assert f"family {name} begins anew: {words}" in capsys.readouterr().err

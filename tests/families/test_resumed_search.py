"""A search that goes on from an earlier solution never costs more, and believes no number of it."""

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


def test_a_selection_keeps_the_cost_of_what_it_goes_on_from_and_proves_its_own_bound() -> None:
    problem = selection()
    best, poor = occontrol.solve(problem, FULL), occontrol.solve(problem, HARSH)
    assert best.status is Status.CERTIFIED and poor.status is Status.LIMIT
    assert bound_of(poor) < bound_of(best) * (1 - 1e-6), "nothing is left to prove, the test says nothing"
    again, monitor = go_on(problem, HARSH, best)
    assert monitor.resumed and again.status is Status.LIMIT
    assert again.cost <= best.cost * (1 + 1e-12) and bound_of(again) < bound_of(best) * (1 - 1e-6)
    finished, _ = go_on(problem, FULL, poor)
    assert finished.status is Status.CERTIFIED and finished.cost == pytest.approx(best.cost, rel=1e-10)


def test_a_better_schedule_of_any_method_is_where_the_search_begins() -> None:
    problem = selection()
    eigenspace = occontrol.solve(problem, "eigenspace")
    best = occontrol.solve(problem, FULL)
    assert best.cost < eigenspace.cost * (1 - 1e-6)
    again, monitor = go_on(problem, HARSH, dataclasses.replace(best, method="somebody's"))
    assert monitor.resumed and again.cost <= best.cost * (1 + 1e-12)


@pytest.mark.parametrize("stops", [True, False])
def test_no_number_of_a_forged_selection_is_taken_over(stops: bool) -> None:
    problem = selection()
    best, fixed = occontrol.solve(problem, FULL), occontrol.solve(problem, "fixed:a")
    assert fixed.cost > 1.01 * best.cost
    honest, _ = go_on(problem, HARSH if stops else FULL, fixed)
    poor = dataclasses.replace(fixed, method="optimal")
    between = (best.cost + fixed.cost) / 2
    # bounds that the forger's own schedule does not refute, and costs that would cut every other schedule off
    for numbers in (
        {"cost": fixed.cost, "lower_bound": fixed.cost},
        {"cost": fixed.cost, "lower_bound": between},
        {"cost": 0.5 * best.cost, "lower_bound": 0.5 * best.cost},
        {"cost": 2 * fixed.cost, "lower_bound": 2 * fixed.cost},
    ):
        again, monitor = go_on(problem, HARSH if stops else FULL, stated(poor, **numbers))
        assert monitor.resumed
        assert (again.cost, bound_of(again), again.status) == (honest.cost, bound_of(honest), honest.status)


def test_movable_sensors_stand_where_they_stood() -> None:
    arm = DiscreteSensor("arm", [["cos(p1)", "sin(p1)"]], [["0.3+0.1*p1"]], Region([[0.0, 3.0]]))
    problem = selection(6, sensors=[arm, DiscreteSensor("still", [[1.0, 0.3]], 0.4)])
    best = occontrol.solve(problem, Optimal(time_limit=None, grid=4))
    again, monitor = go_on(problem, dataclasses.replace(HARSH, grid=4), best)
    assert monitor.resumed and again.cost <= best.cost * (1 + 1e-12)
    coarser, monitor = go_on(problem, dataclasses.replace(HARSH, grid=3), best)
    assert monitor.resumed and coarser.cost <= best.cost * (1 + 1e-12)
    assert "the bound holds for a grid of 3 locations a coordinate" in coarser.message
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


def test_a_switching_sequence_keeps_the_cost_of_what_it_goes_on_from_and_proves_its_own_bound() -> None:
    problem = switching(8)
    best = occontrol.solve(problem, RobustOptimal(relative_gap=1e-9))
    assert best.status is Status.CERTIFIED
    poor = occontrol.solve(problem, RobustOptimal(), interrupted())
    assert bound_of(poor) < bound_of(best) * (1 - 1e-6), "nothing is left to prove, the test says nothing"
    worse = occontrol.solve(problem, "random")
    assert worse.cost > best.cost * (1 + 1e-3)
    worse = dataclasses.replace(worse, method="optimal")
    for earlier in (
        best,
        stated(best, lower_bound=1.1 * best.cost),
        stated(best, cost=1.1 * best.cost),
        stated(worse, lower_bound=worse.cost),  # which its own sequence does not refute
        stated(worse, lower_bound=(worse.cost + best.cost) / 2),
        stated(worse, cost=0.5 * best.cost, lower_bound=0.5 * best.cost),
    ):
        monitor = interrupted()
        monitor.resume = earlier
        again = occontrol.solve(problem, RobustOptimal(), monitor)
        assert monitor.resumed and again.status is Status.INTERRUPTED
        assert bound_of(again) <= bound_of(poor) * (1 + 1e-9)
        assert again.cost <= (best if earlier.numbers.sequence == best.numbers.sequence else poor).cost * (1 + 1e-12)
    finished, monitor = go_on(problem, RobustOptimal(relative_gap=1e-9), stated(worse, lower_bound=worse.cost))
    assert monitor.resumed and finished.cost == pytest.approx(best.cost, rel=1e-10)
    assert bound_of(finished) == pytest.approx(bound_of(best), rel=1e-9)


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

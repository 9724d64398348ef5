"""A resumed solve begins at the policy of the earlier one, and only where that is a policy of its problem."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

import occontrol
from occontrol.cli import run
from occontrol.core.monitor import Monitor
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Solution
from occontrol.families.athans.integration.resume import earlier_policy
from occontrol.files.run_choice import problem_digest


def resumed(earlier: Solution | None) -> Monitor:
    """A monitor that brings an earlier solution."""
    return Monitor(resume=earlier)


def test_going_on_takes_fewer_steps_and_ends_at_the_same_cost(small_solution: Solution) -> None:
    problem = small_solution.problem
    anew, monitor = occontrol.solve(problem), resumed(small_solution)
    again = occontrol.solve(problem, monitor=monitor)
    assert monitor.resumed and again.iterations < anew.iterations
    assert again.cost == pytest.approx(anew.cost, rel=2e-4) and again.status == anew.status


def test_the_mean_of_an_interval_that_the_earlier_solve_had_cut(small_solution: Solution) -> None:
    problem, schedule = small_solution.problem, small_solution.schedule
    cut = problem.edges[3] + 0.25 * problem.steps[3]
    edges, weights = np.insert(problem.edges, 4, cut), np.insert(schedule.weights, 3, 0.0, axis=0)
    weights[3], weights[4] = np.eye(3)[2], np.eye(3)[1]
    cut_there = dataclasses.replace(small_solution, arrays={}, schedule=Schedule(edges, weights, schedule.names))
    monitor = resumed(cut_there)
    found = earlier_policy(problem, monitor)
    assert monitor.resumed and found is not None and found.shape == problem.upper.shape
    assert found[3] == pytest.approx([0.0, 0.75, 0.25], abs=1e-12)
    np.testing.assert_array_equal(np.delete(found, 3, axis=0), np.delete(schedule.weights, 3, axis=0))


def spoilt(solution: Solution, kind: str) -> Solution:
    """The solution with a policy that is none of its problem."""
    weights, edges = np.array(solution.schedule.weights), np.array(solution.schedule.edges)
    if kind == "closed":
        closed = int(np.argmax(solution.problem.upper[:, 0] == 0))
        weights[closed] = [1.0, 0.0, 0.0]
    elif kind == "unfilled":
        weights[0] = 0.0
    elif kind == "nan":
        weights[0, 0] = np.nan
    elif kind == "shape":
        weights = weights[:-1]
    else:
        edges[5] += 1e-3
    schedule = Schedule(edges, solution.schedule.weights, solution.schedule.names)
    return dataclasses.replace(solution, arrays={"relaxed_weights": weights}, schedule=schedule)


@pytest.mark.parametrize("kind", ["closed", "unfilled", "nan", "shape", "edges"])
def test_a_policy_of_another_problem_is_left_alone(small_solution: Solution, kind: str) -> None:
    monitor = resumed(spoilt(small_solution, kind))
    assert earlier_policy(small_solution.problem, monitor) is None and not monitor.resumed


def test_the_command_goes_on_from_the_folder_and_says_when_it_cannot(
    tmp_path: Path, small_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["solve", str(small_file), "--out", str(tmp_path / "run"), "--no-figures", "--resume"]
    assert run(words) == 0
    assert "nothing to go on from was found" in capsys.readouterr().err
    assert run(words) == 0
    assert "nothing to go on from" not in capsys.readouterr().err


def test_a_run_whose_solver_added_edges_belongs_to_the_problem_as_it_was_posed(
    tmp_path: Path, small_solution: Solution
) -> None:
    from occontrol.api import document
    from occontrol.cli.solve import _earlier, write_with_figures

    posed = small_solution.problem
    cut = posed.with_edges([(float(posed.edges[3] + 0.25 * posed.steps[3]), "a test")])
    weights = np.repeat(small_solution.schedule.weights, [1, 1, 1, 2, *[1] * (posed.intervals - 4)], axis=0)
    arrays = {"edges": cut.edges, "weights": weights}
    schedule = Schedule(cut.edges, weights, small_solution.schedule.names)
    refined = dataclasses.replace(small_solution, problem=cut, arrays=arrays, schedule=schedule)
    placed = write_with_figures(tmp_path, posed, refined, figures=False)
    assert placed.content["digest"] == problem_digest(document(posed)) != problem_digest(document(cut))
    found = _earlier(tmp_path, posed)
    assert found is not None and len(found.schedule.edges) == len(posed.edges) + 1
    assert _earlier(tmp_path, dataclasses.replace(posed, cost_weight=0.2)) is None

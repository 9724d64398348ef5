"""compare: when it stops, and what its exit code says of several methods."""

from __future__ import annotations

import dataclasses
import signal
from pathlib import Path

import pytest

from occontrol.cli import run
from occontrol.cli.compare import _outcome, comparison
from occontrol.core.solution import Certificate, Solution, Status


@pytest.mark.parametrize(
    ("statuses", "code"),
    [
        ([Status.INFEASIBLE, Status.FEASIBLE], 0),
        ([Status.FAILED, Status.CERTIFIED], 0),
        ([Status.FAILED, Status.LIMIT], 0),
        ([Status.DISAGREES, Status.INFEASIBLE], 7),
        ([Status.INFEASIBLE, Status.DISAGREES], 4),
        ([], 6),
    ],
)
def test_one_usable_method_is_enough_otherwise_the_first_one_says_why(
    small_solution: Solution, statuses: list[Status], code: int
) -> None:
    found = {str(i): dataclasses.replace(small_solution, status=status) for i, status in enumerate(statuses)}
    assert _outcome(found) == code


def test_every_cost_is_measured_against_the_best_bound(small_solution: Solution) -> None:
    """Here of certificates on a grid; a negative cost has a gap of the right sign too."""
    plain = dataclasses.replace(small_solution.numbers, top=None)
    found = {
        name: dataclasses.replace(small_solution, numbers=plain, certificate=Certificate(cost, bound))
        for name, cost, bound in (("one", -2.0, -4.0), ("other", -1.0, -3.0))
    }
    rows = comparison(found)
    assert [row["gap_to_best_bound"] for row in rows] == [0.5, 2.0]


def test_an_interruption_leaves_the_other_methods_out(
    small_file: Path, small_solution: Solution, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried = []

    def interrupted(problem, name, monitor):
        tried.append(name)
        monitor.interrupted = signal.SIGINT
        return small_solution

    monkeypatch.setattr("occontrol.cli.compare.run_method", interrupted)
    assert run(["compare", str(small_file), "--methods", "greedy,random,relaxed", "--out", str(tmp_path / "c")]) == 130
    assert tried == ["greedy"]

"""What is worked out from traces refuses every problem that charges something else, on every way in."""

from __future__ import annotations

from pathlib import Path

import pytest

import occontrol as oc
from occontrol.api import sensitivity
from occontrol.core.errors import UsageError
from occontrol.core.monitor import Monitor
from occontrol.families import find_family

PROBLEMS = Path(__file__).resolve().parents[3] / "problems"
STEPS = """\
family: athans
name: two
horizon: {steps: 6}
plant: {F: [[1, 0.2], [0, 0.9]], Q: {diag: [0.1, 0.2]}, initial: {covariance: {diag: [5, 5]}}}
sensors:
  - {name: r, H: [[1, 0]], R: [[0.1]], cost: 0.3}
  - {name: d, H: [[0, 1]], R: [[0.1]], cost: 0.1}
  - idle
objective: {output: [[1, 0], [0, 1]], cost_weight: 0.1, criterion: {name: CRITERION}}
"""
RATE = """\
family: athans
name: two
horizon: {start: 0, end: 2, intervals: 8}
plant: {A: [[0, 1], [-1, -0.4]], noise: {diag: [0.1, 0.5]}, initial: {covariance: {diag: [5, 5]}}}
sensors:
  - {name: r, C: [[1, 0]], noise: [[0.1]], cost: 0.3}
  - {name: d, C: [[0, 1]], noise: [[0.1]], cost: 0.1}
objective: {output: [[1, 0], [0, 1]], cost_weight: 0.1, criterion: {name: CRITERION}}
"""


def problem_of(folder: Path, text: str, criterion: str) -> oc.AthansProblem:
    """The problem of a text with a criterion."""
    path = folder / "p.yaml"
    path.write_text(text.replace("CRITERION", criterion), encoding="utf-8")
    return oc.read_problem(path)


@pytest.mark.parametrize("criterion", ["logdet", "log-trace", "largest-eigenvalue", "schatten", "peak"])
@pytest.mark.parametrize("text", [STEPS, RATE])
def test_other_criteria_are_refused_by_name(tmp_path: Path, text: str, criterion: str) -> None:
    problem = problem_of(tmp_path, text, criterion)
    with pytest.raises(UsageError, match=f"there are no sensitivities with criterion {criterion}"):
        sensitivity(problem)


def test_closed_loops_are_of_the_trace(tmp_path: Path) -> None:
    problem = problem_of(tmp_path, STEPS, "logdet")
    solution = oc.solve(problem)
    with pytest.raises(UsageError, match="no simulated runs in closed loop with criterion logdet"):
        find_family("athans").monte_carlo(problem, solution, None, 4, 1, Monitor())
    with pytest.raises(UsageError, match="no simulated runs in closed loop with criterion logdet"):
        oc.athans.ReplanningLoop(problem, solution.schedule)


def test_the_trace_by_name_is_the_trace(tmp_path: Path) -> None:
    found = sensitivity(problem_of(tmp_path, STEPS, "trace"))
    plain = (tmp_path / "p.yaml").read_text(encoding="utf-8").replace(", criterion: {name: trace}", "")
    (tmp_path / "q.yaml").write_text(plain, encoding="utf-8")
    assert found.as_dict() == sensitivity(oc.read_problem(tmp_path / "q.yaml")).as_dict()


@pytest.mark.parametrize(
    ("file", "why"), [("radar_fifty.yaml", "of many targets"), ("endless/vehicle.yaml", "of a horizon without end")]
)
def test_many_targets_and_no_end_are_refused(file: str, why: str) -> None:
    problem = oc.read_problem(PROBLEMS / file)
    with pytest.raises(UsageError, match=f"there are no sensitivities {why}"):
        sensitivity(problem)
    with pytest.raises(UsageError, match=f"closed loop {why}"):
        find_family("athans").monte_carlo(problem, None, None, 4, 1, Monitor())


def test_a_difference_is_never_shown_as_a_share(tmp_path: Path) -> None:
    solution = oc.solve(problem_of(tmp_path, STEPS, "logdet"))
    assert "(a difference)" in repr(solution) and "%" not in repr(solution)

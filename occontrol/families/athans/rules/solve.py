"""Solving with rules in continuous sensing: relaxation, hull, block moves and, where wished, the tree to the end."""

from __future__ import annotations

from typing import Any

from occontrol.core import stopwatch
from occontrol.core.errors import UsageError
from occontrol.core.monitor import Monitor
from occontrol.core.solution import Solution
from occontrol.families.athans.balanced import balanced, restored
from occontrol.families.athans.discretise import feasible_set
from occontrol.families.athans.found import relax
from occontrol.families.athans.integration.refine import search_space
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.families.athans.rules.assembly import assemble_ruled
from occontrol.families.athans.rules.search import Work, run
from occontrol.families.athans.rules.setting import frame_of, prepared, setting_of


def solve_ruled(problem: SchedulingProblem, method: Any, monitor: Monitor) -> Solution:
    """The schedule that a method finds for a problem with rules, or without rules for the exact optimum.

    Parameters
    ----------
    problem : SchedulingProblem
    method : of the family
    monitor : Monitor

    Raises InfeasibleError where no schedule keeps the rules, SolveFailed where none was found, UsageError for a method
    that does not do rules.
    """
    if method.name == "collocation":
        raise UsageError(f"{method.name} does not do rules on schedules\n  hint: method: schedule")
    problem.require_feasible()
    began = stopwatch.seconds()
    inner, units = balanced(prepared(problem, method.relative_gap))
    integrator, sweep = search_space(inner, method, monitor)
    allowed = feasible_set(inner)
    base = relax(sweep, allowed, monitor, method.relative_gap)
    setting = setting_of(inner, integrator)
    work = Work(setting.task, frame_of(problem), sweep, allowed, base.relaxed, monitor)  # type: ignore[arg-type]
    outcome = run(work, method)
    outcome.steps_chosen = problem.integration.substeps is None
    solution = assemble_ruled(setting, outcome, method.name, monitor, began)
    return restored(solution, problem, units)

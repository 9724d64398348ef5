"""Solving with rules in continuous sensing: relaxation, hull, block moves and, where wished, the tree to the end."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from occontrol.core import stopwatch
from occontrol.core.errors import UsageError
from occontrol.core.monitor import Monitor
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Solution, Status
from occontrol.families.athans.balanced import balanced, restored
from occontrol.families.athans.discretise import feasible_set
from occontrol.families.athans.found import relax
from occontrol.families.athans.integration.refine import search_space
from occontrol.families.athans.methods import RelaxRoundPolish
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.families.athans.rules.assembly import assemble_ruled
from occontrol.families.athans.rules.columns import on_of
from occontrol.families.athans.rules.off_grid import off_grid
from occontrol.families.athans.rules.search import Work, run
from occontrol.families.athans.rules.setting import frame_of, prepared, setting_of

WHY = "a switch time off the grid"
UNMOVED = "Its switch times stay: none that was found off the grid costs less."


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
    solution = _solved(problem, method, monitor, None)
    if not getattr(method, "off_grid", False) or monitor.stop or solution.schedule is None:
        return solution
    return _moved(problem, method, monitor, solution)


def _solved(problem: SchedulingProblem, method: RelaxRoundPolish, monitor: Monitor, known: Schedule | None) -> Solution:
    """One search; `known` is a schedule on the problem's edges to begin with."""
    began = stopwatch.seconds()
    inner, units = balanced(prepared(problem, method.relative_gap))
    integrator, sweep = search_space(inner, method, monitor)
    allowed = feasible_set(inner)
    base = relax(sweep, allowed, monitor, method.relative_gap)
    setting = setting_of(inner, integrator)
    work = Work(setting.task, frame_of(problem), sweep, allowed, base.relaxed, monitor)  # type: ignore[arg-type]
    if known is not None:
        work = replace(work, known=on_of(np.asarray(known.weights), setting.task.rules))
    outcome = run(work, method)
    outcome.steps_chosen = problem.integration.substeps is None
    solution = assemble_ruled(setting, outcome, method.name, monitor, began)
    return restored(solution, problem, units)


def _moved(problem: SchedulingProblem, method: RelaxRoundPolish, monitor: Monitor, solution: Solution) -> Solution:
    """The solution with switch times off the grid, certified anew on a grid that has them; or as it is."""
    schedule: Schedule = solution.schedule  # type: ignore[assignment]
    moved = off_grid(prepared(problem, method.relative_gap), schedule)
    if moved is None:
        return replace(solution, message=f"{solution.message} {UNMOVED}")
    grid = problem.with_edges([(float(t), WHY) for t in moved.schedule.edges if t not in problem.edges])
    select = None if grid.slews else grid.select
    weights = moved.schedule.on_grid(grid.edges, list(grid.sensors.names), select)
    again = _solved(grid, method, monitor.child(), Schedule(grid.edges, weights, tuple(grid.sensors.names)))
    before, after = (s.numbers.continuous for s in (solution, again))  # type: ignore[union-attr]
    if None in (before.cost, after.cost) or after.cost > before.cost or again.status is Status.DISAGREES:
        return replace(solution, message=f"{solution.message} {UNMOVED}")
    text = f"Switch times were moved off the grid by up to {moved.farthest:.4g}; in continuous time, without changes,"
    costs = f"the schedule costs {moved.after:.10g}, on the grid {moved.before:.10g}."
    return replace(again, message=f"{again.message} {text} {costs}")

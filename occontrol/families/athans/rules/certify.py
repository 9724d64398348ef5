"""Anybody's schedule under rules: every rule it breaks, or its cost beside the bound with the rules."""

from __future__ import annotations

import dataclasses

import numpy as np

from occontrol.core import stopwatch
from occontrol.core.claims import Claims, false_claims
from occontrol.core.errors import Mistake, ProblemError, SolveFailed
from occontrol.core.monitor import Monitor
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Solution, Status
from occontrol.families.athans.balanced import balanced, restored
from occontrol.families.athans.certify import on_common_grid, parts_of
from occontrol.families.athans.discretise import feasible_set
from occontrol.families.athans.integration.refine import relax_and_refine
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.families.athans.result import AthansResult
from occontrol.families.athans.rules.assembly import assemble_ruled
from occontrol.families.athans.rules.columns import on_of
from occontrol.families.athans.rules.frame import Frame
from occontrol.families.athans.rules.search import Outcome, searched
from occontrol.families.athans.rules.setting import frame_of, prepared, setting_of
from occontrol.files.segments import as_read
from occontrol.scheduling.relaxation import RelaxedOptions
from occontrol.scheduling.rules.check import RELATIVE, violations
from occontrol.scheduling.rules.tree import TreeOptions

WHOLE = 1e-6  # of a weight


def certify_ruled(problem: SchedulingProblem, schedule: Schedule, claims: Claims | None = None) -> Solution:
    """Cost, lower bound and gap of a schedule for a problem with rules.

    Parameters
    ----------
    problem : SchedulingProblem
    schedule : Schedule on any edges over the problem's horizon; the grid is refined by its switch times
    claims : what somebody says of it; refuted claims make the status `disagrees`

    Raises ProblemError naming every rule that the schedule breaks, with sensor and time, SolveFailed where rules and
    search disagree on a schedule.
    """
    started = stopwatch.seconds()
    monitor = Monitor()
    problem, weights = on_common_grid(problem, as_read(schedule, problem))
    require_rules(problem, weights)
    problem.require_feasible()
    gap = getattr(problem.method, "relative_gap", 1e-4)
    inner, units = balanced(prepared(problem, gap))
    integrator, sweep = relax_and_refine(inner, RelaxedOptions(gap), monitor, refine=False)
    setting = setting_of(inner, integrator)
    task = setting.task
    plan = task.oracle.follow(on_of(weights, task.rules))
    if plan is None:
        raise SolveFailed("the schedule keeps every rule by itself, but not as the search counts them on these edges")
    _, error = task.parts(plan.weights)
    if error > task.rules.max_error * (1 + RELATIVE):
        what = f"the error of the schedule is {error:.8g}, max_error is {task.rules.max_error:g}"
        raise ProblemError(Mistake(("schedule",), what))
    relaxed = sweep.outcome
    search, tree = searched(task, relaxed, TreeOptions(most=1, moves=0), monitor, [plan], feasible_set(inner))
    found = Outcome(plan, plan.weights, plan.switching, tree.lower_bound, tree.root, search.rows, tree.nodes)
    found.relaxed, found.status, found.target = relaxed, relaxed.status, gap
    found.steps_chosen = problem.integration.substeps is None
    solution = restored(assemble_ruled(setting, found, "certify", monitor, started), problem, units)
    if claims is not None and solution.certificate is not None:
        numbers: AthansResult = solution.numbers  # type: ignore[assignment]
        best = np.inf if search.best is None else search.best.value
        lowest = min(solution.certificate.cost, best)
        continuous = None if numbers.continuous is None else numbers.continuous.cost
        refuted = false_claims(claims, solution.certificate.cost, lowest, continuous, parts_of(numbers))
        if refuted:
            return dataclasses.replace(solution, status=Status.DISAGREES, message="; ".join(refuted))
    return solution


def require_rules(problem: SchedulingProblem, weights: np.ndarray) -> None:
    """Raise ProblemError with everything that a schedule breaks, the caps on cost and error apart.

    Parameters
    ----------
    problem : with rules
    weights : (N, M) on its edges
    """
    whole = require_whole(weights)
    empty = ~np.any(whole > 0, axis=1) if problem.slews else np.zeros(len(whole), dtype=bool)
    allowed = feasible_set(problem)
    filled = whole.copy()
    filled[empty] = allowed.uniform()[empty]
    mistakes = [*allowed.check(filled), *broken(frame_of(problem), whole)]
    if mistakes:
        raise ProblemError(mistakes)


def require_whole(weights: np.ndarray) -> np.ndarray:
    """The weights (N, M) as whole numbers; ProblemError for fractions."""
    if np.any(np.abs(weights - np.round(weights)) > WHOLE):
        what = "the schedule uses fractions of sensors, and rules are about whole ones"
        raise ProblemError(Mistake(("schedule",), what))
    return np.round(weights)


def broken(frame: Frame, weights: np.ndarray) -> list[Mistake]:
    """Every rule that a schedule breaks, the cap on the error apart.

    Parameters
    ----------
    frame : Frame of the problem
    weights : (N, M) whole
    """
    rules, on = frame.rules, on_of(weights, frame.rules)
    mistakes = [Mistake(("schedule",), v.text) for v in violations(rules, frame.edges, on)]
    spent = float(np.vdot(frame.spend, on))
    if spent > rules.max_observation * (1 + RELATIVE):
        what = f"the observation cost of the schedule is {spent:.8g}, max_observation_cost is {rules.max_observation:g}"
        mistakes.append(Mistake(("schedule",), what))
    return mistakes

"""One method on a problem of readings: search, tighter bounds, certificate, independent check."""

from __future__ import annotations

import numpy as np

from occontrol.core import stopwatch
from occontrol.core.errors import UsageError
from occontrol.core.method import Method
from occontrol.core.monitor import Monitor
from occontrol.core.solution import Solution
from occontrol.families.athans.criteria.design import solve_design
from occontrol.families.athans.criteria.readings import solve_measured
from occontrol.families.athans.found import Found, relax
from occontrol.families.athans.methods import Collocation, Relaxed, RelaxRoundPolish
from occontrol.families.athans.readings.assembly import assemble
from occontrol.families.athans.readings.bounds import tighten
from occontrol.families.athans.readings.budgets import with_budget
from occontrol.families.athans.readings.fill import feasible_set, fill
from occontrol.families.athans.readings.problem import ReadingsProblem
from occontrol.families.athans.readings.ruled import solve_ruled
from occontrol.scheduling.budget import BudgetSet
from occontrol.scheduling.rounding import roundings
from occontrol.scheduling.sweep import Sweep


def solve(problem: ReadingsProblem, method: Method, monitor: Monitor) -> Solution:
    """Run `method` on the problem's recursion and certify what it found.

    Parameters
    ----------
    problem : ReadingsProblem
    method : an options object of the family, but Collocation
    monitor : Monitor

    Raises UsageError for collocation, InfeasibleError when an instant cannot be filled or no schedule keeps the rules.
    """
    if isinstance(method, Collocation):
        raise UsageError("collocation does not do readings at instants\n  hint: method: schedule, or relaxed")
    if not problem.prior:
        return solve_design(problem, method, monitor)
    if problem.ruled:
        return solve_ruled(problem, method, monitor)
    if problem.measured:
        return solve_measured(problem, method, monitor)
    problem.require_feasible()
    began = stopwatch.seconds()
    filled = fill(problem)
    sweep, allowed = Sweep(filled.recursion), feasible_set(problem)
    if isinstance(allowed, BudgetSet):
        found = with_budget(sweep, allowed, method, monitor)
    else:
        found = method.run(problem, sweep, allowed, monitor)
        found = tighten(sweep, allowed, found, method, monitor, keep=not isinstance(method, RelaxRoundPolish))
    return assemble(problem, method.name, filled, found, monitor, began)


def judged(problem: ReadingsProblem, weights: np.ndarray, relative_gap: float) -> tuple[Solution, Found]:
    """The solution that a given policy is, with the best bound known, and the relaxation beside it.

    Parameters
    ----------
    problem : ReadingsProblem
    weights : (E, M) of every decision
    relative_gap : target of the relaxation
    """
    began, monitor = stopwatch.seconds(), Monitor()
    filled = fill(problem)
    sweep, allowed = Sweep(filled.recursion), feasible_set(problem)
    if isinstance(allowed, BudgetSet):
        found = with_budget(sweep, allowed, Relaxed(relative_gap), monitor, bound=True)
        found.weights = weights
        return assemble(problem, "certify", filled, found, monitor, began), found
    found = relax(sweep, allowed, monitor, relative_gap)
    found.weights = weights
    found = tighten(sweep, allowed, found, None, monitor, keep=True)
    return assemble(problem, "certify", filled, found, monitor, began), found


def rounded_cost(problem: ReadingsProblem, found: Found) -> float:
    """J of the best schedule that the relaxation rounds to; inf without a relaxation.

    Parameters
    ----------
    problem : ReadingsProblem
    found : with the relaxation that stands beside a policy
    """
    if found.relaxed is None:
        return np.inf
    filled, allowed = fill(problem), feasible_set(problem)
    sweep = Sweep(filled.recursion)
    return min(sweep.cost(v) for v in roundings(found.relaxed.weights, allowed)) + filled.constant

"""Problems of continuous sensing with another criterion than the trace: solved, judged, checked in continuous time.

On the grid cost and bound are those of one convex recursion, with the fewest equal steps that reach the accuracy, as
for rules.
"""

from __future__ import annotations

import numpy as np

from occontrol.core import stopwatch
from occontrol.core.errors import InfeasibleError, UsageError
from occontrol.core.method import Method
from occontrol.core.monitor import Monitor
from occontrol.core.solution import Solution, Status
from occontrol.families.athans.balanced import balanced, restored
from occontrol.families.athans.criteria.limit import hunt_below
from occontrol.families.athans.criteria.rate_assembly import assembled
from occontrol.families.athans.criteria.rate_objective import Measured, measured_of
from occontrol.families.athans.criteria.search import Hunted, hunt
from occontrol.families.athans.discretise import feasible_set
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.families.athans.rules.setting import prepared
from occontrol.scheduling.peak import PeakSweep
from occontrol.scheduling.rules.model import KEEPS


def solve_rate(problem: SchedulingProblem, method: Method, monitor: Monitor) -> Solution:
    """Run `method` on a problem of continuous sensing with a criterion and certify what it found.

    Parameters
    ----------
    problem : with a criterion that is not the trace, without rules
    method : of the family
    monitor : Monitor

    Raises UsageError for a method that does not do criteria, InfeasibleError where a limit cannot be kept.
    """
    if method.name == "collocation":
        raise UsageError("collocation does not do criteria other than the trace\n  hint: method: schedule, or relaxed")
    problem.require_feasible()
    began = stopwatch.seconds()
    inner, units = balanced(prepared(problem, getattr(method, "relative_gap", 1e-4)))
    measured = measured_of(inner)
    hunted = _hunted(measured, method, monitor)
    if hunted.found.status is Status.INFEASIBLE:
        raise InfeasibleError(hunted.found.message)
    return restored(assembled(measured, method.name, hunted, monitor, began), problem, units)


def judge_rate(problem: SchedulingProblem, weights: np.ndarray, method: Method) -> tuple[Solution, float]:
    """The solution that a given policy is, and the cost of the best one known beside it.

    Parameters
    ----------
    problem : with a criterion
    weights : (N, M) on its edges
    method : whose relaxation proves the bound

    Raises InfeasibleError where a limit cannot be kept, UsageError where this policy does not keep it.
    """
    began, monitor = stopwatch.seconds(), Monitor()
    inner, units = balanced(prepared(problem, getattr(method, "relative_gap", 1e-4)))
    measured = measured_of(inner)
    limit = measured.limit
    if limit is not None:
        measured.objective.cost(weights)
        if measured.objective.criterion_value > limit * (1 + KEEPS):
            peak = measured.objective.criterion_value
            raise UsageError(f"the peak of the schedule is {peak:.8g}, the limit is {limit:g}")
    hunted = _hunted(measured, method, monitor)
    known = measured.objective.cost(hunted.found.weights)
    known -= 0.0 if limit is None else measured.objective.criterion_value
    hunted.found.weights = weights
    return restored(assembled(measured, "certify", hunted, monitor, began), problem, units), known


def _hunted(measured: Measured, method: Method, monitor: Monitor) -> Hunted:
    limit, allowed = measured.limit, feasible_set(measured.problem)
    if limit is not None and isinstance(measured.objective, PeakSweep):
        return hunt_below(measured.objective, limit, allowed, method, monitor)
    return hunt(measured.objective, allowed, method, monitor)

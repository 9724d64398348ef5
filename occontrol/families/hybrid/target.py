"""The schedules of this family that are known before anything is measured, for code on a target."""

from __future__ import annotations

from occontrol.core.errors import SolveFailed, UsageError
from occontrol.core.solution import Solution
from occontrol.core.target import TargetPlan, schedule_alone
from occontrol.families.hybrid.methods import Alternate, Fixed
from occontrol.families.hybrid.problem import Problem

KNOWN = (Alternate.name, Fixed.name)
WHY = "the estimator of family hybrid runs one filter a mode (IMM), which is not written"


def target_plan(problem: Problem, solution: Solution) -> TargetPlan:
    """The groups of the methods that look at no data.

    Parameters
    ----------
    problem : Problem
    solution : of one of the methods KNOWN

    Raises UsageError for the others, SolveFailed without a schedule.
    """
    if solution.method not in KNOWN:
        what = f"with method {solution.method} the sensors are chosen while it runs: there is no schedule for a target"
        raise UsageError(f"{what}\n  hint: solve --method {' or '.join(KNOWN)}")
    if solution.schedule is None:
        raise SolveFailed("the solution has no schedule to follow")
    return schedule_alone(solution.schedule, WHY)

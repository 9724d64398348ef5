"""Anybody's schedule and anybody's claims, everything recomputed."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from occontrol.core.claims import Claims, false_claims
from occontrol.core.errors import ProblemError
from occontrol.core.monitor import Monitor
from occontrol.core.printed import rounded_down
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Solution, Status
from occontrol.families.robust.assemble import sequence_solution, unobservable_solution
from occontrol.families.robust.balanced import balanced, restored
from occontrol.families.robust.problem import Problem
from occontrol.families.robust.result import numbers_of
from occontrol.families.robust.search import search
from occontrol.families.robust.slots import table_of
from occontrol.files.segments import as_read


def certify(problem: Problem, schedule: Schedule, claims: Claims | None = None) -> Solution:
    """Cost, lower bound and gap of anybody's schedule, everything recomputed.

    Parameters
    ----------
    problem : Problem
    schedule : Schedule over the same horizon with one sensor at a time; where it switches within a slot, the slots are
        cut there, and the bound holds for the finer slots
    claims : what somebody says of it; refuted claims make the status `disagrees`

    Raises ProblemError for a schedule that does not cover the horizon, leaves a time without a sensor or uses two.
    """
    watch = Monitor()
    given, sequence = on_slots(problem, schedule)
    problem = balanced(given)
    slots = table_of(problem)
    if slots is None:
        return restored(unobservable_solution(problem, "certify", sequence), given)
    found = search(slots, [sequence], monitor=watch)
    solution = sequence_solution(
        problem,
        slots,
        sequence,
        method="certify",
        lower_bound=found.lower_bound,
        status=Status.FEASIBLE,
        message=f"The best sequence known costs {found.cost:.8g}; "
        f"none costs less than {rounded_down(found.lower_bound, 8)}.",
        monitor=watch,
        numbers={"nodes": found.nodes, "best_known_cost": found.cost},
    )
    solution = restored(solution, given)
    refuted = [] if claims is None else false_claims(claims, solution.cost, found.cost, parts={"level": slots.level})
    return dataclasses.replace(solution, status=Status.DISAGREES, message="; ".join(refuted)) if refuted else solution


def on_slots(problem: Problem, schedule: Schedule) -> tuple[Problem, list[int]]:
    """The problem with its slots cut where the schedule switches within one, and the sensor of every slot.

    Parameters
    ----------
    problem : Problem
    schedule : Schedule; a sensor that it does not name is not used

    Raises ProblemError in the words of the reader of schedule files: times without a sensor, times beyond the horizon,
    unknown names, not exactly one sensor at a time.
    """
    fitted = as_read(schedule, problem)
    if not fitted.is_integer:
        raise ProblemError("the schedule does not use exactly one sensor at a time", "one sensor per slot")
    if len(fitted.edges) > len(problem.edges):
        problem = dataclasses.replace(problem, edges=fitted.edges, method=None)
    return problem, [int(j) for j in np.argmax(fitted.weights, axis=1)]


def claims_of(solution: Solution) -> Claims:
    """What a run says of its sequence, for `certify` to check.

    Parameters
    ----------
    solution : of the run, also as read from a folder
    """
    numbers = numbers_of(solution)
    stated = (numbers.cost, numbers.lower_bound, numbers.relative_gap, numbers.level)
    cost, bound, gap, level = (float(x) if isinstance(x, int | float) else None for x in stated)
    parts: Mapping[str, float] = {} if level is None else {"level": level}
    return Claims(cost, bound, None, gap, parts)

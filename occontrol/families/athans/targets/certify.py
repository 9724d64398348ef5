"""Anybody's schedule of looks, judged: cost, lower bound and gap, and which stated numbers are wrong."""

from __future__ import annotations

import dataclasses

import numpy as np

from occontrol.core import stopwatch
from occontrol.core.claims import Claims, false_claims
from occontrol.core.errors import ProblemError, plural
from occontrol.core.look_schedule import LookSchedule
from occontrol.core.monitor import Monitor
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Solution, Status
from occontrol.families.athans.certify import parts_of
from occontrol.families.athans.found import STEPS_FOR_BOUND
from occontrol.families.athans.targets.assembly import assemble
from occontrol.families.athans.targets.fill import Filled
from occontrol.families.athans.targets.problem import TargetsProblem
from occontrol.families.athans.targets.solve import near, relaxed_task, resolved
from occontrol.families.athans.targets.whole import bound_whole, by_tree

ROUNDING = 1e-6


def certify(problem: TargetsProblem, schedule: Schedule, claims: Claims | None = None) -> Solution:
    """Cost, lower bound and gap of anybody's schedule, everything recomputed from problem and schedule.

    Parameters
    ----------
    problem : TargetsProblem
    schedule : LookSchedule on the problem's edges
    claims : what somebody says of it; refuted claims make the status `disagrees`

    Returns a Solution with method "certify". Raises ProblemError when a look is closed or a resource gives too many.
    """
    began, monitor = stopwatch.seconds(), Monitor()
    gap = float(getattr(problem.method, "relative_gap", 1e-4))
    filled, error = resolved(problem, gap, monitor)
    weights = weights_of(filled, schedule)
    task = relaxed_task(filled, gap, STEPS_FOR_BOUND, monitor)
    whole = bool(np.all(weights == np.round(weights)))
    if whole and not near(task, weights):
        task.whole = bound_whole(filled, task.sweep, task.relaxed, task.sweep.cost(weights), monitor, walk=False)
        if task.whole is not None:
            task.whole = by_tree(filled, task.sweep, task.relaxed, task.whole, weights, monitor)
    solution = assemble(problem, "certify", task, weights, error, gap, began)
    if claims is not None and solution.certificate is not None:
        other = task.sweep.cost(filled.allowed.round(task.relaxed.weights)) if whole else task.relaxed.cost
        lowest = min(other, solution.certificate.cost)
        continuous = getattr(getattr(solution.numbers, "continuous", None), "cost", None)
        refuted = false_claims(claims, solution.certificate.cost, lowest, continuous, parts_of(solution.numbers))  # type: ignore[arg-type]
        if refuted:
            return dataclasses.replace(solution, status=Status.DISAGREES, message="; ".join(refuted))
    return solution


def weights_of(filled: Filled, schedule: Schedule) -> np.ndarray:
    """The weights (E, 1) of a schedule of looks; ProblemError for what the problem does not allow.

    Parameters
    ----------
    filled : the problem
    schedule : LookSchedule
    """
    problem, looks, allowed = filled.problem, filled.looks, filled.allowed
    if not isinstance(schedule, LookSchedule):
        raise ProblemError("this is not a schedule of looks", "start,end,resource,target in every line")
    if not np.array_equal(schedule.edges, problem.edges):
        raise ProblemError("the schedule is on other edges than the problem")
    T, R = problem.targets, len(problem.resources)
    key = (looks.interval.astype(np.int64) * R + looks.resource) * (T + 1) + looks.target
    real = looks.target >= 0
    place = np.flatnonzero(real)
    known = key[place]
    wanted = (schedule.interval.astype(np.int64) * R + schedule.resource) * (T + 1) + schedule.target
    at = np.searchsorted(known, wanted)
    good = (at < len(known)) & (known[np.minimum(at, len(known) - 1)] == wanted)
    if not np.all(good):
        i = int(np.argmin(good))
        k = schedule.interval[i]
        what = (
            f"resource '{schedule.resources[schedule.resource[i]]}' does not see target "
            f"'{schedule.targets[schedule.target[i]]}' between t = {problem.edges[k]:.9g} and "
            f"{problem.edges[k + 1]:.9g}"
        )
        more = int(np.sum(~good)) - 1
        raise ProblemError(what + (f", and {plural(more, 'more look')} like it" if more else ""), "see its windows")
    v = np.zeros(len(key))
    np.add.at(v, place[at], schedule.share)
    if np.any(v > 1 + ROUNDING):
        raise ProblemError("a look is taken twice on one interval")
    sums = np.add.reduceat(v, allowed.starts[:-1])
    over = sums > allowed.capacity + ROUNDING
    if np.any(over):
        s = int(np.argmax(over))
        k, rho = int(allowed.interval[s]), int(looks.resource[allowed.starts[s]])
        what = f"resource '{problem.resources[rho].name}' gives {sums[s]:g} looks between t = {problem.edges[k]:.9g}"
        raise ProblemError(f"{what} and {problem.edges[k + 1]:.9g}", f"its capacity is {allowed.capacity[s]}")
    v[allowed.rest] = np.maximum(allowed.capacity - sums, 0.0)
    return v[:, None]

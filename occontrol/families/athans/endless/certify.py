"""Anybody's cycle of looks, judged: its cost for ever, and a lower bound that is proven anew."""

from __future__ import annotations

import dataclasses

import numpy as np

from occontrol.core import stopwatch
from occontrol.core.claims import Claims, false_claims
from occontrol.core.errors import ProblemError
from occontrol.core.look_schedule import LookSchedule
from occontrol.core.monitor import Monitor
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Solution, Status
from occontrol.families.athans.certify import parts_of
from occontrol.families.athans.endless.bound import bounds_of, targets_of
from occontrol.families.athans.endless.problem import EndlessTargetsProblem
from occontrol.families.athans.endless.solve import assemble
from occontrol.families.athans.periodic.method import Periodic

OWN_NODES = 20_000
SAME = 1e-6  # of a stated bound: prices and proofs are found anew


def certify(problem: EndlessTargetsProblem, schedule: Schedule, claims: Claims | None = None) -> Solution:
    """Cost, lower bound and gap of anybody's cycle, everything recomputed from problem and schedule.

    Parameters
    ----------
    problem : EndlessTargetsProblem
    schedule : LookSchedule of one cycle
    claims : what somebody says of it; refuted claims make the status `disagrees`

    Returns a Solution with method "certify". Raises ProblemError for a schedule that the problem does not allow,
    InfeasibleError and SolveFailed where a covariance has no limit.
    """
    began, monitor, targets = stopwatch.seconds(), Monitor(), targets_of(problem)
    words = words_of(problem, schedule, targets)
    method = problem.method if isinstance(problem.method, Periodic) else Periodic()
    nodes = method.max_nodes if claims is not None else min(OWN_NODES, method.max_nodes)
    bounds = bounds_of(problem, targets, method.relative_gap, nodes, monitor)
    solution = assemble(problem, "certify", targets, words, bounds, method.relative_gap, monitor, began)
    if claims is None or solution.certificate is None:
        return solution
    refuted = false_claims(claims, solution.cost, solution.cost, None, parts_of(solution.numbers))  # type: ignore[arg-type]
    stated = claims.lower_bound
    if stated is not None and not stated <= bounds.integer + SAME * abs(bounds.integer):
        refuted.append(f"the stated lower bound is {stated:.10g}, {bounds.integer:.10g} could be proven")
    if refuted:
        return dataclasses.replace(solution, status=Status.DISAGREES, message="; ".join(refuted))
    return solution


def words_of(problem: EndlessTargetsProblem, schedule: Schedule, targets) -> np.ndarray:
    """The letters (K, P) of a schedule of looks.

    Parameters
    ----------
    problem : EndlessTargetsProblem
    schedule : LookSchedule of one cycle
    targets : of the problem

    Raises ProblemError where a look is a fraction, a target is not seen, or a resource gives too many looks.
    """
    if not isinstance(schedule, LookSchedule):
        raise ProblemError("this is not a schedule of looks", "start,end,resource,target in every line")
    P = len(schedule.edges) - 1
    if not np.allclose(schedule.edges, problem.cycle_edges(P), rtol=0, atol=1e-6 * problem.step):
        raise ProblemError(f"the looks do not last whole steps of {problem.step:g}", "one cycle, from 0 on")
    if not schedule.is_integer:
        raise ProblemError("a look is taken for a share of its time", "a cycle has whole looks")
    load = np.zeros((P, len(problem.resources)), dtype=int)
    taken = np.zeros((problem.targets, P, len(problem.resources)), dtype=int)
    np.add.at(load, (schedule.interval, schedule.resource), 1)
    np.add.at(taken, (schedule.target, schedule.interval, schedule.resource), 1)
    if np.any(taken > 1):
        raise ProblemError("a look is taken twice in one step")
    if np.any(load > problem.capacity):
        k, r = np.argwhere(load > problem.capacity)[0]
        name, t = problem.resource_names[r], problem.step * k
        what = f"resource '{name}' gives {load[k, r]} looks at t = {t:.9g}"
        raise ProblemError(what, f"its capacity is {problem.capacity[r]}")
    words = np.zeros((problem.targets, P), dtype=np.int64)
    for i, target in enumerate(targets):
        place = {tuple(uses): a for a, uses in enumerate(target.uses.astype(int))}
        for k in range(P):
            letter = place.get(tuple(taken[i, k]))
            if letter is None:
                r = int(np.flatnonzero(taken[i, k])[0])
                what = f"resource '{problem.resource_names[r]}' does not see target '{problem.target_names[i]}'"
                raise ProblemError(what, "see looks")
            words[i, k] = letter
    return words

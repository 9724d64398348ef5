"""Anybody's schedule, judged: cost, lower bound and gap, and which of the numbers stated for it are wrong."""

from __future__ import annotations

import dataclasses

import numpy as np

from occontrol.core import stopwatch
from occontrol.core.claims import Claims, false_claims
from occontrol.core.errors import ProblemError
from occontrol.core.monitor import Monitor
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Solution, Status
from occontrol.families.athans.assembly import assemble
from occontrol.families.athans.balanced import balanced, restored
from occontrol.families.athans.criteria.rate import judge_rate
from occontrol.families.athans.discretise import feasible_set
from occontrol.families.athans.found import Found
from occontrol.families.athans.integration.refine import relax_and_refine
from occontrol.families.athans.methods import Relaxed
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.families.athans.result import AthansResult
from occontrol.files.segments import as_read
from occontrol.scheduling.relaxation import RelaxedOptions


def certify(problem: SchedulingProblem, schedule: Schedule, claims: Claims | None = None) -> Solution:
    """Cost, lower bound and gap of anybody's schedule, everything recomputed from problem and schedule.

    Parameters
    ----------
    problem : SchedulingProblem
    schedule : Schedule on any edges over the problem's horizon; the grid is refined by its switch times
    claims : what somebody says of it; refuted claims make the status `disagrees`

    Returns a Solution with method "certify"; the bound is the better of the schedule's own and a relaxation's.
    Raises ProblemError, in the words of the reader of schedule files, when the schedule does not cover the horizon,
    breaks a window, names an unknown sensor or does not use `select` sensors at a time.
    """
    if not problem.prior:
        from occontrol.families.athans.criteria.rate_design import judge_rate_design

        problem, weights = on_common_grid(problem, as_read(schedule, problem))
        problem.require_feasible()
        if not problem.ruled and (mistakes := feasible_set(problem).check(weights)):
            raise ProblemError(mistakes)
        solution, known = judge_rate_design(problem, weights, getattr(problem.method, "relative_gap", 1e-4))
        return _refuted(solution, claims, known)
    if problem.measured and problem.ruled:
        from occontrol.families.athans.criteria.ruled_rate import judge_ruled_rate

        problem, weights = on_common_grid(problem, as_read(schedule, problem))
        solution, known = judge_ruled_rate(problem, weights)
        return _refuted(solution, claims, known)
    if problem.ruled or (claims is not None and claims.whole):  # a bound of whole schedules is the tree's
        from occontrol.families.athans.rules.certify import certify_ruled

        return certify_ruled(problem, schedule, claims)
    started = stopwatch.seconds()
    monitor = Monitor()
    problem, weights = on_common_grid(problem, as_read(schedule, problem))
    problem.require_feasible()
    if mistakes := feasible_set(problem).check(weights):
        raise ProblemError(mistakes)
    gap = getattr(problem.method, "relative_gap", 1e-4)
    if problem.measured:
        solution, known = judge_rate(problem, weights, Relaxed(gap))
        return _refuted(solution, claims, known)
    inner, units = balanced(problem)
    integrator, sweep = relax_and_refine(inner, RelaxedOptions(gap), monitor, refine=False)
    relaxed = sweep.outcome
    found = Found(weights, relaxed.iterations, relaxed.status, "", relaxed, target=gap)
    solution = assemble(inner, "certify", integrator, sweep, found, monitor, started)
    return _refuted(restored(solution, problem, units), claims, relaxed.cost)


def _refuted(solution: Solution, claims: Claims | None, known: float) -> Solution:
    """The solution, `disagrees` where claims are refuted by it or by a policy whose cost is known."""
    if claims is not None and solution.certificate is not None:
        lowest = min(known, solution.certificate.cost)
        numbers: AthansResult = solution.numbers  # type: ignore[assignment]
        continuous = None if numbers.continuous is None else numbers.continuous.cost
        refuted = false_claims(claims, solution.certificate.cost, lowest, continuous, parts_of(numbers))
        if refuted:
            return dataclasses.replace(solution, status=Status.DISAGREES, message="; ".join(refuted))
    return solution


def parts_of(numbers: AthansResult) -> dict[str, float]:
    """The numbers of a result that follow from problem and schedule alone, by name.

    Parameters
    ----------
    numbers : of a solution, perhaps read from a file that somebody has edited
    """
    parts = {
        "observation_cost": numbers.observation_cost,
        "running_cost": numbers.running_cost,
        "prediction_error": numbers.prediction_error,
        "predicted_mean_square_error": numbers.predicted_mean_square_error,
        "criterion": numbers.criterion,
        "continuous cost": None if numbers.continuous is None else numbers.continuous.cost,
    }
    return {name: float(value) for name, value in parts.items() if isinstance(value, int | float)}


def claims_of(solution: Solution) -> Claims:
    """What a run says of its schedule, for `certify` to check.

    Parameters
    ----------
    solution : of the run
    """
    numbers: AthansResult = solution.numbers  # type: ignore[assignment]
    bound = None if numbers.continuous is None else numbers.continuous.lower_bound
    cost, lower = (None, None) if solution.certificate is None else (solution.cost, solution.certificate.lower_bound)
    bound, gap = (float(x) if isinstance(x, int | float) else None for x in (bound, numbers.relative_gap))
    absolute = solution.certificate is not None and solution.certificate.absolute
    whole = numbers.proven_optimal is not None
    return Claims(cost, lower, bound, gap, parts_of(numbers), whole=whole, absolute=absolute)


def on_common_grid(problem: SchedulingProblem, schedule: Schedule) -> tuple[SchedulingProblem, np.ndarray]:
    """The problem on the union of its own edges and the schedule's, and the schedule's weights (N, M) there.

    Parameters
    ----------
    problem : SchedulingProblem
    schedule : Schedule over the same horizon, sensors in any order

    Raises ProblemError where the schedule is not one for this problem.
    """
    edges = schedule.common_edges(problem.edges)
    select = None if problem.slews else problem.select  # slewing leaves intervals empty
    extra = edges[~np.isin(edges, problem.edges)]
    if len(extra):
        problem = problem.with_edges([(float(t), "the schedule switches") for t in extra])
    return problem, schedule.on_grid(problem.edges, problem.sensors.names, select)

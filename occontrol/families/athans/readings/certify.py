"""Anybody's schedule of readings, judged: cost, lower bound and gap, and which stated numbers are wrong."""

from __future__ import annotations

import dataclasses

import numpy as np

from occontrol.core.claims import Claims, false_claims
from occontrol.core.errors import ProblemError
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Solution, Status
from occontrol.families.athans.certify import parts_of
from occontrol.families.athans.criteria.design import judge_design
from occontrol.families.athans.criteria.readings import judge_measured
from occontrol.families.athans.readings.fill import feasible_set
from occontrol.families.athans.readings.filter import weights_on
from occontrol.families.athans.readings.problem import ReadingsProblem
from occontrol.families.athans.readings.ruled import certify_ruled
from occontrol.families.athans.readings.solve import judged, rounded_cost
from occontrol.files.segments import as_read

SAME = 1e-9


def certify(problem: ReadingsProblem, schedule: Schedule, claims: Claims | None = None) -> Solution:
    """Cost, lower bound and gap of anybody's schedule, everything recomputed from problem and schedule.

    Parameters
    ----------
    problem : ReadingsProblem
    schedule : of the problem's instants, sensors in any order
    claims : what somebody says of it; refuted claims make the status `disagrees`

    Returns a Solution with method "certify". Raises ProblemError when the schedule has other instants, changes inside
    an epoch, breaks a window or a rule, or reads too many or too few sensors.
    """
    if problem.ruled and problem.prior:
        return certify_ruled(problem, on_decisions(problem, weights_on(problem, as_read(schedule, problem))), claims)
    problem.require_feasible()
    weights = on_decisions(problem, weights_on(problem, as_read(schedule, problem)))
    if not problem.ruled and (mistakes := feasible_set(problem).check(weights)):
        raise ProblemError(mistakes)
    gap = getattr(problem.method, "relative_gap", 1e-4)
    if problem.measured or not problem.prior:
        solution, lowest = (judge_measured if problem.prior else judge_design)(problem, weights, gap)
        found = None
    else:
        solution, found = judged(problem, weights, gap)
    if claims is None or solution.certificate is None:
        return solution
    # a bound that knows readings are whole may lie above the relaxed cost: only schedules refute it
    lowest = min(solution.certificate.cost, rounded_cost(problem, found) if found is not None else lowest)
    refuted = false_claims(claims, solution.certificate.cost, lowest, None, parts_of(solution.numbers))  # type: ignore[arg-type]
    if refuted:
        return dataclasses.replace(solution, status=Status.DISAGREES, message="; ".join(refuted))
    return solution


def on_decisions(problem: ReadingsProblem, weights: np.ndarray) -> np.ndarray:
    """The weights (E, M) of the epochs from those of all readings (N, M).

    Parameters
    ----------
    problem : ReadingsProblem
    weights : (N, M)

    Raises ProblemError where they change inside an epoch.
    """
    owner = problem.clock.owner
    first = np.flatnonzero(np.diff(owner, prepend=-1))
    whole = weights[first]
    apart = np.any(np.abs(weights - whole[owner]) > SAME, axis=1)
    if np.any(apart):
        k = int(np.argmax(apart))
        begins, t = problem.clock.times[first[owner[k]]], problem.clock.variable
        what = f"the schedule changes at {t} = {problem.clock.times[k]:g}, inside the epoch that begins at {begins:g}"
        raise ProblemError(what, f"a choice is kept for {problem.clock.epoch} steps")
    return whole

"""From a problem of readings with a criterion to the objective that the search works on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from occontrol.core.errors import Mistake, ProblemError, SolveFailed
from occontrol.families.athans.criteria.statement import LARGEST, LOG_TRACE, PEAK, SCHATTEN, CriterionChoice
from occontrol.families.athans.readings.fill import Filled, feasible_set, terminal_output
from occontrol.families.athans.readings.problem import ReadingsProblem
from occontrol.scheduling.criteria import LargestEigenvalue, LogDeterminant, LogTrace, Schatten, independent_outputs
from occontrol.scheduling.criterion import Criterion
from occontrol.scheduling.criterion_sweep import CriterionObjective, CriterionSweep
from occontrol.scheduling.path import step_path
from occontrol.scheduling.peak import PeakSweep, Watched, watched_before
from occontrol.scheduling.recursion import Recursion
from occontrol.scheduling.rules.model import KEEPS

DEPENDENT = (
    "{outputs} outputs have only {rank} independent errors, whatever is measured: the determinant is that of the "
    "{rank} directions in which they vary."
)


def criterion_of(
    choice: CriterionChoice, output: np.ndarray, recursion: Recursion, weights: np.ndarray
) -> tuple[Criterion, str]:
    """The criterion of the last covariance, and what is to be said about it.

    Parameters
    ----------
    choice : not a trace, not a peak
    output : (p, n) D in the units of the recursion
    recursion : Recursion
    weights : (N, M) any policy with finite information

    Raises SolveFailed where no output is uncertain.
    """
    if choice.name == LARGEST:
        return LargestEigenvalue(output), ""
    if choice.name == SCHATTEN:
        return Schatten(output, choice.power), ""
    final = step_path(recursion, weights).final
    try:
        if choice.name == LOG_TRACE:
            found: Criterion = LogTrace(output)
            found.value(final)
            return found, ""
        independent = independent_outputs(output, final)
    except ValueError as error:
        raise SolveFailed(f"{error}\n  hint: another output, or criterion: {{name: trace}}") from error
    note = ""
    if len(independent) < len(output):
        note = DEPENDENT.format(outputs=len(output), rank=len(independent))
    return LogDeterminant(independent), note


def objective_of(problem: ReadingsProblem, filled: Filled) -> tuple[CriterionObjective, str]:
    """The true objective of a problem of readings, and what is to be said about it.

    Parameters
    ----------
    problem : with a criterion that is not the trace
    filled : the problem as a recursion
    """
    choice, r = problem.criterion or CriterionChoice(), filled.recursion
    if choice.name == PEAK:
        return PeakSweep(r, watched_of(problem, filled)), ""
    weights = feasible_set(problem).uniform()
    output = filled.units.out_of(terminal_output(problem)[0])
    criterion, note = criterion_of(choice, output, r, weights)
    return CriterionSweep(r, criterion), note


def require_below(problem: ReadingsProblem, filled: Filled, weights: np.ndarray) -> None:
    """Raise ProblemError where a policy does not keep the limit of a peak.

    Parameters
    ----------
    problem : of readings, with a limit
    filled : the problem as a recursion
    weights : (E, M) of every decision
    """
    objective, limit = objective_of(problem, filled)[0], (problem.criterion or CriterionChoice()).limit
    objective.cost(weights)
    if limit is not None and objective.criterion_value > limit * (1 + KEEPS):
        what = f"the peak of the schedule is {objective.criterion_value:.8g}, the limit is {limit:g}"
        raise ProblemError(Mistake(("schedule",), what))


def peak_times(problem: ReadingsProblem) -> np.ndarray:
    """(m,) the readings at which a peak counts.

    Parameters
    ----------
    problem : of readings, with a peak
    """
    choice, times = problem.criterion or CriterionChoice(), problem.clock.times
    slack = 1e-9 * max(1.0, float(np.ptp(times)))
    since = -np.inf if choice.since is None else choice.since - slack
    return np.flatnonzero(times >= since)


def watched_of(problem: ReadingsProblem, filled: Filled) -> Watched:
    """The variances of which the largest is a peak.

    Parameters
    ----------
    problem : of readings, with a peak
    filled : the problem as a recursion
    """
    choice, at = problem.criterion or CriterionChoice(), peak_times(problem)
    D = np.array(problem.output.sample(problem.clock.times[at]))
    W = filled.units.weight(np.swapaxes(D, 1, 2) @ D)
    if choice.when == "prior":
        return watched_before(filled.recursion, W, at)
    return Watched(at, W, np.zeros(len(at)))


def without_trace(filled: Filled) -> Filled:
    """The same without the weight on the last covariance, which a criterion replaces.

    Parameters
    ----------
    filled : of a problem with a criterion
    """
    r = filled.recursion
    return replace(filled, recursion=replace(r, terminal=np.zeros_like(r.terminal)))

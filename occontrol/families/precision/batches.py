"""All batches of a problem, one after another: choose precisions, prune, measure with exactly those, go on.

Several batches run against a simulated truth (sequence.py); plain moments are a single batch without one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.core.solution import Status
from occontrol.families.precision.forecast import Forecast
from occontrol.families.precision.linearised import linearise_batch, undetectable_modes
from occontrol.families.precision.methods import ProgramMethod
from occontrol.families.precision.moments import Moments
from occontrol.families.precision.problem import Problem
from occontrol.families.precision.program import Outcome, Program
from occontrol.families.precision.pruning import Pruned, best_set, prune
from occontrol.families.precision.sequence import BatchOutcome, run_sequence


@dataclass(frozen=True, eq=False)
class Solved:
    """One batch: the program with every sensor, and what pruning left of it, if it was asked for."""

    whole: Outcome
    pruned: Pruned | None = None

    @property
    def final(self) -> Outcome:
        """What is measured with."""
        return self.whole if self.pruned is None else self.pruned.result


def solve_batches(problem: Problem, method: ProgramMethod, monitor: Monitor) -> tuple[list[Solved], list[BatchOutcome]]:
    """Solve every batch, until one cannot meet its bound or the monitor says stop.

    Parameters
    ----------
    problem : Problem
    method : for the program of each batch
    monitor : Monitor

    Returns what was solved, and what became of the truth and the filter (nothing for plain moments).
    """
    spared, solved = _spared(problem), []

    def choose(forecast: Forecast, number: int) -> Outcome | None:
        if number and monitor.stop:
            return None  # the batches so far are kept
        if problem.batches > 1:
            monitor.stage = f"batch {number + 1} of {problem.batches}"
        solved.append(_solve_batch(problem, method, monitor, forecast.moments, spared))
        return solved[-1].final

    if problem.moments is not None:
        return [_solve_batch(problem, method, monitor, problem.moments, spared)], []
    plant, measurement, filter_ = problem.dynamics("run")
    outcomes = run_sequence(plant, measurement, filter_, problem.batch, problem.batches, choose, problem.truth_seed)
    return solved, outcomes


def _solve_batch(
    problem: Problem,
    method: ProgramMethod,
    monitor: Monitor,
    moments: Moments,
    spared: Callable[[np.ndarray], bool] | None,
) -> Solved:
    program, pruning = problem.program(moments), problem.prune
    whole = method.run(program, monitor)
    if pruning is None or whole.precisions is None or not whole.objective > 0:
        return Solved(whole)

    def again(smaller: Program) -> Outcome:
        return method.run(smaller, monitor)

    groups = problem.groups()
    if not pruning.exact:
        return Solved(whole, prune(program, again, whole, groups, pruning, spared, monitor))
    pruned = best_set(program, again, groups, pruning.sensors, spared, monitor=monitor)
    if pruned is not None:
        return Solved(whole, pruned)
    nan = float("nan")
    text = f"No {pruning.sensors} sensors can meet the bound."
    return Solved(Outcome(Status.INFEASIBLE, text, None, nan, nan, nan, nan, None, whole.feasibility, whole.route))


def _spared(problem: Problem) -> Callable[[np.ndarray], bool] | None:
    """Whether the linearised plant stays as detectable as it is with every sensor; None where there is no plant."""
    if problem.plant is None or problem.prune is None:
        return None
    plant, measurement, _ = problem.dynamics("prune")
    transition, rows = linearise_batch(plant, measurement, problem.batch)
    already = len(undetectable_modes(transition, rows))
    return lambda left: len(undetectable_modes(transition, rows[left])) <= already

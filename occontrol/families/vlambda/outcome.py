"""What a method hands over, and the walks over the horizon that lead there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from occontrol.core.errors import SolveFailed
from occontrol.core.monitor import Monitor
from occontrol.core.solution import Status
from occontrol.families.vlambda.baselines import FixedChooser
from occontrol.families.vlambda.selection import Selection, run_selection
from occontrol.families.vlambda.sensor_choice import Chooser, subsets

if TYPE_CHECKING:
    from occontrol.families.vlambda.problem import Problem

AGREEMENT = 1e-8  # relative, between the cost of the search's recursion and of the filter's


@dataclass(frozen=True)
class Proof:
    """What a search proves, and what it took.

    Parameters
    ----------
    lower_bound : no sequence of choices costs less
    nodes : epochs that the search walked
    log10_sequences, candidates, bound_holds_for : see SelectionResult
    """

    lower_bound: float
    nodes: int
    log10_sequences: float | None = None
    candidates: int | None = None
    bound_holds_for: str | None = None


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a method hands over.

    Parameters
    ----------
    selection : Selection
    status, message : how it ended
    proof : Proof, or None from a rule
    """

    selection: Selection
    status: Status
    message: str
    proof: Proof | None = None


def cost_of(problem: Problem, selection: Selection) -> float:
    """The problem's criterion of P(k|k), summed over k."""
    return float(np.sum(selection.traces if problem.criterion == "trace" else selection.eigenvalues[:, 0]))


def without_rounding(bound: float, cost: float) -> float:
    """The bound, or the cost where it lies above that by no more than two recursions differ.

    A bound farther above the cost is a contradiction and stays, so that the status becomes `disagrees`.

    Parameters
    ----------
    bound : proven, on the search's recursion
    cost : of a choice, on the filter's
    """
    return cost if cost < bound <= cost + AGREEMENT * abs(cost) else bound


def walk(problem: Problem, chooser: Chooser, monitor: Monitor, message: str) -> Outcome:
    """The outcome of a chooser on a problem.

    Parameters
    ----------
    problem : Problem
    chooser : Chooser
    monitor : asked at every step whether to stop
    message : what to say of a run that came to its end
    """
    selection = run_selection(problem.sampled, problem.starts, problem.select, chooser, monitor)
    if selection.held_from is None:
        return Outcome(selection, Status.FEASIBLE, message)
    message = f"interrupted; from k = {selection.held_from} on the last choice is kept"
    return Outcome(selection, Status.INTERRUPTED, message)


def cheapest_fixed(problem: Problem, monitor: Monitor) -> Outcome:
    """Every group of `select` sensors all the time; the one with the smallest cost.

    Parameters
    ----------
    problem : Problem
    monitor : asked at every step and after every group whether to stop

    Raises SolveFailed when there are too many groups.
    """
    groups = subsets(len(problem.sensors), problem.select)
    if groups is None:
        raise SolveFailed(
            "there are too many groups of sensors to try them all\n  hint: fixed needs sensor: [name, ..] here"
        )
    best: Outcome | None = None
    for group in groups:
        names = ", ".join(problem.sensors.names[j] for j in group)
        tried = walk(problem, FixedChooser(group), monitor, f"the best of all fixed choices: {names}")
        # a later group must be better by more than rounding to replace an earlier one
        if best is None or cost_of(problem, tried.selection) < cost_of(problem, best.selection) * (1 - 1e-12):
            best = tried
        if monitor.stop:
            break
    if best is None:
        raise SolveFailed("there is no group of sensors to try")
    return best

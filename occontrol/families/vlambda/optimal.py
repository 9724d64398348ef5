"""The exact optimum of a selection problem: a search over all sequences, its bound, and how it ended."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from occontrol.core.monitor import Monitor
from occontrol.core.solution import Status
from occontrol.families.vlambda.baselines import FixedChooser, RoundRobinChooser, SequenceChooser
from occontrol.families.vlambda.candidates import CandidateSet, candidate_set
from occontrol.families.vlambda.outcome import Outcome, Proof, cost_of, without_rounding
from occontrol.families.vlambda.resume import earlier_search
from occontrol.families.vlambda.selection import Selection, run_selection
from occontrol.families.vlambda.sensor_choice import Chooser, EigenspaceChooser, TraceChooser, subsets
from occontrol.families.vlambda.sequence_search import search

if TYPE_CHECKING:
    from occontrol.families.vlambda.problem import Problem

MOST_FIXED = 12  # groups that stand all the time and are tried beside a search over a grid


def best_sequence(
    problem: Problem, monitor: Monitor, *, max_nodes: int, width: int, time_limit: float | None, grid: int
) -> Outcome:
    """Search all sequences of choices.

    Parameters
    ----------
    problem : Problem
    monitor : Monitor
    max_nodes, width, time_limit, grid : the options of the method `optimal`

    Returns the Outcome with its Proof; status limit where a limit came before the proof. An earlier solution that the
    monitor brings is where the search begins: the outcome never costs more. The bound is proven anew.
    """
    candidates = candidate_set(problem, grid)
    known = [] if problem.movable else [_own_sequence(problem, candidates)]
    holds_for = f"a grid of {grid} locations a coordinate" if problem.movable else None
    earlier = earlier_search(problem, monitor)
    if earlier is not None and (sequence := earlier.among(candidates.candidates)) is not None:
        known.append(sequence)
    watch = monitor.child(time_limit)
    found = search(candidates.problem, incumbents=known, width=width, max_nodes=max_nodes, monitor=watch)
    timed_out = watch.timed_out
    chosen = [candidates.candidates[c] for c in found.sequence]
    chooser = SequenceChooser(tuple(c.sensors for c in chosen), tuple(c.locations for c in chosen))
    selection = _run(problem, chooser)
    status, message = Status.CERTIFIED, "no sequence of choices is better"
    if watch.interrupted:
        status, message = Status.INTERRUPTED, "the best so far"
    elif not found.proven:
        limit = "time_limit" if timed_out else "max_nodes" if found.stopped else "width"
        status, message = Status.LIMIT, f"{limit} came before the proof; raise it, or live with the gap"
    others = [] if earlier is None else [earlier.selection]
    if problem.movable:
        # the rules place sensors freely, so one of them may beat the best on a grid
        others += _rules(problem)
        status = Status.FEASIBLE if status is Status.CERTIFIED else status
        message += f"; movable sensors: the bound holds for {holds_for}"
    selection = min([selection, *others], key=lambda s: cost_of(problem, s) * (1 + 1e-12 * (s is not selection)))
    cost = cost_of(problem, selection)
    proof = Proof(
        # a sensor that is placed freely may beat the bound of a grid; nothing else may
        lower_bound=min(found.lower_bound, cost) if problem.movable else without_rounding(found.lower_bound, cost),
        nodes=found.nodes,
        log10_sequences=problem.epochs * math.log10(len(candidates.candidates)),
        candidates=len(candidates.candidates),
        bound_holds_for=holds_for,
    )
    return Outcome(selection, status, message, proof)


def _run(problem: Problem, chooser: Chooser) -> Selection:
    return run_selection(problem.sampled, problem.starts, problem.select, chooser)


def _rules(problem: Problem) -> list[Selection]:
    """What the rules reach that place sensors freely."""
    fixed = subsets(len(problem.sensors), problem.select, MOST_FIXED) or []
    choosers: list[Chooser] = [EigenspaceChooser(), TraceChooser(), RoundRobinChooser()]
    return [_run(problem, chooser) for chooser in [*choosers, *(FixedChooser(group) for group in fixed)]]


def _own_sequence(problem: Problem, candidates: CandidateSet) -> list[int]:
    """The paper's own sequence: it wins ties, and a good start cuts the search."""
    return [candidates.index_of(c.sensors) for c in _run(problem, EigenspaceChooser()).choices]

"""The exact optimum of a selection problem, and the bound that it puts beside anybody's choices."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from occontrol.core.errors import Mistake, ProblemError
from occontrol.core.monitor import Monitor
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Solution, Status
from occontrol.families.vlambda.methods import Eigenspace, Optimal, RoundRobin, Trace
from occontrol.families.vlambda.problem import Problem
from occontrol.families.vlambda.result import cost_of, finish, recorded
from occontrol.families.vlambda.selection import Selection, run_selection
from occontrol.families.vlambda.sensor_choice import Chooser, FixedChooser, SequenceChooser, subsets

AGREEMENT = 1e-8  # relative; both costs come from the same recursion


def optimal(problem: Problem, method: Optimal, watch: Monitor) -> tuple[Selection, Status, str, dict[str, Any]]:
    """Search all sequences: the selection, how it ended, what to say, and the numbers of the proof.

    Parameters
    ----------
    problem : Problem
    method : Optimal
    watch : Monitor
    """
    from occontrol.families.vlambda.candidates import candidate_set
    from occontrol.families.vlambda.sequence_search import search

    candidates = candidate_set(problem, method.grid)
    known = [] if problem.movable else _incumbents(problem, candidates)
    outer = watch.time_limit
    if method.time_limit is not None:
        limit = method.time_limit + watch.seconds
        watch.time_limit = limit if outer is None else min(limit, outer)
    try:
        found = search(
            candidates.problem, incumbents=known, width=method.width, max_nodes=method.max_nodes, monitor=watch
        )
        timed_out = watch.timed_out
    finally:
        watch.time_limit = outer
    chosen = [candidates.candidates[c] for c in found.sequence]
    chooser = SequenceChooser(tuple(c.sensors for c in chosen), tuple(c.locations for c in chosen))
    selection = run_selection(problem.sampled, problem.starts, problem.select, chooser)
    # the search's recursion and the filter agree to rounding; the bound must not exceed the cost by it
    more: dict[str, Any] = {
        "lower_bound": min(found.lower_bound, cost_of(problem, selection)),
        "nodes": found.nodes,
        "log10_sequences": problem.epochs * math.log10(len(candidates.candidates)),
        "candidates": len(candidates.candidates),
    }
    status, message = Status.CERTIFIED, "no sequence of choices is better"
    if watch.interrupted:
        status, message = Status.INTERRUPTED, "the best so far"
    elif not found.proven:
        limit = "time_limit" if timed_out else "max_nodes" if found.stopped else "width"
        status, message = Status.LIMIT, f"{limit} came before the proof; raise it, or live with the gap"
    if problem.movable:
        # the rules place sensors freely, so one of them may beat the best on a grid
        selection = min(
            [selection, *_rules(problem)], key=lambda s: cost_of(problem, s) * (1 + 1e-12 * (s is not selection))
        )
        more["lower_bound"] = min(more["lower_bound"], cost_of(problem, selection))
        more["bound_holds_for"] = f"a grid of {method.grid} locations a coordinate"
        status = Status.FEASIBLE if status is Status.CERTIFIED else status
        message += f"; movable sensors: the bound holds for {more['bound_holds_for']}"
    return selection, status, message, more


def _rules(problem: Problem) -> list[Selection]:
    """What the rules reach that place sensors freely."""
    fixed = subsets(len(problem.sensors), problem.select, 12) or []
    choosers = [Eigenspace().chooser(problem), Trace().chooser(problem), RoundRobin().chooser(problem)]
    choosers += [FixedChooser(group) for group in fixed]
    return [run_selection(problem.sampled, problem.starts, problem.select, chooser) for chooser in choosers]


def _incumbents(problem: Problem, candidates: Any) -> list[list[int]]:
    """The paper's own sequence: it wins ties, and a good start cuts the search."""
    selection = run_selection(problem.sampled, problem.starts, problem.select, Eigenspace().chooser(problem))
    return [[candidates.index_of(c.sensors) for c in selection.choices]]


@dataclass(frozen=True)
class Claims:
    """What a run folder states: its cost, its bound if any, and where its movable sensors were."""

    cost: float
    lower_bound: float | None
    chooser: SequenceChooser


def claims_of(problem: Problem, solution: Solution) -> Claims:
    """The claims of a Solution, for `certify` to check.

    Parameters
    ----------
    problem, solution : of the run
    """
    bound = solution.result.get("lower_bound")
    return Claims(solution.cost, bound if isinstance(bound, float) else None, recorded(problem, solution))


def certify(problem: Problem, schedule: Schedule, claims: Claims | None = None) -> Solution:
    """Cost of anybody's choices, beside the bound that the exact search proves.

    Parameters
    ----------
    problem : Problem
    schedule : Schedule over k = 0 .. steps that changes only where an epoch begins and uses `select` sensors
    claims : of a run; a cost that cannot be reproduced, or a bound above a known cost, makes the status `disagrees`

    Raises ProblemError when the schedule is not of that kind. Movable sensors stand where the run had them, or are
    placed by the paper's rule; for them no bound is proven, for the search knows only a grid of locations.
    """
    watch, began = Monitor(), time.perf_counter()
    chooser = _given(problem, schedule) if claims is None else claims.chooser
    selection = run_selection(problem.sampled, problem.starts, problem.select, chooser)
    cost = cost_of(problem, selection)
    best, more = cost, {}
    message = "recomputed; no bound is proven with movable sensors"
    if not problem.movable:
        found, _, _, proof = optimal(problem, Optimal(), watch)
        best = min(cost, cost_of(problem, found))
        more = {"lower_bound": min(proof["lower_bound"], cost), "nodes": proof["nodes"]}
        message = "recomputed; the bound is the exact search's"
    proven = bool(more) and cost - more["lower_bound"] <= 1e-9 * abs(cost)
    status = Status.CERTIFIED if proven else Status.FEASIBLE
    if claims is not None and abs(claims.cost - cost) > AGREEMENT * abs(cost):
        status, message = Status.DISAGREES, f"the run says cost {claims.cost:.10g}, its choices cost {cost:.10g}"
    elif claims is not None and claims.lower_bound is not None and claims.lower_bound > best * (1 + AGREEMENT):
        message = f"the run says that nothing costs less than {claims.lower_bound:.10g}, but {best:.10g} is reached"
        status = Status.DISAGREES
    return finish(problem, "given", began, watch, 0, selection, status, message, more)


def _given(problem: Problem, schedule: Schedule) -> Chooser:
    groups = []
    for e in range(problem.epochs):
        begin, end = float(problem.starts[e]), float(problem.starts[e + 1])
        inside = (schedule.edges[1:] > begin) & (schedule.edges[:-1] < end)
        weights = schedule.weights[inside]
        if not len(weights) or np.any(np.abs(weights - weights[0]) > 1e-9):
            wrong = "says nothing about" if not len(weights) else "changes inside of"
            what = f"the schedule {wrong} the epoch k = {begin:g} .. {end - 1:g}"
            raise ProblemError(Mistake((), what, f"choices are made every {problem.epoch} steps"))
        group = tuple(int(j) for j in np.flatnonzero(weights[0] > 0.5))
        if len(group) != problem.select or not np.allclose(weights[0][list(group)], 1.0):
            raise ProblemError(
                Mistake((), f"the schedule uses {len(group)} sensors at k = {begin:g}, select is {problem.select}")
            )
        groups.append(group)
    return SequenceChooser(tuple(groups))

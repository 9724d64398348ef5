"""Switching sensors against the worst admissible uncertainty (Savkin, Evans & Skafidas)."""

from __future__ import annotations

import itertools
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from occontrol.core.clock import nearest_edge
from occontrol.core.errors import Mistake, ProblemError
from occontrol.core.measurement import Estimate, Measurement
from occontrol.core.monitor import Monitor
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Solution, Status
from occontrol.core.trajectory import Trajectory
from occontrol.families.robust.methods import (
    All,
    BestSingle,
    Fixed,
    OneStep,
    Optimal,
    Random,
    RelaxedShares,
    RoundRobin,
)
from occontrol.families.robust.problem import Problem
from occontrol.families.robust.result import claims_of, finish, finish_shares, infeasible
from occontrol.families.robust.slots import Slots, one_step, slot_table
from occontrol.families.robust.text import describe, summarise, truth_remark

if TYPE_CHECKING:
    from occontrol.families.athans.certificate import Claims

__all__ = [
    "COMPARE",
    "METHODS",
    "Problem",
    "certify",
    "claims_of",
    "describe",
    "online",
    "run_filter",
    "simulate",
    "solve",
    "summarise",
    "table",
    "truth_remark",
]

METHODS: dict[str, type] = {
    m.name: m for m in (Optimal, OneStep, Fixed, All, RelaxedShares, BestSingle, RoundRobin, Random)
}
COMPARE = ["optimal", "one-step", "best-single", "round-robin", "random"]
RANKED = 10_000  # sequences of `all` that result.json lists
_TEXT = {
    "one-step": "One step ahead: a greedy rule, the bound says what it may cost.",
    "fixed": "The given sequence; the bound says what another one could save.",
    "best-single": "A baseline.",
    "round-robin": "A baseline.",
    "random": "A baseline.",
}


def table(problem: Problem) -> Slots | None:
    """Every slot with every sensor; None when the plant is not uniformly robustly observable.

    Parameters
    ----------
    problem : Problem
    """
    plant = problem.plant
    return slot_table(problem.flow, problem.edges, plant.weight, plant.center, plant.level, problem.measure)


def solve(problem: Problem, method: Any = None, monitor: Monitor | None = None) -> Solution:
    """Find a sequence of sensors and prove how good it is.

    Parameters
    ----------
    problem : Problem
    method : a METHODS value; the problem's own, or Optimal(), if left out
    monitor : Monitor

    Returns a Solution; its status is `infeasible` (with the observability horizon) when no schedule keeps the set of
    possible states bounded for all measurements.
    """
    method = method or problem.method or Optimal()
    watch = (Monitor() if monitor is None else monitor).child(getattr(method, "time_limit", None))
    began = time.perf_counter()
    sequence = None
    if isinstance(method, Fixed):
        sequence, mistakes = method.resolve(problem.sensors.names, problem.slots)
        if mistakes:
            raise ProblemError([m.under("method") for m in mistakes])
    elif isinstance(method, RoundRobin):
        sequence = [k % len(problem.sensors) for k in range(problem.slots)]
    elif isinstance(method, Random):
        drawn = np.random.default_rng(method.seed).integers(len(problem.sensors), size=problem.slots)
        sequence = [int(i) for i in drawn]
    if isinstance(method, All):
        _refuse_too_many(problem, method)
    slots = table(problem)
    if slots is None:
        return infeasible(problem, method.name, began, sequence)
    if isinstance(method, Optimal):
        return _optimal(problem, slots, method, began, watch)
    if isinstance(method, All):
        return _all(problem, slots, method, began, watch)
    from occontrol.families.robust.bound import relaxed_policy

    if isinstance(method, RelaxedShares):
        weights, _, bound = relaxed_policy(slots, method.relative_gap, watch)
        return finish_shares(problem, slots, method, began, watch, weights, bound)
    if sequence is None:
        sequence = _baseline(problem, slots, method)
    bound = relaxed_policy(slots, monitor=watch)[2]
    return finish(problem, slots, method.name, began, watch, sequence, bound, Status.FEASIBLE, _TEXT[method.name], {})


def _baseline(problem: Problem, slots: Slots, method: Any) -> list[int]:
    plant, M, N = problem.plant, slots.sensors, slots.count
    if isinstance(method, OneStep):
        return one_step(slots, plant.weight, plant.center, plant.level)
    return [int(np.argmin(slots.costs(np.repeat(np.arange(M)[:, None], N, axis=1))))] * N


def _optimal(problem: Problem, slots: Slots, method: Optimal, began: float, watch: Monitor) -> Solution:
    from occontrol.families.robust.search import SearchOptions, search

    greedy = one_step(slots, problem.plant.weight, problem.plant.center, problem.plant.level)
    options = SearchOptions(method.relative_gap, method.merge_above, method.width, method.node_limit)
    found = search(slots, [greedy], options, watch)
    gap = (found.cost - found.lower_bound) / abs(found.cost)
    total = f"of {slots.sensors}^{slots.count} sequences, {found.nodes} nodes were looked at"
    if watch.interrupted:
        status, message = Status.INTERRUPTED, f"{Status.INTERRUPTED.text} {total}."
    elif gap <= max(method.relative_gap, 1e-10):
        exact = gap <= 1e-10
        proof = "No sequence is better" if exact else f"No sequence is better by more than {100 * gap:.3g} %"
        status, message = Status.CERTIFIED, f"{proof}: {total}."
    else:
        status = Status.LIMIT
        message = f"{found.limit or 'the relaxation'} ended the proof at a gap of {100 * gap:.3g} %: {total}."
    extra = {
        "nodes": found.nodes,
        "widest_layer": found.widest,
        "merged": found.merged,
        "dropped": found.dropped,
        "limit": found.limit,
        "relaxed_bound": found.relaxed_bound,
        "one_step_cost": slots.cost(greedy),
    }
    return finish(problem, slots, method.name, began, watch, found.sequence, found.lower_bound, status, message, extra)


def _refuse_too_many(problem: Problem, method: All) -> None:
    N, M = problem.slots, len(problem.sensors)
    if N * np.log(M) > np.log(method.limit) + 1e-12:
        what = f"method all would rank {M}^{N} sequences, its limit is {method.limit}"
        raise ProblemError(Mistake(("method",), what, "use method optimal: it proves the best one without them"))


def _all(problem: Problem, slots: Slots, method: All, began: float, watch: Monitor) -> Solution:
    N, M = slots.count, slots.sensors
    sequences = np.array(list(itertools.product(range(M), repeat=N)), dtype=np.int16)
    costs = slots.costs(sequences)
    order = np.argsort(costs, kind="stable")
    sequences, costs = sequences[order], costs[order]
    names = problem.sensors.names
    ranking = [
        {"cost": float(c), "sequence": [names[i] for i in s]}
        for c, s in zip(costs[:RANKED], sequences[:RANKED], strict=True)
    ]
    extra = {"sequences": len(costs), "worst_cost": float(costs[-1]), "ranking": ranking, "nodes": len(costs)}
    message = f"The best of all {len(costs)} sequences; the worst has {costs[-1]:.8g}."
    arrays = {"sequences": sequences, "costs": costs}
    best = float(costs[0])
    return finish(
        problem, slots, method.name, began, watch, sequences[0], best, Status.CERTIFIED, message, extra, arrays
    )


def certify(problem: Problem, schedule: Schedule, claims: Claims | None = None) -> Solution:
    """Cost, lower bound and gap of anybody's schedule, everything recomputed.

    Parameters
    ----------
    problem : Problem
    schedule : Schedule over the same horizon with one sensor at a time; where it switches within a slot, the slots are
        cut there, and the bound holds for the finer slots
    claims : what somebody says of it; refuted claims make the status `disagrees`
    """
    import dataclasses

    from occontrol.families.athans.certificate import false_claims

    began, watch = time.perf_counter(), Monitor()
    _, near = nearest_edge(schedule.edges, problem.edges)
    if np.any(~near):
        edges = np.sort(np.concatenate([problem.edges, schedule.edges[~near]]))
        problem = dataclasses.replace(problem, edges=edges, method=None)
    middle = (problem.edges[1:] + problem.edges[:-1]) / 2
    which = np.clip(np.searchsorted(schedule.edges, middle, side="right") - 1, 0, len(schedule.weights) - 1)
    order = [schedule.names.index(name) for name in problem.sensors.names]
    weights = schedule.weights[which][:, order]
    if not schedule.is_integer or np.any(np.abs(np.sum(weights, axis=1) - 1) > 1e-6):
        raise ProblemError("the schedule does not use exactly one sensor at a time", "one sensor per slot")
    sequence = [int(i) for i in np.argmax(weights, axis=1)]
    slots = table(problem)
    if slots is None:
        return infeasible(problem, "certify", began, sequence)
    from occontrol.families.robust.search import search

    found = search(slots, [sequence], monitor=watch)
    message = f"The best sequence known costs {found.cost:.8g}; none costs less than {found.lower_bound:.8g}."
    extra = {"nodes": found.nodes, "best_known_cost": found.cost}
    solution = finish(
        problem, slots, "certify", began, watch, sequence, found.lower_bound, Status.FEASIBLE, message, extra
    )
    level = {"level": solution.result["level"]}
    refuted = [] if claims is None else false_claims(claims, solution.cost, found.cost, parts=level)
    return dataclasses.replace(solution, status=Status.DISAGREES, message="; ".join(refuted)) if refuted else solution


def simulate(problem: Problem, solution: Solution | None, seed: int = 0) -> tuple[list[Measurement], Trajectory]:
    """An admissible truth, drawn at random, and what the scheduled sensors report of it.

    Parameters
    ----------
    problem : Problem
    solution : Solution whose schedule is followed; the problem is solved if None
    seed : of the generator
    """
    from occontrol.families.robust.data import simulate_admissible

    chosen = solution or solve(problem)
    return simulate_admissible(
        problem.flow,
        problem.plant,
        problem.sensors.names,
        problem.edges,
        sequence_of(problem, chosen),
        problem.samples,
        seed,
    )


def run_filter(problem: Problem, solution: Solution, measurements: Sequence[Measurement]) -> Estimate:
    """The set of possible states over a measurement file: center, half widths along every state, shape times level.

    Parameters
    ----------
    problem, solution : of the run
    measurements : list of Measurement; a value is held since the sampling time before it
    """
    from occontrol.families.robust.data import filter_samples

    return filter_samples(
        problem.flow,
        problem.plant,
        problem.sensors.names,
        problem.edges,
        sequence_of(problem, solution),
        problem.samples,
        measurements,
    )


def sequence_of(problem: Problem, solution: Solution) -> list[int]:
    """The sensor of every slot in a solution's schedule; ProblemError when it shares slots between sensors.

    Parameters
    ----------
    problem : Problem
    solution : Solution
    """
    weights = solution.arrays.get("weights")
    if weights is None or np.any(np.abs(np.max(weights, axis=1) - 1) > 1e-6):
        raise ProblemError("this run shares slots between sensors; it has no schedule to follow", "use method optimal")
    return [int(i) for i in np.argmax(weights, axis=1)]


def online(problem: Problem) -> Any:
    """The on-line object: takes measurements, returns the set and the next sensor (families/robust/online.py).

    Parameters
    ----------
    problem : Problem

    Raises InfeasibleError when the plant is not uniformly robustly observable.
    """
    from occontrol.core.errors import InfeasibleError
    from occontrol.families.robust.online import OnlineSwitching

    slots = table(problem)
    if slots is None:
        raise InfeasibleError(infeasible(problem, "online", time.perf_counter(), None).message)
    return OnlineSwitching(slots, problem.plant)

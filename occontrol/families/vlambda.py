"""On-line selection along the worst eigendirection (Oshman 1994), with baselines, look-ahead and the exact optimum."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from occontrol.core.errors import Mistake, ProblemError, SolveFailed
from occontrol.core.measurement import Estimate, Measurement
from occontrol.core.monitor import Monitor
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Certificate, Solution, Status
from occontrol.core.trajectory import Trajectory
from occontrol.families.vlambda_problem import Problem
from occontrol.families.vlambda_text import describe, summarise
from occontrol.filtering.selection import Selection, run_selection
from occontrol.solvers.choosers import Eigenspace, Fixed, Lookahead, Optimal, Random, RoundRobin, Trace
from occontrol.solvers.sensor_choice import Chooser, FixedChooser, SequenceChooser, subsets

__all__ = ["COMPARE", "METHODS", "Problem", "certify", "describe", "method_named", "run_filter", "simulate", "solve", "summarise"]

METHODS: dict[str, type] = {m.name: m for m in (Eigenspace, Fixed, RoundRobin, Random, Trace, Lookahead, Optimal)}
COLUMNS = ("sum_largest_eigenvalue", "sum_trace", "peak_largest_eigenvalue")


def COMPARE(problem: Problem) -> list[str]:  # noqa: N802
    """The paper's rule, every fixed sensor (one `select` at a time), the baselines, and what looks further."""
    names = problem.sensors.names
    fixed = [f"fixed:{name}" for name in names] if problem.select == 1 and len(names) <= 12 else ["fixed"]
    return ["eigenspace", *fixed, "round-robin", "random", "trace", "lookahead", "optimal"]


def method_named(problem: Problem, name: str) -> Any:
    """The options of a method that carries its argument, "fixed:one+two" or "lookahead:3"; None for any other name."""
    head, colon, argument = name.partition(":")
    method: Any = None
    if colon and head == "fixed":
        method = Fixed(argument if argument in problem.sensors.names else argument.split("+"))
    elif colon and head == "lookahead" and argument.isdecimal():
        method = Lookahead(depth=int(argument))
    if method is not None:
        mistakes = [m.under("method") for m in method.check(problem)]
        if mistakes:
            raise ProblemError(mistakes)
    return method


def solve(problem: Problem, method: Any = None, monitor: Monitor | None = None) -> Solution:
    """Select sensors over the horizon with one method and evaluate what the filter makes of it.

    Parameters
    ----------
    problem : Problem
    method : a METHODS value; the problem's own, or Eigenspace(), if left out
    monitor : Monitor

    Returns Solution. Raises InfeasibleError when a movable sensor has nowhere to be, SolveFailed when a search would be too large.
    """
    watch = Monitor() if monitor is None else monitor
    method = method or problem.method or Eigenspace()
    before = len(watch.history)
    began = time.perf_counter()
    if isinstance(method, Optimal):
        return _finish(problem, method.name, began, watch, before, *_optimal(problem, method, watch))
    if isinstance(method, Fixed) and method.sensor is None:
        selection, message = _best_fixed(problem, watch)
    else:
        selection = run_selection(problem.sampled, problem.starts, problem.select, method.chooser(problem), watch)
        message = "selected on-line; a rule proves no bound" if method.name not in ("fixed", "random", "round-robin") else "a baseline"
    if selection is None:
        raise SolveFailed("interrupted before the horizon was over, nothing usable")
    return _finish(problem, method.name, began, watch, before, selection, Status.FEASIBLE, message, {})


def _cost(problem: Problem, selection: Selection) -> float:
    return float(np.sum(selection.traces if problem.criterion == "trace" else selection.eigenvalues[:, 0]))


def _best_fixed(problem: Problem, watch: Monitor) -> tuple[Selection | None, str]:
    """Every group of `select` sensors all the time; the one with the smallest cost."""
    groups = subsets(len(problem.sensors), problem.select)
    if groups is None:
        raise SolveFailed("there are too many groups of sensors to try them all\n  hint: fixed needs sensor: [name, ..] here")
    best, best_group = None, ()
    for group in groups:
        selection = run_selection(problem.sampled, problem.starts, problem.select, FixedChooser(group), watch)
        if selection is None:
            break
        if best is None or _cost(problem, selection) < _cost(problem, best) * (1 - 1e-12):
            best, best_group = selection, group
    return best, f"the best of all fixed choices: {', '.join(problem.sensors.names[j] for j in best_group)}"


def _optimal(problem: Problem, method: Optimal, watch: Monitor) -> tuple[Selection, Status, str, dict[str, Any]]:
    from occontrol.solvers.candidates import candidate_set
    from occontrol.solvers.sequence_search import search

    candidates = candidate_set(problem, method.grid)
    known = [] if problem.movable else _incumbents(problem, candidates)
    outer = watch.time_limit
    if method.time_limit is not None:
        limit = method.time_limit + watch.seconds
        watch.time_limit = limit if outer is None else min(limit, outer)
    try:
        found = search(candidates.problem, incumbents=known, width=method.width, max_nodes=method.max_nodes, monitor=watch)
        timed_out = watch.timed_out
    finally:
        watch.time_limit = outer
    chosen = [candidates.candidates[c] for c in found.sequence]
    chooser = SequenceChooser(tuple(c.sensors for c in chosen), tuple(c.locations for c in chosen))
    selection = run_selection(problem.sampled, problem.starts, problem.select, chooser)
    if selection is None:
        raise SolveFailed("nothing usable")
    # the search's recursion and the filter agree to rounding; the bound must not exceed the cost by it
    lower = min(found.lower_bound, _cost(problem, selection))
    where = f", movable sensors on a grid of {method.grid} points a coordinate" if problem.movable else ""
    if found.proven:
        status, message = Status.CERTIFIED, f"no sequence of choices is better{where}"
    elif watch.interrupted:
        status, message = Status.INTERRUPTED, f"the best so far{where}"
    else:
        limit = "time_limit" if timed_out else "max_nodes" if found.stopped else "width"
        status, message = Status.LIMIT, f"{limit} came before the proof; raise it, or live with the gap{where}"
    more = {
        "lower_bound": lower,
        "nodes": found.nodes,
        "sequences": float(len(candidates.candidates)) ** problem.epochs,
        "candidates": len(candidates.candidates),
    }
    return selection, status, message, more


def _incumbents(problem: Problem, candidates: Any) -> list[list[int]]:
    """The paper's own sequence: it wins ties, and a good start cuts the search."""
    selection = run_selection(problem.sampled, problem.starts, problem.select, Eigenspace().chooser(problem))
    return [] if selection is None else [[candidates.index_of(c.sensors) for c in selection.choices]]


def _finish(
    problem: Problem,
    method: str,
    began: float,
    watch: Monitor,
    before: int,
    selection: Selection,
    status: Status,
    message: str,
    more: dict[str, Any],
) -> Solution:
    names, scales = problem.sensors.names, problem.scales
    cost, largest = _cost(problem, selection), selection.eigenvalues[:, 0]
    deviations = np.sqrt(np.einsum("kii->ki", selection.covariance)) * scales
    weights = np.zeros((problem.epochs, len(names)))
    for e, choice in enumerate(selection.choices):
        weights[e, list(choice.sensors)] = 1.0
    schedule = Schedule(problem.starts.astype(float), weights, tuple(names))
    certificate = Certificate(cost, more["lower_bound"]) if "lower_bound" in more else None
    result: dict[str, Any] = {
        "cost": cost,
        "criterion": problem.criterion,
        "schedule": [_entry(problem, e, c) for e, c in enumerate(selection.choices)],
        "sum_trace": float(np.sum(selection.traces)),
        "sum_largest_eigenvalue": float(np.sum(largest)),
        "peak_largest_eigenvalue": float(np.max(largest[1:] if len(largest) > 1 else largest)),
        "standard_deviations": deviations[-1].tolist(),
        "switches": schedule.switches,
        "notes": list(selection.notes),
        **more,
    }
    if certificate is not None:
        result["relative_gap"] = certificate.relative_gap
    arrays = {
        "times": np.arange(problem.steps, dtype=float),
        "edges": schedule.edges,
        "weights": weights,
        "standard_deviations": deviations,
        "largest_eigenvalue": largest,
        "eigenvalues": selection.eigenvalues,
        "eigenvectors": selection.eigenvectors,
        "predicted_eigenvalues": selection.predicted_eigenvalues,
        "covariance": selection.covariance * np.outer(scales, scales),
        "scores": np.array([c.scores for c in selection.choices]),
        "selected": _selected(selection, problem.select),
    }
    seconds = time.perf_counter() - began
    return Solution(
        "vlambda", method, status, message, problem.epochs, seconds, result, arrays, schedule, certificate,
        tuple(watch.history[before:]),
    )  # fmt: skip


def _selected(selection: Selection, select: int) -> np.ndarray:
    """(E,) index of the sensor in the problem's order, from 0; (E, select) when several are used at a time."""
    indices = np.array([c.sensors for c in selection.choices], dtype=np.int64)
    return indices[:, 0] if select == 1 else indices


def _entry(problem: Problem, epoch: int, choice: Any) -> dict[str, Any]:
    names = problem.sensors.names
    entry: dict[str, Any] = {
        "epoch": epoch,
        "k": int(problem.starts[epoch]),
        "sensors": [names[j] for j in choice.sensors],
        "scores": [float(x) for x in choice.scores],
        "location": None,
    }
    if choice.locations:
        # in the order of `sensors`; `locations` says whose they are
        entry["location"] = [float(x) for j in choice.sensors if j in choice.locations for x in choice.locations[j]]
        entry["locations"] = {names[j]: [float(x) for x in p] for j, p in choice.locations.items()}
    return entry


def _recorded(problem: Problem, solution: Solution) -> SequenceChooser:
    """The chooser that repeats a solution's choices, locations included."""
    groups, places = [], []
    for entry in solution.result["schedule"]:
        groups.append(tuple(sorted(problem.sensors.index(name) for name in entry["sensors"])))
        where = entry.get("locations") or {}
        places.append({problem.sensors.index(name): np.array(p, dtype=float) for name, p in where.items()})
    return SequenceChooser(tuple(groups), tuple(places))


def simulate(problem: Problem, solution: Solution | None, seed: int = 0) -> tuple[list[Measurement], Trajectory]:
    """A true trajectory x(0) .. x(K-1) and what the selected sensors report of it, one Measurement per sensor and step.

    Parameters
    ----------
    problem : Problem
    solution : Solution whose choices are followed; solved with the problem's own method if None
    seed : of the generator
    """
    from occontrol.filtering.eigenfactor_data import simulate_selection

    chosen = solution or solve(problem)
    return simulate_selection(problem.sampled, problem.starts, problem.select, _recorded(problem, chosen), seed)


def run_filter(problem: Problem, solution: Solution, measurements: Sequence[Measurement]) -> Estimate:
    """The V-Lambda filter over a measurement file, with the solution's choices.

    Parameters
    ----------
    problem, solution : of the run
    measurements : list of Measurement, t = k

    Raises ProblemError for a sensor that does not exist, a t that is no step, or the wrong number of values.
    """
    from occontrol.filtering.eigenfactor_data import filter_measurements

    return filter_measurements(
        problem.sampled, problem.starts, problem.select, _recorded(problem, solution), measurements
    )


def certify(problem: Problem, schedule: Schedule) -> Solution:
    """Cost of anybody's choices, beside the bound that the exact search proves.

    Parameters
    ----------
    problem : Problem
    schedule : Schedule over k = 0 .. steps that changes only where an epoch begins and uses `select` sensors

    Raises ProblemError when the schedule is not of that kind. Movable sensors are placed by the paper's rule, and for
    them no bound is proven, for the search knows only a grid of locations.
    """
    watch, began = Monitor(), time.perf_counter()
    chooser = _given(problem, schedule)
    selection = run_selection(problem.sampled, problem.starts, problem.select, chooser)
    if selection is None:
        raise SolveFailed("nothing usable")
    more: dict[str, Any] = {}
    message = "recomputed; no bound is proven with movable sensors"
    if not problem.movable:
        bound = _optimal(problem, Optimal(), watch)[3]
        more = {"lower_bound": min(bound["lower_bound"], _cost(problem, selection)), "nodes": bound["nodes"]}
        message = "recomputed; the bound is the exact search's"
    proven = bool(more) and _cost(problem, selection) - more["lower_bound"] <= 1e-9 * abs(_cost(problem, selection))
    status = Status.CERTIFIED if proven else Status.FEASIBLE
    return _finish(problem, "given", began, watch, 0, selection, status, message, more)


def _given(problem: Problem, schedule: Schedule) -> Chooser:
    groups = []
    for e in range(problem.epochs):
        begin, end = float(problem.starts[e]), float(problem.starts[e + 1])
        inside = (schedule.edges[1:] > begin) & (schedule.edges[:-1] < end)
        weights = schedule.weights[inside]
        if not len(weights) or np.any(np.abs(weights - weights[0]) > 1e-9):
            what = f"the schedule {'says nothing about' if not len(weights) else 'changes inside of'} the epoch k = {begin:g} .. {end - 1:g}"
            raise ProblemError(Mistake((), what, f"choices are made every {problem.epoch} steps"))
        group = tuple(int(j) for j in np.flatnonzero(weights[0] > 0.5))
        if len(group) != problem.select or not np.allclose(weights[0][list(group)], 1.0):
            raise ProblemError(Mistake((), f"the schedule uses {len(group)} sensors at k = {begin:g}, select is {problem.select}"))
        groups.append(group)
    return SequenceChooser(tuple(groups))

"""What a robust solve reports: numbers, arrays, the independent check, and why there is no schedule."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from occontrol.core.errors import SolveFailed
from occontrol.core.monitor import Monitor
from occontrol.core.result import PlainResult
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Certificate, Solution, Status
from occontrol.families.athans.certificate import Claims
from occontrol.families.robust.check import integrate
from occontrol.families.robust.escape import escape_time, first_lost, free_weights, gain_that_fits, horizon
from occontrol.families.robust.game import center_weight, from_ordinary
from occontrol.families.robust.history import history
from occontrol.families.robust.problem import Problem
from occontrol.families.robust.slots import Slots

BEYOND = 20.0  # horizons that a time-varying plant is followed for its observability horizon
AGREEMENT = 1e-6


def observability(problem: Problem) -> tuple[float | None, float | None]:
    """The supremum of T with X on [t0, T] and X(t0) < X0, and how far a time-varying plant was followed.

    Parameters
    ----------
    problem : Problem

    Returns (horizon or None, followed-to or None); a constant plant is decided for all T.
    """
    start, end = float(problem.edges[0]), float(problem.edges[-1])
    if problem.plant_flow.constant:
        return horizon(problem.plant_flow, problem.plant.weight, start), None
    limit = start + BEYOND * (end - start)
    try:
        return horizon(problem.plant_flow, problem.plant.weight, start, limit), limit
    except SolveFailed:  # the formulas end somewhere beyond the problem's own horizon
        return horizon(problem.plant_flow, problem.plant.weight, start, end), end


def infeasible(problem: Problem, method: str, began: float, sequence: Sequence[int] | None) -> Solution:
    """The result when the plant is not uniformly robustly observable: which test fails, when, and what would mend it.

    Parameters
    ----------
    problem : Problem
    method : its name
    began : time.perf_counter() at the start
    sequence : the schedule that was asked for, if one was
    """
    plant, edges = problem.plant, problem.edges
    reach, _ = observability(problem)
    factor = gain_that_fits(problem.plant_flow, plant.weight, edges)
    result: dict[str, Any] = {"name": problem.name, "cost": None, "lower_bound": None, "relative_gap": None}
    lost = first_lost(problem.plant_flow, edges)
    free = free_weights(problem.plant_flow, edges)
    if lost is not None:
        why = f"X, followed back from t = {edges[-1]:g}, escapes at t = {lost:.10g}"
    else:
        margin = float(np.linalg.eigvalsh(plant.weight - free[0])[0]) if free is not None else -np.inf
        why = f"X({edges[0]:g}) is not below the weight: their difference has the eigenvalue {margin:.6g}"
    named = f"{reach:.12g}" if reach is not None else "unknown"
    message = (
        f"not uniformly robustly observable on [{edges[0]:.12g}, {edges[-1]:.12g}], whatever the sensors: {why}. "
        f"The observability horizon is t = {named}: end before it, or multiply K by less than {factor:.10g}."
    )
    result |= {"observability_horizon": reach, "level": None, "X_initial": None, "Y_initial": None}
    result |= {"gain_factor": factor, "X_escape_time": lost}
    if free is not None:
        result["X_initial"] = free[0].tolist()
    if sequence is not None:
        escape = escape_time(problem.flow, plant.weight, edges, sequence)
        result["escape_time"] = escape
        if escape is None:
            message += (
                " With this schedule P itself lives to the end: the plant is robustly, not uniformly, observable."
            )
        else:
            message += f" With this schedule P escapes at t = {escape:.12g}."
    result["schedule"] = []
    return Solution(
        "robust", method, Status.INFEASIBLE, message, 0, time.perf_counter() - began, PlainResult(result), {},
        problem=problem,
    )


def finish(
    problem: Problem,
    slots: Slots,
    method: str,
    began: float,
    watch: Monitor,
    sequence: Sequence[int],
    lower_bound: float,
    status: Status,
    message: str,
    extra: dict[str, Any],
    arrays: dict[str, np.ndarray] | None = None,
) -> Solution:
    """The Solution of one sequence.

    Parameters
    ----------
    problem, slots : the problem and its table
    method, began, watch : name, start time, Monitor
    sequence : (N,) sensor of every slot
    lower_bound : proven
    status, message : how it ended
    extra, arrays : what the method adds
    """
    plant, edges, names = problem.plant, problem.edges, tuple(problem.sensors.names)
    sequence = [int(i) for i in sequence]
    cost = slots.cost(sequence)
    weights = np.zeros((slots.count, slots.sensors))
    weights[np.arange(slots.count), sequence] = 1.0
    schedule = Schedule(edges, weights, names)
    ordinary = slots.ordinary(sequence)
    shape = from_ordinary(ordinary, slots.free)
    along = history(problem.flow, edges, sequence, plant.weight, plant.center, plant.level, slots.size)
    certificate = Certificate(cost, min(lower_bound, cost))
    judged = integrate(problem.flow, edges, sequence, plant.weight, plant.center, plant.level, slots.size)
    independent = None
    if judged is not None:
        independent = {"cost": judged.cost, "level": judged.level, "Y_initial": judged.center_weight.tolist()}
        if abs(judged.cost - cost) > AGREEMENT * abs(cost):
            status = Status.DISAGREES
            message = f"direct integration gives {judged.cost:.10g}, the span elements {cost:.10g}"
    reach, followed = observability(problem)
    Y = center_weight(slots.free, shape)
    result: dict[str, Any] = {
        "name": problem.name,
        **certificate.as_dict(),
        "level": slots.level,
        "size": dict(slots.size.terms),
        "observability_horizon": reach,
        "observability_followed_to": followed,
        "X_initial": slots.free[0].tolist(),
        "Y_initial": Y[0].tolist(),
        "sequence": [names[i] for i in sequence],
        "switches": schedule.switches,
        "independent": independent,
        **extra,
        "schedule": schedule.segments(),
    }
    kept = {
        "times": edges,
        "edges": edges,
        "weights": weights,
        "shape": shape,
        "ordinary": ordinary,
        "center_weight": Y,
        "free_weight": slots.free,
        "fine_times": along.times,
        "fine_shape": along.shape,
        "fine_level": along.level,
        "fine_size": along.size,
        **(arrays or {}),
    }
    return Solution(
        family="robust",
        method=method,
        status=status,
        message=message,
        iterations=int(extra.get("nodes", 0)),
        seconds=time.perf_counter() - began,
        numbers=PlainResult(result),
        arrays=kept,
        schedule=schedule,
        certificate=certificate,
        history=tuple(watch.history),
        problem=problem,
    )


def finish_shares(
    problem: Problem, slots: Slots, method: Any, began: float, watch: Monitor, weights: np.ndarray, bound: float
) -> Solution:
    """The Solution of the relaxation: slots shared between sensors.

    Parameters
    ----------
    problem, slots : the problem and its table
    method, began, watch : options, start time, Monitor
    weights : (N, M) shares
    bound : proven lower bound for every sequence
    """
    from occontrol.families.robust.bound import walk

    path = walk(slots, weights, slots.start)
    cost = float(slots.size.value(path.ordinary[-1], slots.level))
    certificate = Certificate(cost, min(bound, cost))
    schedule = Schedule(problem.edges, weights, tuple(problem.sensors.names))
    shape = from_ordinary(path.ordinary, slots.free)
    Y = center_weight(slots.free, shape)
    reach, followed = observability(problem)
    reached = certificate.relative_gap <= max(method.relative_gap, 1e-3)
    status = Status.INTERRUPTED if watch.interrupted else Status.CERTIFIED if reached else Status.LIMIT
    message = f"No sequence on these slots has a size below {certificate.lower_bound:.10g}. The shares are no schedule."
    result: dict[str, Any] = {
        "name": problem.name,
        **certificate.as_dict(),
        "level": slots.level,
        "size": dict(slots.size.terms),
        "observability_horizon": reach,
        "observability_followed_to": followed,
        "X_initial": slots.free[0].tolist(),
        "Y_initial": Y[0].tolist(),
        "singular_fraction": schedule.singular_fraction,
        "schedule": schedule.segments(),
    }
    arrays = {
        "times": problem.edges,
        "edges": problem.edges,
        "weights": weights,
        "shape": shape,
        "ordinary": path.ordinary,
        "center_weight": Y,
        "free_weight": slots.free,
    }
    return Solution(
        family="robust",
        method=method.name,
        status=status,
        message=message,
        iterations=0,
        seconds=time.perf_counter() - began,
        numbers=PlainResult(result),
        arrays=arrays,
        schedule=schedule,
        certificate=certificate,
        history=tuple(watch.history),
        problem=problem,
    )


def claims_of(problem: Problem, solution: Solution) -> Claims:
    """What a run says of its sequence, for `certify` to check.

    Parameters
    ----------
    problem, solution : of the run
    """
    stated = [solution.result.get(name) for name in ("cost", "lower_bound", "relative_gap", "level")]
    cost, bound, gap, level = (float(x) if isinstance(x, int | float) else None for x in stated)
    return Claims(cost, bound, None, gap, {} if level is None else {"level": level})

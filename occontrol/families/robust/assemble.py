"""Solutions of the robust family: numbers, arrays and the independent check, all put together in one place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from occontrol.core import stopwatch
from occontrol.core.kinds import PlainDict, PlainMapping
from occontrol.core.monitor import Monitor
from occontrol.core.printed import rounded_down
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Certificate, Solution, Status, make_solution
from occontrol.families.robust.check import integrate
from occontrol.families.robust.game import center_weight, from_ordinary
from occontrol.families.robust.history import history
from occontrol.families.robust.observability import observability, unobservable
from occontrol.families.robust.problem import Problem
from occontrol.families.robust.result import Independent, SequenceResult, SharesResult, SwitchingResult
from occontrol.families.robust.slots import Slots

AGREEMENT = 1e-6  # of the cost, between the span elements and the independent check


def solution_of(
    problem: Problem,
    numbers: SwitchingResult,
    *,
    method: str,
    status: Status,
    message: str,
    arrays: Mapping[str, np.ndarray] | None = None,
    schedule: Schedule | None = None,
    certificate: Certificate | None = None,
    iterations: int = 0,
    monitor: Monitor | None = None,
) -> Solution:
    """The Solution that holds these numbers; its `seconds` are for the caller to fill in.

    Parameters
    ----------
    problem, numbers : the problem and what was found
    method, status, message, schedule, certificate, iterations : as in Solution
    arrays : by name, as in Solution; for example edges (N+1,)
    monitor : whose history is kept
    """
    return make_solution(
        problem=problem,
        method=method,
        status=status,
        message=message,
        iterations=iterations,
        numbers=numbers,
        arrays=arrays,
        schedule=schedule,
        certificate=certificate,
        monitor=monitor or Monitor(),
        began=stopwatch.seconds(),
    )


def unobservable_solution(problem: Problem, method: str, sequence: Sequence[int] | None) -> Solution:
    """The Solution where the plant is not uniformly robustly observable.

    Parameters
    ----------
    problem, method : the problem and the method's name
    sequence : (N,) the schedule that was asked for, if one was
    """
    numbers, message = unobservable(problem, sequence)
    return solution_of(problem, numbers, method=method, status=Status.INFEASIBLE, message=message)


def sequence_solution(
    problem: Problem,
    slots: Slots,
    sequence: Sequence[int] | np.ndarray,
    *,
    method: str,
    lower_bound: float,
    status: Status,
    message: str,
    monitor: Monitor,
    numbers: PlainMapping | None = None,
    arrays: Mapping[str, np.ndarray] | None = None,
) -> Solution:
    """The Solution of one sequence, whose cost is checked by direct integration.

    Parameters
    ----------
    problem, slots : the problem and its table
    sequence : (N,) sensor of every slot
    method, status, message, monitor : name, how it ended, and who watched
    lower_bound : proven; where it lies above the cost by more than rounding the status is `disagrees`
    numbers : further fields of SequenceResult that the method states
    arrays : what the method adds, by name, for example weights (N, M)
    """
    plant, edges, names = problem.plant, problem.edges, tuple(problem.sensors.names)
    sequence = [int(i) for i in sequence]
    cost = slots.cost(sequence)
    weights = np.zeros((slots.count, slots.sensors))
    weights[np.arange(slots.count), sequence] = 1.0
    schedule = Schedule(edges, weights, names)
    ordinary = slots.ordinary(sequence)
    certificate = Certificate(cost, lower_bound)
    along = history(problem.flow, edges, sequence, plant.weight, plant.center, plant.level, slots.size)
    judged = integrate(problem.flow, edges, sequence, plant.weight, plant.center, plant.level, slots.size)
    independent = None
    if judged is not None:
        independent = Independent(judged.cost, judged.level, judged.center_weight.tolist())
        if abs(judged.cost - cost) > AGREEMENT * abs(cost):
            status = Status.DISAGREES
            message = f"direct integration gives {judged.cost:.10g}, the span elements {cost:.10g}"
    common, kept = _common(problem, slots, certificate, weights, ordinary)
    found = SequenceResult(
        **common,
        sequence=[names[i] for i in sequence],
        switches=schedule.switches,
        independent=independent,
        schedule=schedule.segments(),
        **(numbers or {}),
    )
    kept |= {
        "fine_times": along.times,
        "fine_shape": along.shape,
        "fine_level": along.level,
        "fine_size": along.size,
        **(arrays or {}),
    }
    return solution_of(
        problem,
        found,
        method=method,
        status=status,
        message=message,
        arrays=kept,
        schedule=schedule,
        certificate=certificate,
        iterations=found.nodes or 0,
        monitor=monitor,
    )


def shares_solution(
    problem: Problem,
    slots: Slots,
    weights: np.ndarray,
    *,
    method: str,
    lower_bound: float,
    relative_gap: float,
    monitor: Monitor,
) -> Solution:
    """The Solution of the relaxation: slots shared between sensors.

    Parameters
    ----------
    problem, slots : the problem and its table
    weights : (N, M) shares
    method, monitor : name, and who watched
    lower_bound : proven for every sequence; above the cost by more than rounding it makes the status `disagrees`
    relative_gap : target of the relaxation
    """
    from occontrol.families.robust.bound import walk

    path = walk(slots, weights, slots.start)
    cost = float(slots.size.value(path.ordinary[-1], slots.level))
    certificate = Certificate(cost, lower_bound)
    schedule = Schedule(problem.edges, weights, tuple(problem.sensors.names))
    reached = certificate.relative_gap <= max(relative_gap, 1e-3)
    status = Status.INTERRUPTED if monitor.interrupted else Status.CERTIFIED if reached else Status.LIMIT
    bound = rounded_down(certificate.lower_bound, 10)
    message = f"No sequence on these slots has a size below {bound}. The shares are no schedule."
    common, arrays = _common(problem, slots, certificate, weights, path.ordinary)
    found = SharesResult(
        **common,
        singular_fraction=schedule.singular_fraction,
        schedule=schedule.segments(),
    )
    return solution_of(
        problem,
        found,
        method=method,
        status=status,
        message=message,
        arrays=arrays,
        schedule=schedule,
        certificate=certificate,
        monitor=monitor,
    )


def _common(
    problem: Problem, slots: Slots, certificate: Certificate, weights: np.ndarray, ordinary: np.ndarray
) -> tuple[PlainDict, dict[str, np.ndarray]]:
    """Fields and arrays that sequences and shares both have; ordinary is N (N+1, n, n)."""
    shape = from_ordinary(ordinary, slots.free)
    Y = center_weight(slots.free, shape)
    reach, followed = observability(problem)
    fields: PlainDict = {
        "name": problem.name,
        "cost": certificate.cost,
        "lower_bound": certificate.lower_bound,
        "relative_gap": certificate.relative_gap,
        "level": slots.level,
        "size": dict(slots.size.terms),
        "observability_horizon": reach,
        "observability_followed_to": followed,
        "X_initial": slots.free[0].tolist(),
        "Y_initial": Y[0].tolist(),
    }
    arrays = {
        "times": problem.edges,
        "edges": problem.edges,
        "weights": weights,
        "shape": shape,
        "ordinary": ordinary,
        "center_weight": Y,
        "free_weight": slots.free,
    }
    return fields, arrays

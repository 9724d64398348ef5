"""Anybody's schedule, judged: cost, lower bound and gap, and which of the numbers stated for it are wrong."""

from __future__ import annotations

import dataclasses
import time

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Solution, Status
from occontrol.families.athans.assembly import assemble
from occontrol.families.athans.certificate import Claims, false_claims
from occontrol.families.athans.discretise import discretise, half_predicts
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.families.athans.result import AthansResult
from occontrol.families.athans.run_method import Found
from occontrol.scheduling.relaxation import RelaxedOptions, minimise_relaxed
from occontrol.scheduling.sweep import Sweep


def certify(problem: SchedulingProblem, schedule: Schedule, claims: Claims | None = None) -> Solution:
    """Cost, lower bound and gap of anybody's schedule, everything recomputed from problem and schedule.

    Parameters
    ----------
    problem : SchedulingProblem
    schedule : Schedule on any edges over the problem's horizon; the grid is refined by its switch times
    claims : what somebody says of it; refuted claims make the status `disagrees`

    Returns a Solution with method "certify"; the bound is the better of the schedule's own and a relaxation's.
    """
    started = time.perf_counter()
    monitor = Monitor()
    problem, weights = on_common_grid(problem, schedule)
    problem.require_feasible()
    halves = half_predicts(problem)
    sweep = Sweep(discretise(problem, halves))
    gap = getattr(problem.method, "relative_gap", 1e-4)
    relaxed = minimise_relaxed(sweep, None, RelaxedOptions(gap), monitor)
    found = Found(weights, relaxed.iterations, relaxed.status, "", relaxed, target=gap)
    solution = assemble(problem, "certify", sweep, halves, found, monitor, started)
    if claims is not None and solution.certificate is not None:
        lowest = min(relaxed.cost, solution.certificate.cost)
        numbers: AthansResult = solution.numbers  # type: ignore[assignment]
        continuous = None if numbers.continuous is None else numbers.continuous.cost
        refuted = false_claims(claims, solution.certificate.cost, lowest, continuous, parts_of(numbers))
        if refuted:
            return dataclasses.replace(solution, status=Status.DISAGREES, message="; ".join(refuted))
    return solution


def parts_of(numbers: AthansResult) -> dict[str, float]:
    """The numbers of a result that follow from problem and schedule alone, by name.

    Parameters
    ----------
    numbers : of a solution, perhaps read from a file that somebody has edited
    """
    parts = {
        "observation_cost": numbers.observation_cost,
        "running_cost": numbers.running_cost,
        "prediction_error": numbers.prediction_error,
        "predicted_mean_square_error": numbers.predicted_mean_square_error,
        "continuous cost": None if numbers.continuous is None else numbers.continuous.cost,
    }
    return {name: float(value) for name, value in parts.items() if isinstance(value, int | float)}


def claims_of(solution: Solution) -> Claims:
    """What a run says of its schedule, for `certify` to check.

    Parameters
    ----------
    solution : of the run
    """
    numbers: AthansResult = solution.numbers  # type: ignore[assignment]
    bound = None if numbers.continuous is None else numbers.continuous.lower_bound
    cost, lower = (None, None) if solution.certificate is None else (solution.cost, solution.certificate.lower_bound)
    bound, gap = (float(x) if isinstance(x, int | float) else None for x in (bound, numbers.relative_gap))
    return Claims(cost, lower, bound, gap, parts_of(numbers))


def on_common_grid(problem: SchedulingProblem, schedule: Schedule) -> tuple[SchedulingProblem, np.ndarray]:
    """The problem on the union of its own edges and the schedule's, and the schedule's weights there.

    Parameters
    ----------
    problem : SchedulingProblem
    schedule : Schedule over the same horizon, sensors in any order
    """
    scale = max(1.0, float(np.max(np.abs(problem.edges))))
    extra = schedule.edges[np.min(np.abs(schedule.edges[:, None] - problem.edges[None]), axis=1) > 1e-9 * scale]
    edges = np.sort(np.concatenate([problem.edges, extra]))
    if len(extra):
        problem = dataclasses.replace(problem, edges=edges)
    middle = (edges[1:] + edges[:-1]) / 2
    interval = np.clip(np.searchsorted(schedule.edges, middle, side="right") - 1, 0, len(schedule.weights) - 1)
    order = [schedule.names.index(name) for name in problem.sensors.names]
    return problem, schedule.weights[interval][:, order]

"""From choices to a Solution: the numbers of result.json and the arrays, and the way back to a chooser."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.core.result import PlainResult
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Certificate, Solution, Status
from occontrol.families.vlambda.problem import Problem
from occontrol.families.vlambda.selection import Selection
from occontrol.families.vlambda.sensor_choice import SequenceChooser


def cost_of(problem: Problem, selection: Selection) -> float:
    """The problem's criterion of P(k|k), summed over k."""
    return float(np.sum(selection.traces if problem.criterion == "trace" else selection.eigenvalues[:, 0]))


def finish(
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
    """The Solution of a selection.

    Parameters
    ----------
    problem : Problem
    method : its name
    began : time.perf_counter() at the start
    watch : Monitor, and `before`, how long its history was at the start
    selection : Selection
    status, message : how it ended
    more : further entries of result.json, among them lower_bound where one is proven
    """
    names, scales = problem.sensors.names, problem.scales
    cost, largest = cost_of(problem, selection), selection.eigenvalues[:, 0]
    deviations = np.sqrt(np.einsum("kii->ki", selection.covariance)) * scales
    weights = np.zeros((problem.epochs, len(names)))
    for e, choice in enumerate(selection.choices):
        weights[e, list(choice.sensors)] = 1.0
    schedule = Schedule(problem.starts.astype(float), weights, tuple(names))
    # a bound over a grid of locations is no certificate for free ones
    bounded = "lower_bound" in more and "bound_holds_for" not in more
    certificate = Certificate(cost, more["lower_bound"]) if bounded else None
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
    if "lower_bound" in more:
        result["relative_gap"] = Certificate(cost, more["lower_bound"]).relative_gap
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
        "vlambda", method, status, message, problem.epochs, seconds, PlainResult(result), arrays, schedule, certificate,
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


def recorded(problem: Problem, solution: Solution) -> SequenceChooser:
    """The chooser that repeats a solution's choices, locations included."""
    groups, places = [], []
    for entry in solution.result["schedule"]:
        groups.append(tuple(sorted(problem.sensors.index(name) for name in entry["sensors"])))
        where = entry.get("locations") or {}
        places.append({problem.sensors.index(name): np.array(p, dtype=float) for name, p in where.items()})
    return SequenceChooser(tuple(groups), tuple(places))

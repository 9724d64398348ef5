"""One plant in several families, each schedule judged by one yardstick.

Whatever family found it, a schedule is flown through the same exact flow of the covariance (family athans certifies),
and beside that stands the worst case over all inputs of a given energy (family robust, one fixed sequence). What a
conversion left behind belongs to the result.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from occontrol.api import certify, converted, problem_of, solve
from occontrol.api import document as document_of
from occontrol.core.conversion import Asked
from occontrol.core.errors import OccontrolError, UsageError
from occontrol.core.kinds import Plain, PlainDict
from occontrol.core.monitor import Monitor
from occontrol.core.problem import BaseProblem
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Solution

FAMILIES = ("athans", "vlambda", "robust")
STEPS, SLOTS, LEVEL = 60, 6, 1.0  # where nobody says


@dataclass(frozen=True)
class Row:
    """What one family makes of the plant.

    Parameters
    ----------
    family, method : which
    cost, lower_bound : in the terms of the base problem; the bound holds for all schedules of it
    prediction_error : tr(W Sigma(T)) of its schedule by the exact flow
    worst_case : sum of squared semi-axes of the set of possible states at the end, None where it cannot be had
    switches : of its schedule
    remarks : what was left behind on the way, or why there is no number
    """

    family: str
    method: str = ""
    cost: float | None = None
    lower_bound: float | None = None
    prediction_error: float | None = None
    worst_case: float | None = None
    switches: int | None = None
    remarks: tuple[str, ...] = ()

    def as_dict(self) -> PlainDict:
        """The numbers by name."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__}


def side_by_side(problem: BaseProblem, asked: Asked, monitor: Monitor) -> list[Row]:
    """One row a family, the problem's own first.

    Parameters
    ----------
    problem : of family athans (continuous sensing), robust, or vlambda
    asked : Asked; a step of a sixtieth of the horizon, six slots and level 1 where it says nothing
    monitor : Monitor

    Raises UsageError where the problem has no way to family athans, whose flow is the yardstick.
    """
    base, left = problem, []
    if problem.family != "athans":
        between, left = converted(problem, "athans", asked)
        base = problem_of(between)
    edges = getattr(base, "edges", None)
    if edges is None or getattr(base, "takes_readings", False):
        raise UsageError(
            "compare --families needs a plant in continuous time\n  hint: horizon: {start, end, intervals}, A and noise"
        )
    length = float(edges[-1] - edges[0])
    asked = Asked(asked.step or length / STEPS, asked.level or LEVEL, asked.slots or SLOTS)
    rows = []
    for family in sorted(FAMILIES, key=lambda name: name != problem.family):
        if monitor.stop:
            break
        monitor.stage = family
        try:
            row = _row(problem, base, family, asked, monitor)
            rows.append(replace(row, remarks=(*left, *row.remarks) if family != problem.family else row.remarks))
        except OccontrolError as error:
            rows.append(Row(family, remarks=(str(error).splitlines()[0],)))
    return rows


def _row(problem: BaseProblem, base: BaseProblem, family: str, asked: Asked, monitor: Monitor) -> Row:
    remarks: list[str] = []
    own = problem
    if family != problem.family:
        if family == "athans":
            own = base
        else:
            document, remarks = converted(base, family, asked)
            own = problem_of(document)
    solution = solve(own, None, monitor)
    schedule = _on_the_base(base, own, solution)
    judged = certify(base, schedule)
    top = judged.result["top"]
    return Row(
        family,
        solution.method,
        float(top["cost"]),
        float(top["lower_bound"]),
        float(judged.result["prediction_error"]),
        _worst_case(problem if problem.family == "robust" else base, schedule, asked, monitor),
        schedule.switches,
        tuple(remarks),
    )


def _on_the_base(base: BaseProblem, own: BaseProblem, solution: Solution) -> Schedule:
    """The schedule of any of the families as one in the time of the base problem."""
    names = tuple(base.sensors.names)  # type: ignore[attr-defined]
    start, end = (float(base.edges[k]) for k in (0, -1))  # type: ignore[attr-defined]
    if own.family == "athans" and solution.schedule is not None:
        return solution.schedule
    entries = solution.result["schedule"]
    if own.family == "vlambda":
        steps = own.steps  # type: ignore[attr-defined]
        times = np.array([*(entry["k"] for entry in entries), steps]) / steps * (end - start) + start
        used = [entry["sensors"] for entry in entries]
    else:
        times = np.asarray(own.edges, dtype=float)  # type: ignore[attr-defined]
        used = [_sensors_of(entry) for entry in _by_slot(entries, times)]
    times[0], times[-1] = start, end
    weights = np.array([[float(name in names_used) for name in names] for names_used in used])
    return Schedule(times, weights, names)


def _by_slot(entries: Sequence[Plain], edges: np.ndarray) -> list[Plain]:
    """One entry a slot, of entries that may hold for several."""
    found = []
    for middle in (edges[1:] + edges[:-1]) / 2:
        found.append(next(entry for entry in entries if entry["start"] <= middle < entry["end"]))
    return found


def _sensors_of(entry: Plain) -> list[str]:
    return list(entry["sensors"]) if "sensors" in entry else [entry["sensor"]]


def _worst_case(problem: BaseProblem, schedule: Schedule, asked: Asked, monitor: Monitor) -> float | None:
    """The size of the set of possible states along a schedule, where family robust has words for it."""
    keep = np.append(True, np.any(np.diff(schedule.weights, axis=0) != 0, axis=1))
    edges = np.append(schedule.edges[:-1][keep], schedule.edges[-1])
    weights = schedule.weights[keep]
    if not schedule.is_integer or np.any(np.sum(weights > 0.5, axis=1) != 1):
        return None
    sequence = [schedule.names[j] for j in np.argmax(weights, axis=1)]
    try:
        if problem.family == "robust":  # with its own uncertainty of the model
            found = document_of(problem)
        else:
            found, _ = converted(problem, "robust", Asked(asked.step, asked.level, 1))
        found["horizon"] = {"start": float(edges[0]), "switch_times": edges.tolist()}
        found["size"] = "trace"
        found["method"] = {"name": "fixed", "sequence": sequence}
        return float(solve(problem_of(found), None, monitor).result["cost"])
    except OccontrolError:
        return None

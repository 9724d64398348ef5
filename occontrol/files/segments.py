"""Segments of a schedule that anyone wrote -> a Schedule on the grid of a problem, refined where it switches."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeGuard

import numpy as np

from occontrol.core.clock import resolution
from occontrol.core.errors import Collector, Mistake, ProblemError, plural, suggest
from occontrol.core.problem import BaseProblem, ProblemOfReadings
from occontrol.core.reading_schedule import Reading, readings_of
from occontrol.core.schedule import INTEGER, Schedule, snap
from occontrol.core.sensor import IDLE
from occontrol.files.positions import in_order

JOIN = 1e-6  # of the horizon: what rounding on paper may leave between two segments, and at the ends
TOTAL = 1e-6


@dataclass(frozen=True)
class Segment:
    """From `start` to `end` these sensors are used, with these weights (None: each fully); `place` gives file:line."""

    start: float
    end: float
    sensors: tuple[str, ...]
    weights: tuple[float, ...] | None
    place: Callable[[], str]


def schedule_of(segments: Sequence[Segment], problem: BaseProblem, file: str) -> Schedule:
    """The schedule on the union of the problem's edges and the times at which it switches.

    Parameters
    ----------
    segments : in any order, covering the horizon without hole or overlap
    problem : has `edges` or `starts`, `sensors` and, where more than one is used at a time, `select`
    file : what to call the source in a message

    Raises ProblemError: holes, overlaps, unknown names, wrong numbers of sensors, use outside a window.
    """
    found = Collector()
    segments = sorted(segments, key=lambda s: s.start)
    if not segments:
        raise ProblemError(Mistake((), "the schedule has no segment", place=file))
    entries = [Reading(s.start, s.end, s.sensors, s.weights, s.place()) for s in segments]
    if (cycle_from := getattr(problem, "cycle_from", None)) is not None:
        return cycle_from(entries)  # a cycle is as long as what is written
    if takes_readings(problem):
        names, variable = tuple(problem.sensors.names), problem.clock.variable
        slews = bool(getattr(problem, "slews", False))
        weights = readings_of(entries, problem.clock.times, names, problem.select, variable, slews)
        return problem.make_schedule(problem.edges, weights)
    grid = grid_of(problem)
    switches = _switches(segments, grid, found)
    weights = [_weights(segment, problem, found) for segment in segments]
    if found.mistakes:
        raise in_order(found.mistakes)
    names = tuple(problem.sensors.names)
    given = Schedule(switches, np.array(weights), names)
    edges = given.common_edges(grid)
    return Schedule(edges, given.on_grid(edges, names), names)


def as_read(schedule: Schedule, problem: BaseProblem) -> Schedule:
    """A schedule made in Python, judged as the reader judges one in a file: the same rules in the same words,
    with the times in place of file and line.

    Parameters
    ----------
    schedule : sensors in any order; those that it does not name are not used, idle fills what is left
    problem : as for `schedule_of`

    Raises ProblemError as `schedule_of` does.
    """
    segments, first, instants = [], 0, takes_readings(problem)
    for k, weights in enumerate(schedule.weights, 1):
        if not instants and k < len(schedule.weights) and np.array_equal(weights, schedule.weights[k]):
            continue  # one segment, and so one mistake, for neighbours that are alike
        used = [j for j in range(len(weights)) if abs(weights[j]) > INTEGER]
        shares = None
        if any(abs(weights[j] - 1) > INTEGER for j in used):
            used = [j for j in range(len(weights)) if weights[j] != 0]  # shares keep their digits
            shares = tuple(float(weights[j]) for j in used)
        start, end = float(schedule.edges[first]), float(schedule.edges[k])
        place = partial("t = {:.12g} .. {:.12g}".format, start, end)
        if takes_readings(problem):
            end = start
            place = partial("{} = {:.12g}".format, problem.clock.variable, start)
        segments.append(Segment(start, end, tuple(schedule.names[j] for j in used), shares, place))
        first = k
    return schedule_of(segments, problem, "")


def takes_readings(problem: BaseProblem) -> TypeGuard[ProblemOfReadings]:
    """Whether a schedule of the problem lists readings at instants instead of segments of time."""
    return bool(getattr(problem, "takes_readings", False))


def grid_of(problem: BaseProblem) -> np.ndarray:
    """The times at which the problem's sensors may change, with both ends; in discrete time the starts of epochs."""
    edges = getattr(problem, "edges", None)
    return np.asarray(getattr(problem, "starts", ()) if edges is None else edges, dtype=float)


def _switches(segments: Sequence[Segment], edges: np.ndarray, found: Collector) -> np.ndarray:
    """The K+1 times between the K segments, moved onto edges of the grid that they nearly meet."""
    slack = JOIN * (edges[-1] - edges[0]) + resolution(edges)
    times = [float(edges[0])]
    for before, segment in zip((None, *segments), segments, strict=False):
        start = times[0] if before is None else before.end
        if segment.end <= segment.start:
            _add(found, segment, f"the segment ends at {segment.end:g}, which is not after its start {segment.start:g}")
        elif segment.start > start + slack:
            _add(found, segment, f"nothing is scheduled between t = {start:g} and {segment.start:g}", _cover(edges))
        elif before is None and segment.start < start - slack:
            _add(found, segment, f"the segment starts at {segment.start:g}, the horizon at {start:g}", _cover(edges))
        elif before is not None and segment.start < start - slack:
            what = f"the segment starts at {segment.start:g}, but the one before it ends at {start:g}"
            _add(found, segment, what, "segments must not overlap")
        times.append(segment.end)
    last = segments[-1]
    if last.end < edges[-1] - slack:
        _add(found, last, f"nothing is scheduled between t = {last.end:g} and {edges[-1]:g}", _cover(edges))
    elif last.end > edges[-1] + slack:
        _add(found, last, f"the segment ends at {last.end:g}, the horizon at {edges[-1]:g}", _cover(edges))
    times[-1] = float(edges[-1])
    switches = snap(np.array(times), edges)
    if not found.mistakes and np.any(np.diff(switches) <= 0):
        k = int(np.argmax(np.diff(switches) <= 0))
        _add(found, segments[k], f"the segment from {segments[k].start:.12g} is too short to be told from nothing")
    return switches


def _weights(segment: Segment, problem: BaseProblem, found: Collector) -> np.ndarray:
    """(M,) weights of one segment; idle fills what is left."""
    names, select = list(problem.sensors.names), int(getattr(problem, "select", 1))
    weights, before = np.zeros(len(names)), len(found.mistakes)
    shares = segment.weights or (1.0,) * len(segment.sensors)
    for name, share in zip(segment.sensors, shares, strict=True):
        if name not in names:
            _add(found, segment, f"there is no sensor '{name}'", suggest(name, names))
            continue
        j = names.index(name)
        if weights[j] > INTEGER and name != IDLE:
            _add(found, segment, f"sensor '{name}' is named twice")
        if not -INTEGER <= share <= (select if name == IDLE else 1) + TOTAL:
            _add(found, segment, f"the weight of sensor '{name}' is {share:g}, it must lie between 0 and 1")
        weights[j] += share
        available = getattr(problem.sensors[j], "available", None)
        if share > INTEGER and available is not None and not available(segment.start, segment.end):
            windows = ", ".join(f"[{a:g}, {b:g}]" for a, b in problem.sensors[j].windows)
            what = f"sensor '{name}' is used from {segment.start:g} to {segment.end:g}, outside its windows"
            _add(found, segment, what, f"its windows: {windows}")
    if len(found.mistakes) > before or (not segment.sensors and getattr(problem, "slews", False)):
        return weights
    lacking = select - float(np.sum(weights))
    idle = names.index(IDLE) if IDLE in names else None
    if idle is not None and lacking > 0:
        weights[idle] += lacking
    elif abs(lacking) > TOTAL:
        whole = segment.weights is None
        count = len(segment.sensors)
        named = f"{plural(count, 'sensor')} {'is' if count == 1 else 'are'} named"
        what = named if whole else f"the weights add up to {np.sum(weights):g}"
        hint = "fractions of a relaxed schedule come from a run folder or result.json" if whole and lacking < 0 else ""
        _add(found, segment, f"{what}, but select is {select}", hint)
    return weights


def _add(found: Collector, segment: Segment, what: str, hint: str = "") -> None:
    found.mistakes.append(Mistake((), what, hint, place=segment.place()))


def _cover(edges: np.ndarray) -> str:
    return f"the segments must cover the horizon [{edges[0]:g}, {edges[-1]:g}]"

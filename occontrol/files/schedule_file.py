"""Schedules that come from outside: CSV, JSON and run folders, mistakes as file:line."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from pathlib import Path

from occontrol.core.calendar import looks_like_date
from occontrol.core.errors import Collector, FileAccessError, ProblemError, one_per_cause
from occontrol.core.problem import BaseProblem
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Solution
from occontrol.files.csv_lines import MAX_BYTES, add, csv_rows, number, wrong_line
from occontrol.files.positions import Text, in_order
from occontrol.files.problem_file import read_text
from occontrol.files.segments import Segment, grid_of, schedule_of, takes_readings
from occontrol.files.spreadsheet import from_text
from occontrol.files.time_field import TimeField


def read_schedule(
    path: str | Path, problem: BaseProblem, read_run: Callable[[Path], tuple[BaseProblem, Solution]]
) -> Schedule:
    """A schedule that anyone wrote, on the grid of `problem` refined where the schedule switches.

    Parameters
    ----------
    path : CSV with the columns start, end, sensors (names joined by ';') and, where sensors share their time,
        weights (joined by ';'); JSON, a list of
        {start, end, sensors[, weights]} or a dict that has it under 'schedule'; or a run folder
    problem : a problem whose sensors are chosen on a grid of times or epochs
    read_run : the problem and the solution of a run folder

    Raises ProblemError with every mistake as file:line, FileAccessError when the file cannot be read.
    """
    path = Path(path)
    if len(grid_of(problem)) < 2 or not hasattr(problem, "sensors"):
        raise ProblemError(f"a problem of family {problem.family} has no schedule over time to read", "")
    if path.is_dir():
        segments = _from_run(path, read_run, takes_readings(problem))
    elif path.suffix.lower() == ".json":
        segments = _from_json(path, None if takes_readings(problem) else float(grid_of(problem)[-1]), problem)
    elif path.suffix.lower() == ".csv":
        segments = _from_csv(path, problem)
    else:
        _must_exist(path)
        raise wrong_line(str(path), f"the file name ends in '{path.suffix}'", "schedules end in .csv or .json")
    return schedule_of(segments, problem, str(path))


def _from_run(folder: Path, read_run: Callable[[Path], tuple[BaseProblem, Solution]], instants: bool) -> list[Segment]:
    _, solution = read_run(folder)
    schedule = solution.schedule
    if schedule is None:
        raise wrong_line(str(folder), "the run folder holds no schedule")
    return [
        Segment(
            float(a),
            float(a if instants else b),
            schedule.names,
            tuple(map(float, v)),
            partial("{}: interval {}".format, folder, k + 1),
        )
        for k, ((a, b), v) in enumerate(zip(pairwise(schedule.edges), schedule.weights, strict=True))
    ]


def _from_csv(path: Path, problem: BaseProblem) -> list[Segment]:
    found, segments = Collector(), []
    clock = TimeField(problem, found)
    lines = csv_rows(path, ("start", "end", "sensors"), "schedule")
    _, header = next(lines)
    weighted = header[3:4] == ["weights"]
    for line, row in lines:
        place = f"{path}:{line}"
        shares = None
        if weighted and len(row) == 4 and row[3].strip():
            parts = [number(part, "weights", place, found) for part in row[3].split(";")]
            shares = tuple(part for part in parts if part is not None)
            count = len([name for name in row[2].split(";") if name.strip()])
            if len(parts) != count:
                add(found, place, f"{len(parts)} weights for {count} sensors", "one weight per sensor, joined by ';'")
                continue
        elif len(row) > 3 and any(field.strip() for field in row[3:]):
            add(found, place, f"the line has {len(row)} fields, not 3", "join the names of sensors by ';'")
            continue
        start, end = (clock.number(row[i].strip(), key, place) for i, key in enumerate(("start", "end")))
        names = tuple(name.strip() for name in from_text(row[2].strip()).split(";") if name.strip())
        if start is not None and end is not None:
            segments.append(Segment(start, end, names, shares, partial(str, place)))
    if found.mistakes:
        raise in_order(one_per_cause(found.mistakes))
    return segments


def _from_json(path: Path, end: float | None, problem: BaseProblem) -> list[Segment]:
    from occontrol.files.json_text import read_json

    text = read_json(read_text(path, MAX_BYTES, "schedule"), str(path))
    data, prefix = text.data, ()
    if isinstance(data, dict):
        data, prefix = data.get("schedule"), ("schedule",)
    if not isinstance(data, list):
        what = "there is no 'schedule'" if prefix else "this is not a schedule"
        raise wrong_line(f"{path}:1:1", what, "a list of {start: .., end: .., sensors: [..]}")
    found, segments = Collector(), []
    clock, data = TimeField(problem, found), _from_steps(data, end)
    for k, item in enumerate(data):
        segment = _json_segment(item, (*prefix, k), text, clock)
        if segment is not None:
            segments.append(segment)
    if found.mistakes:
        raise text.placed(found.mistakes)
    return segments


def _from_steps(data: list, end: float | None) -> list:
    """Records of {k, sensors}, as in the results of discrete-time selection, last until the next one.

    Without an `end` records of {k or t, sensors} are readings at that instant.
    """
    if end is None:
        keys = [next((key for key in ("k", "t") if isinstance(item, dict) and key in item), None) for item in data]
        return [
            item if key is None or "start" in item else {"start": item[key], "end": item[key], **item}
            for item, key in zip(data, keys, strict=True)
        ]
    if not all(isinstance(item, dict) and "k" in item and "start" not in item for item in data):
        return data
    ends = [item["k"] for item in data[1:]] + [end]
    return [{"start": item["k"], "end": last, **item} for item, last in zip(data, ends, strict=True)]


def _json_segment(item: object, path: tuple, text: Text, clock: TimeField) -> Segment | None:
    from occontrol.files.schema.words import shown

    found = clock.found
    if not isinstance(item, dict):
        found.add(path, f"segment {path[-1] + 1} is {shown(item)}", "{start: .., end: .., sensors: [..]}")
        return None
    before = len(found.mistakes)
    for key in ("start", "end", "sensors"):
        if key not in item:
            found.add(path, f"segment {path[-1] + 1} has no '{key}'", "{start: .., end: .., sensors: [..]}")
    if len(found.mistakes) > before:
        return None
    item = dict(item)
    for key in ("start", "end"):
        if looks_like_date(item[key]):
            item[key] = clock.date(item[key], key, path=(*path, key))
        elif not _finite(item[key]):
            found.add((*path, key), f"{key} is {shown(item[key])}, it must be a finite number")
    names, weights = item["sensors"], item.get("weights")
    names = [names] if isinstance(names, str) else names
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        found.add((*path, "sensors"), "sensors is not a list of names", 'sensors: ["radar"]')
    elif weights is not None and not (isinstance(weights, list) and all(map(_finite, weights))):
        found.add((*path, "weights"), "weights is not a list of numbers")
    elif weights is not None and len(weights) != len(names):
        found.add((*path, "weights"), f"{len(weights)} weights for {len(names)} sensors")
    if len(found.mistakes) > before:
        return None

    def place() -> str:
        line, column = text.locate(path)
        return f"{text.file}:{line}:{column}"

    shares = None if weights is None else tuple(map(float, weights))
    return Segment(float(item["start"]), float(item["end"]), tuple(names), shares, place)


def _finite(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _must_exist(path: Path) -> None:
    if not path.exists():
        raise FileAccessError(f"there is no file {path}")

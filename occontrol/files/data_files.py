"""Schedules and measurements that come from outside: CSV, JSON and run folders, mistakes as file:line."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np

from occontrol.core.errors import Collector, FileAccessError, Mistake, ProblemError, one_per_cause, suggest
from occontrol.core.measurement import Measurement
from occontrol.core.problem import BaseProblem
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Solution
from occontrol.files.csv_lines import MAX_BYTES, csv_rows
from occontrol.files.positions import Text, in_order
from occontrol.files.problem_file import read_text
from occontrol.files.segments import Segment, grid_of, schedule_of, takes_readings
from occontrol.files.spreadsheet import from_text


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
        segments = _from_json(path, None if takes_readings(problem) else float(grid_of(problem)[-1]))
    elif path.suffix.lower() == ".csv":
        segments = _from_csv(path)
    else:
        _must_exist(path)
        raise _wrong(str(path), f"the file name ends in '{path.suffix}'", "schedules end in .csv or .json")
    return schedule_of(segments, problem, str(path))


def read_measurements(path: str | Path, problem: BaseProblem | None = None) -> list[Measurement]:
    """The samples of a measurement file, in the order of time.

    Parameters
    ----------
    path : CSV with the columns t, sensor, z1, z2, ..; empty fields at the end of a line where a sensor has fewer values
    problem : when given, names and numbers of values are compared with its sensors

    An empty or NaN value is a missing one: it is NaN in `values`.
    Raises ProblemError with every mistake as file:line, FileAccessError when the file cannot be read.
    """
    path = Path(path)
    found = Collector()
    sizes = _sizes(problem)
    samples: list[Measurement] = []
    seen: dict[tuple[float, str], int] = {}
    rows = csv_rows(path, ("t", "sensor"), "measurement file")
    header = next(rows)[1]
    width = len(header) - 2
    for line, row in rows:
        place = f"{path}:{line}"
        before = len(found.mistakes)
        t = _number(row[0], "t", place, found)
        name, fields = from_text(row[1].strip()), [field.strip() for field in row[2:]]
        if sizes is not None and name not in sizes:
            _add(found, place, f"there is no sensor '{name}'", suggest(name, sizes))
        elif not name:
            _add(found, place, "the sensor is not named", "columns: t, sensor, z1, z2, ..")
        titles = [title or f"z{i + 1}" for i, title in enumerate(header[2:])] + ["a value"] * len(fields)
        values = [_number(field, titles[i], place, found, missing=True) for i, field in enumerate(fields)]
        size = _used(fields) if sizes is None else sizes.get(name)
        if len(fields) > width:
            _add(found, place, f"the line has {len(fields)} values, the header names {width}")
        elif size is not None and _used(fields) > size and len(found.mistakes) == before:
            _add(found, place, f"sensor '{name}' has {size} values, the line has {_used(fields)}")
        if len(found.mistakes) > before or t is None:
            continue
        if (t, name) in seen:
            _add(
                found,
                place,
                f"a second sample of sensor '{name}' at t = {t:g}",
                f"the first is in line {seen[t, name]}",
            )
            continue
        seen[t, name] = line
        known = [math.nan if v is None else v for v in values]
        size = len(known) if size is None else size
        samples.append(Measurement(t, name, np.array((known + [math.nan] * size)[:size], dtype=float), line))
    if found.mistakes:
        raise in_order(one_per_cause(found.mistakes))
    return sorted(samples, key=lambda m: m.time)


def _sizes(problem: BaseProblem | None) -> dict[str, int | None] | None:
    """The number of values of each sensor of a problem."""
    sensors = getattr(problem, "sensors", None)
    if sensors is None:
        return None
    return {sensor.name: getattr(sensor, "rows", None) for sensor in sensors}


def _used(fields: list[str]) -> int:
    return max((i + 1 for i, field in enumerate(fields) if field), default=0)


def _from_run(folder: Path, read_run: Callable[[Path], tuple[BaseProblem, Solution]], instants: bool) -> list[Segment]:
    _, solution = read_run(folder)
    schedule = solution.schedule
    if schedule is None:
        raise _wrong(str(folder), "the run folder holds no schedule")
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


def _from_csv(path: Path) -> list[Segment]:
    found, segments = Collector(), []
    rows = csv_rows(path, ("start", "end", "sensors"), "schedule")
    _, header = next(rows)
    weighted = header[3:4] == ["weights"]
    for line, row in rows:
        place = f"{path}:{line}"
        shares = None
        if weighted and len(row) == 4 and row[3].strip():
            parts = [_number(part, "weights", place, found) for part in row[3].split(";")]
            shares = tuple(part for part in parts if part is not None)
            count = len([name for name in row[2].split(";") if name.strip()])
            if len(parts) != count:
                _add(found, place, f"{len(parts)} weights for {count} sensors", "one weight per sensor, joined by ';'")
                continue
        elif len(row) > 3 and any(field.strip() for field in row[3:]):
            _add(found, place, f"the line has {len(row)} fields, not 3", "join the names of sensors by ';'")
            continue
        start, end = (_number(row[i], key, place, found) for i, key in enumerate(("start", "end")))
        names = tuple(name.strip() for name in from_text(row[2].strip()).split(";") if name.strip())
        if start is not None and end is not None:
            segments.append(Segment(start, end, names, shares, partial(str, place)))
    if found.mistakes:
        raise in_order(found.mistakes)
    return segments


def _from_json(path: Path, end: float | None) -> list[Segment]:
    from occontrol.files.json_text import read_json

    text = read_json(read_text(path, MAX_BYTES, "schedule"), str(path))
    data, prefix = text.data, ()
    if isinstance(data, dict):
        data, prefix = data.get("schedule"), ("schedule",)
    if not isinstance(data, list):
        what = "there is no 'schedule'" if prefix else "this is not a schedule"
        raise _wrong(f"{path}:1:1", what, "a list of {start: .., end: .., sensors: [..]}")
    found, segments = Collector(), []
    data = _from_steps(data, end)
    for k, item in enumerate(data):
        segment = _json_segment(item, (*prefix, k), text, found)
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


def _json_segment(item: object, path: tuple, text: Text, found: Collector) -> Segment | None:
    from occontrol.files.schema.words import shown

    if not isinstance(item, dict):
        found.add(path, f"segment {path[-1] + 1} is {shown(item)}", "{start: .., end: .., sensors: [..]}")
        return None
    before = len(found.mistakes)
    for key in ("start", "end", "sensors"):
        if key not in item:
            found.add(path, f"segment {path[-1] + 1} has no '{key}'", "{start: .., end: .., sensors: [..]}")
    if len(found.mistakes) > before:
        return None
    for key in ("start", "end"):
        if not _finite(item[key]):
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


def _number(field: str, name: str, place: str, found: Collector, missing: bool = False) -> float | None:
    """A finite number; with `missing` an empty field or NaN is None."""
    field = field.strip()
    if missing and field.lower() in ("", "nan"):
        return None
    try:
        value = float(field)
    except ValueError:
        value = math.nan
    if "_" in field or not field.isascii() or not math.isfinite(value):
        what = f"{name} is '{field[:40]}', it must be a finite number"
        found.mistakes.append(Mistake((), what, place=place, cause=f"number {name}"))
        return None
    return value


def _add(found: Collector, place: str, what: str, hint: str = "") -> None:
    found.mistakes.append(Mistake((), what, hint, place=place))


def _wrong(place: str, what: str, hint: str = "") -> ProblemError:
    return ProblemError(Mistake((), what, hint, place=place))


def _must_exist(path: Path) -> None:
    if not path.exists():
        raise FileAccessError(f"there is no file {path}")

"""Measurement files: t, sensor, z1, z2, ..; mistakes as file:line."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from occontrol.core.errors import Collector, one_per_cause, suggest
from occontrol.core.measurement import Measurement
from occontrol.core.problem import BaseProblem
from occontrol.files.csv_lines import add, csv_rows, number
from occontrol.files.positions import in_order
from occontrol.files.spreadsheet import from_text
from occontrol.files.time_field import TimeField


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
    sizes, clock = _sizes(problem), TimeField(problem, found)
    samples: list[Measurement] = []
    seen: dict[tuple[float, str], int] = {}
    lines = csv_rows(path, ("t", "sensor"), "measurement file")
    header = next(lines)[1]
    width = len(header) - 2
    for line, row in lines:
        place = f"{path}:{line}"
        before = len(found.mistakes)
        t = clock.number(row[0].strip(), "t", place)
        name, fields = from_text(row[1].strip()), [field.strip() for field in row[2:]]
        if sizes is not None and name not in sizes:
            add(found, place, f"there is no sensor '{name}'", suggest(name, sizes))
        elif not name:
            add(found, place, "the sensor is not named", "columns: t, sensor, z1, z2, ..")
        titles = [title or f"z{i + 1}" for i, title in enumerate(header[2:])] + ["a value"] * len(fields)
        values = [number(field, titles[i], place, found, missing=True) for i, field in enumerate(fields)]
        size = _used(fields) if sizes is None else sizes.get(name)
        if len(fields) > width:
            add(found, place, f"the line has {len(fields)} values, the header names {width}")
        elif size is not None and _used(fields) > size and len(found.mistakes) == before:
            add(found, place, f"sensor '{name}' has {size} values, the line has {_used(fields)}")
        if len(found.mistakes) > before or t is None:
            continue
        if (t, name) in seen:
            add(
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

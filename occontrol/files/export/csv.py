"""A folder of CSV files: schedule.csv, and one file per array with its times in the first columns.

Arrays on nodes begin with t, arrays on intervals with start and end, others with their index. Matrices are written row
by row: covariance_1_2 is the entry in row 1, column 2. A target that is named like a file, plan.csv, becomes the
schedule itself, and the arrays lie beside it as plan_gains.csv and so on. Names that a spreadsheet would compute, =x or
+1, are written with an apostrophe before them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from occontrol.core.calendar import Calendar, calendar_of
from occontrol.core.problem import BaseProblem
from occontrol.core.reading_schedule import ReadingSchedule
from occontrol.core.solution import Solution
from occontrol.files.spreadsheet import Numbers
from occontrol.files.tables import dated, write_table

FILE_NAMES = {"gain": "gains", "continuous_gain": "continuous_gains"}
PER_SENSOR = ("weights", "relaxed_weights", "switching")


def write(problem: BaseProblem, solution: Solution, tables: Mapping[str, np.ndarray], target: Path) -> list[Path]:
    """Write the CSV files of one run.

    Parameters
    ----------
    problem : the problem, for the names of the sensors
    solution : Solution
    tables : arrays of the filter, by name, of any shape
    target : the folder, created if missing; or a file ending in .csv, for the schedule
    """
    single = target.suffix.lower() == ".csv" and not target.is_dir()
    folder, before = (target.parent, f"{target.stem}_") if single else (target, "")
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    schedule = solution.result.get("schedule")
    if schedule and isinstance(solution.schedule, ReadingSchedule):
        schedule = [_instant(record, solution.schedule.variable) for record in schedule]
    if schedule:
        calendar = calendar_of(problem)
        schedule = schedule if calendar is None else [_dated(record, calendar) for record in schedule]
        written.append(_schedule(schedule, target if single else folder / "schedule.csv"))
    arrays = solution.arrays
    sensors: Sequence[str] = getattr(getattr(problem, "sensors", None), "names", ())
    for name, array in arrays.items():
        if name in ("times", "edges") or np.ndim(array) == 0:
            continue
        index_names, index = _index(array, arrays)
        flat = np.reshape(array, (len(array), -1))
        columns = _columns(name, array.shape[1:], sensors)
        path = folder / f"{before}{FILE_NAMES.get(name, name)}.csv"
        rows = ([*i, *row] for i, row in zip(index, flat, strict=True))
        clock = calendar_of(problem) if index_names[0] in ("t", "start") else None
        written.append(write_table(path, *dated([*index_names, *columns], rows, clock)))
    return written


def _dated(record: dict, calendar: Calendar) -> dict:
    """A segment with the dates of its start and end; a choice at a step with that of the step."""
    if "start" not in record:
        return {**record, "utc": calendar.utc(record["k"])} if "k" in record else record
    return {**record, "utc": calendar.utc(record["start"]), "utc_end": calendar.utc(record["end"])}


def _instant(record: dict, variable: str) -> dict:
    """A reading as a segment whose start is its end."""
    others = {key: value for key, value in record.items() if key != variable}
    return {"start": record[variable], "end": record[variable], **others}


def _schedule(schedule: Sequence[dict], path: Path) -> Path:
    """start,end,sensors for schedules in continuous time; whatever the records hold for the others."""
    header = list(dict.fromkeys(key for record in schedule for key in record))
    rows = ([_cell(record.get(key, "")) for key in header] for record in schedule)
    return write_table(path, header, rows)


def _cell(value: object) -> object:
    if isinstance(value, list | tuple):
        text = ";".join(repr(entry) if isinstance(entry, float) else str(entry) for entry in value)
        return text if any(isinstance(entry, str) for entry in value) else Numbers(text)
    return "" if value is None else value


def _index(array: np.ndarray, arrays: Mapping[str, np.ndarray]) -> tuple[list[str], Sequence[Sequence[object]]]:
    times, edges = arrays.get("times"), arrays.get("edges")
    if times is not None and len(array) == len(times):
        return ["t"], [[float(t)] for t in times]
    if edges is not None and len(array) == len(edges) - 1:
        return ["start", "end"], [[float(a), float(b)] for a, b in pairwise(edges)]
    return ["k"], [[k] for k in range(len(array))]


def _columns(name: str, shape: tuple[int, ...], sensors: Sequence[str]) -> list[str]:
    if name in PER_SENSOR and shape == (len(sensors),):
        return list(sensors)
    if not shape:
        return [name]
    return [f"{name}_" + "_".join(str(i + 1) for i in entry) for entry in np.ndindex(*shape)]

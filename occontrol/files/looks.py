"""Schedules of many targets that anyone wrote: start, end, resource, target, in CSV, JSON or a run folder."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import numpy as np

from occontrol.core.clock import resolution
from occontrol.core.errors import Collector, FileAccessError, Mistake, ProblemError, one_per_cause, suggest
from occontrol.core.look_schedule import LookSchedule
from occontrol.core.problem import BaseProblem
from occontrol.core.solution import Solution
from occontrol.files.csv_lines import MAX_BYTES, csv_rows
from occontrol.files.plain_json import parse_json
from occontrol.files.problem_file import read_text
from occontrol.files.spreadsheet import from_text

COLUMNS = ("start", "end", "resource", "target")
JOIN = 1e-6  # of an interval: what rounding on paper may leave between a time and an edge
MOST_NAMES = 200  # of which a hint names the nearest


class ProblemOfLooks(Protocol):
    """What a schedule of looks is read for: `edges` (N+1,), names of resources and targets."""

    edges: np.ndarray
    resource_names: list[str]
    target_names: list[str]


def is_of_looks(problem: BaseProblem) -> bool:
    """Whether schedules of the problem list looks of resources at targets."""
    return bool(getattr(problem, "of_targets", False))


def read_looks(
    path: str | Path, problem: ProblemOfLooks, read_run: Callable[[Path], tuple[BaseProblem, Solution]]
) -> LookSchedule:
    """A schedule of looks on the edges of its problem.

    Parameters
    ----------
    path : CSV with the columns start, end, resource, target and perhaps share; JSON, a list of such records or a dict
        that has it under 'schedule'; or a run folder
    problem : of many targets
    read_run : the problem and the solution of a run folder

    Raises ProblemError with every mistake as file:line, FileAccessError when the file cannot be read.
    """
    path = Path(path)
    if path.is_dir():
        schedule = read_run(path)[1].schedule
        if not isinstance(schedule, LookSchedule):
            raise ProblemError(Mistake((), "the run folder holds no schedule of looks", place=str(path)))
        records = [(f"{path}: look {i + 1}", record) for i, record in enumerate(schedule.segments())]
    elif path.suffix.lower() == ".json":
        records = _json(path)
    elif path.suffix.lower() == ".csv":
        records = _csv(path)
    else:
        if not path.exists():
            raise FileAccessError(f"there is no file {path}")
        what = f"the file name ends in '{path.suffix}'"
        raise ProblemError(Mistake((), what, "schedules end in .csv or .json", place=str(path)))
    if getattr(problem, "infinite", False):  # one cycle, of any length
        return problem.one_cycle(looks_of(records, problem.long))  # type: ignore[attr-defined]
    return looks_of(records, problem)


def looks_of(records: list[tuple[str, dict]], problem: ProblemOfLooks) -> LookSchedule:
    """The schedule of records {start, end, resource, target[, share]}, each with its place.

    Parameters
    ----------
    records : (place, record) in any order
    problem : of many targets

    Raises ProblemError: unknown names, times that are no edges of the problem, shares beyond 1.
    """
    found = Collector()
    resources = {name: i for i, name in enumerate(problem.resource_names)}
    targets = {name: i for i, name in enumerate(problem.target_names)}
    edges = problem.edges
    listed: list[tuple[int, int, int, float]] = []

    def wrong(place: str, what: str, hint: str = "", cause: str = "") -> None:
        found.mistakes.append(Mistake((), what, hint, place=place, cause=cause))

    for place, record in records:
        numbers = {key: record.get(key, 1.0 if key == "share" else None) for key in ("start", "end", "share")}
        bad = [
            key for key, v in numbers.items()
            if isinstance(v, bool) or not isinstance(v, int | float) or not math.isfinite(v)
        ]  # fmt: skip
        if bad:
            wrong(place, f"{bad[0]} is no finite number", "columns: " + ", ".join(COLUMNS), f"number {bad[0]}")
            continue
        rho, i = resources.get(str(record.get("resource"))), targets.get(str(record.get("target")))
        for kind, number, known in (("resource", rho, resources), ("target", i, targets)):
            if number is None:
                name = str(record.get(kind))[:60]
                hint = suggest(name, known) if len(known) <= MOST_NAMES else ""
                wrong(place, f"there is no {kind} '{name}'", hint, f"{kind} {name}")
        if rho is None or i is None:
            continue
        ends = [_edge(float(numbers[key]), edges) for key in ("start", "end")]  # type: ignore[arg-type]
        for key, k in zip(("start", "end"), ends, strict=True):
            if k is None:
                near = edges[np.argsort(np.abs(edges - float(numbers[key])))[:2]]  # type: ignore[arg-type]
                hint = f"the nearest are {min(near):.9g} and {max(near):.9g}"
                wrong(place, f"{key} = {numbers[key]:.9g} is no edge of the problem", hint, f"edge {key}")
        first, last = ends
        if first is None or last is None:
            continue
        if last <= first:
            wrong(place, f"the look ends at {numbers['end']:g}, which is not after its start {numbers['start']:g}")
        elif not 0 <= float(numbers["share"]) <= 1 + JOIN:  # type: ignore[arg-type]
            wrong(place, f"the share is {numbers['share']:g}, it must lie between 0 and 1")
        else:
            listed += [(k, rho, i, float(numbers["share"])) for k in range(first, last)]  # type: ignore[arg-type]
    if found.mistakes:
        raise ProblemError(one_per_cause(found.mistakes))
    table = np.array(listed, dtype=float).reshape(-1, 4)
    k, rho, i = (table[:, j].astype(np.int64) for j in range(3))
    return LookSchedule(edges, k, rho, i, table[:, 3], tuple(resources), tuple(targets))


def _edge(time: float, edges: np.ndarray) -> int | None:
    """The number of the edge that a time is; None if it is none."""
    k = int(np.clip(np.searchsorted(edges, time), 1, len(edges) - 1))
    k = k if abs(edges[k] - time) < abs(edges[k - 1] - time) else k - 1
    steps = np.diff(edges)
    beside = min(steps[min(k, len(steps) - 1)], steps[max(k, 1) - 1])
    return k if abs(edges[k] - time) <= JOIN * beside + resolution(edges) else None


def _csv(path: Path) -> list[tuple[str, dict]]:
    rows = csv_rows(path, COLUMNS, "schedule")
    header = next(rows)[1]
    records = []
    for line, row in rows:
        record: dict = {"resource": from_text(row[2].strip()), "target": from_text(row[3].strip())}
        for key, field in (("start", row[0]), ("end", row[1])):
            record[key] = _number(field)
        if len(header) > 4 and header[4] == "share" and len(row) > 4 and row[4].strip():
            record["share"] = _number(row[4])
        records.append((f"{path}:{line}", record))
    return records


def _number(field: str) -> float | None:
    try:
        return None if "_" in field else float(field)
    except ValueError:
        return None


def _json(path: Path) -> list[tuple[str, dict]]:
    data = parse_json(read_text(path, MAX_BYTES, "schedule").encode(), path)
    data = data.get("schedule") if isinstance(data, dict) else data
    if not isinstance(data, list):
        what = "this is not a schedule of looks"
        raise ProblemError(Mistake((), what, "a list of {start, end, resource, target}", place=f"{path}:1:1"))
    return [(f"{path}: look {i + 1}", record if isinstance(record, dict) else {}) for i, record in enumerate(data)]

"""The run folder: problem.json, result.json, arrays.npz, provenance.json and pictures, written all or nothing.

How a result becomes visible is told in files/run_store.py, which of two results stays in files/run_choice.py. Other
files in the folder are left alone. Folders of the first edition, whose files lie in DIR itself, stay readable.
"""

from __future__ import annotations

import hashlib
import os
import zipfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO

import numpy as np

from occontrol.core.errors import FileAccessError, Mistake, ProblemError
from occontrol.core.kinds import Plain, PlainDict, PlainMapping
from occontrol.core.problem import BaseProblem
from occontrol.core.result import PlainResult
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Certificate, Solution, Status
from occontrol.core.versions import KEY, newer
from occontrol.files.names import check_names
from occontrol.files.plain_json import parse_json, to_json
from occontrol.files.provenance import provenance
from occontrol.files.received_arrays import read_arrays
from occontrol.files.run_choice import Place, ends_interruption, place_for, problem_digest
from occontrol.files.run_lock import check_writable, locked
from occontrol.files.run_read import in_one_piece, open_file
from occontrol.files.run_record import ARRAYS, KNOWN, PROBLEM, PROVENANCE, RESULT
from occontrol.files.run_store import discard, staged

__all__ = [
    "ARRAYS", "KNOWN", "PROBLEM", "RESULT", "Placed", "check_writable", "locked", "place_run", "read_run", "write_run",
]  # fmt: skip
_OWN_KEYS = (
    KEY, "family", "status", "message", "method", "iterations", "seconds", "history", "versions", "digest", "files",
)  # fmt: skip


@dataclass(frozen=True)
class Placed:
    """Where a result went.

    Parameters
    ----------
    content : of its result.json
    folder : DIR or DIR/interrupted; None where a better one is kept in both
    remark : why it is not in DIR, or empty
    """

    content: PlainDict
    folder: Path | None
    remark: str = ""


def write_run(
    folder: str | Path,
    document: PlainMapping,
    solution: Solution,
    extras: Callable[[Path, dict], None] | None = None,
) -> PlainDict:
    """Write a run folder and return the content of its result.json.

    Parameters
    ----------
    folder : the run folder, created if missing; an earlier result in it is replaced only when the new one is complete,
        and an interrupted result that is worse goes to DIR/interrupted
    document : the problem that was solved, as a dict with all tables embedded
    solution : Solution
    extras : called with the folder under construction and the content of result.json, to add pictures and the like

    Raises FileAccessError when the folder cannot be written, or is in use by another process.
    """
    return place_run(folder, document, solution, extras).content


def place_run(
    folder: str | Path,
    document: PlainMapping,
    solution: Solution,
    extras: Callable[[Path, dict], None] | None = None,
    asked: PlainMapping | None = None,
) -> Placed:
    """Like `write_run`; says where the result went.

    Parameters
    ----------
    folder, document, solution, extras : as there
    asked : the problem as it was posed, where the solver has added edges to the one that it solved; its digest tells
        which results belong together
    """
    folder = Path(folder)
    with locked(folder):
        content = {**solution.as_dict(), "digest": problem_digest(document if asked is None else asked)}
        content = parse_json(to_json(content).encode(), folder)  # what the file will say
        where, remark = place_for(folder, content)
        aside = folder / Place.INTERRUPTED.value
        if where is Place.NOWHERE:
            return Placed(content, None, remark)
        if where is Place.HERE:
            _write(folder, document, solution, content, extras)
            if ends_interruption(folder, content):
                with locked(aside):
                    discard(aside)
                with suppress(OSError):
                    aside.rmdir()
            return Placed(content, folder)
        with locked(aside):
            _write(aside, document, solution, content, extras)
        return Placed(content, aside, remark)


def _write(
    folder: Path,
    document: PlainMapping,
    solution: Solution,
    content: PlainDict,
    extras: Callable[[Path, dict], None] | None,
) -> None:
    with staged(folder) as stage:
        (stage / PROBLEM).write_text(to_json(document), encoding="utf-8")
        _write_arrays(stage / ARRAYS, solution.arrays)
        content["files"] = {name: _digest((stage / name).read_bytes()) for name in (ARRAYS, PROBLEM)}
        if extras is not None:
            extras(stage, content)
        # pictures and report show seconds: their digests would make result.json differ from run to run
        others = sorted(p for p in stage.rglob("*") if p.is_file() and p.name not in (ARRAYS, PROBLEM))
        record = {p.relative_to(stage).as_posix(): _digest(p.read_bytes()) for p in others}
        (stage / PROVENANCE).write_text(to_json({**provenance(), "files": record}), encoding="utf-8")
        (stage / RESULT).write_text(to_json(content), encoding="utf-8")


def _write_arrays(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """An .npz without pickles whose bytes depend on nothing but the arrays."""
    check_names(arrays, "an array", str(path))
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        for name in sorted(arrays):
            with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True) as file:
                np.lib.format.write_array(file, np.ascontiguousarray(arrays[name]), allow_pickle=False)


def _digest(content: bytes) -> str:
    return "sha256:" + hashlib.sha256(content).hexdigest()


def read_run(folder: str | Path, read_problem: Callable[[Path], BaseProblem]) -> tuple[BaseProblem, Solution]:
    """The problem and the Solution of the run folder `folder`; its numbers are a PlainResult, entry by entry.

    Parameters
    ----------
    folder : the run folder
    read_problem : makes the problem of a problem.json

    Raises ProblemError naming the file that is missing, damaged, or does not belong to the others; FileAccessError when
    there is no such folder or it cannot be read.
    """
    folder = Path(folder)
    try:
        return in_one_piece(folder, lambda locate: _read(folder, locate, read_problem))
    except OSError as error:
        raise FileAccessError(f"cannot read {folder}: {error.strerror or error}") from error


def _read(
    folder: Path, locate: Callable[[str], Path], read_problem: Callable[[Path], BaseProblem]
) -> tuple[BaseProblem, Solution]:
    shown = {name: folder / name for name in (RESULT, PROBLEM, ARRAYS)}
    paths = {name: locate(name) for name in shown}
    with open_file(paths[RESULT], shown[RESULT]) as file:
        content = parse_json(file.read(), shown[RESULT])
    if not isinstance(content, dict) or any(key not in content for key in ("family", "status", "method")):
        what = "not the result of a run: family, status or method is missing"
        raise ProblemError(Mistake((), what, place=str(shown[RESULT])))
    if later := newer(content):
        raise ProblemError(replace(later, place=str(shown[RESULT])))
    if content["status"] not in list(Status):
        raise ProblemError(Mistake((), f"unknown status '{content['status']}'", place=str(shown[RESULT])))
    recorded = content.get("files")
    if not isinstance(recorded, dict):
        what = "result.json does not say which files belong to it"
        raise ProblemError(Mistake((), what, place=str(shown[RESULT])))
    check_names(_columns(content.get("schedule")), "a column of the schedule", str(shown[RESULT]))
    with open_file(paths[PROBLEM], shown[PROBLEM]) as file:
        _must_belong(file, PROBLEM, recorded, shown[PROBLEM])
    problem = read_problem(paths[PROBLEM])
    if problem.family != content["family"]:
        what = f"result.json is of family {content['family']}, problem.json of {problem.family}"
        raise ProblemError(Mistake((), what, place=str(folder)))
    with open_file(paths[ARRAYS], shown[ARRAYS]) as file:
        _must_belong(file, ARRAYS, recorded, shown[ARRAYS])
        file.seek(0, os.SEEK_SET)
        arrays = read_arrays(file, str(shown[ARRAYS]))
    return problem, _solution(problem, content, arrays, shown[RESULT])


def _columns(schedule: Plain) -> list[str]:
    records = schedule if isinstance(schedule, list) else []
    return list(dict.fromkeys(key for record in records if isinstance(record, dict) for key in record))


def _must_belong(file: IO[bytes], name: str, recorded: dict, place: Path) -> None:
    if recorded.get(name) != "sha256:" + hashlib.file_digest(file, "sha256").hexdigest():  # type: ignore[arg-type]
        what = f"{name} is damaged, or does not belong to the result.json beside it"
        raise ProblemError(Mistake((), what, "solve again", place=str(place)))


def _solution(problem: BaseProblem, content: dict, arrays: dict[str, np.ndarray], path: Path) -> Solution:
    result = {key: value for key, value in content.items() if key not in _OWN_KEYS}
    certificate = None
    numbers = [result.get("cost"), result.get("lower_bound")]
    absolute = bool(getattr(problem, "logarithmic", False))
    if all(isinstance(x, int | float) for x in numbers):
        certificate = Certificate(float(numbers[0]), float(numbers[1]), absolute=absolute)  # type: ignore[arg-type]
    try:
        schedule = None
        if {"edges", "weights"} <= arrays.keys():
            if any(arrays[name].dtype.kind not in "fiu" for name in ("edges", "weights")):
                raise ValueError("edges and weights are not real numbers")
            make = getattr(problem, "make_schedule", None)  # a problem of readings has schedules of its own kind
            if make is None:
                schedule = Schedule(arrays["edges"], arrays["weights"], tuple(problem.sensors.names))
            else:
                schedule = make(arrays["edges"], arrays["weights"])
        return replace(
            Solution(
                family=content["family"],
                method=str(content["method"]),
                status=Status(content["status"]),
                message=str(content.get("message", "")),
                iterations=int(content.get("iterations") or 0),
                seconds=float(content.get("seconds") or 0.0),
                numbers=PlainResult(result),
                arrays=arrays,
                schedule=schedule,
                certificate=certificate,
                history=tuple(content.get("history") or ()),
                versions=dict(content.get("versions") or {}),
            ),
            problem=problem,
        )
    except (TypeError, ValueError, AttributeError, OverflowError) as error:
        raise ProblemError(Mistake((), f"the result does not fit the problem: {error}", place=str(path))) from None

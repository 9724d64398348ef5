"""The run folder: problem.json, result.json, arrays.npz and pictures, written all or nothing.

A new result is first written and flushed to a hidden folder inside the run folder. One rename to `.incoming` commits
it; then its files move to their places, result.json last. Readers look into `.incoming` first, so that they see the old
result or the new one and never a mixture, wherever a crash fell. Other files in the folder are left alone.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from occontrol.core.errors import FileAccessError, Mistake, ProblemError
from occontrol.core.result import PlainResult
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Certificate, Solution, Status
from occontrol.files.plain_json import load_json, to_json

PROBLEM, RESULT, ARRAYS = "problem.json", "result.json", "arrays.npz"
COMMITTED = ".incoming"
_OWN_KEYS = ("family", "status", "message", "method", "iterations", "seconds", "history", "versions", "files")


def check_writable(folder: Path) -> None:
    """Raise FileAccessError unless `folder` is, or can become, a folder that may be written to."""
    nearest = folder
    while not os.path.lexists(nearest) and nearest != nearest.parent:
        nearest = nearest.parent
    if not nearest.is_dir():
        raise FileAccessError(f"cannot write to {folder}: {nearest} is not a folder")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise FileAccessError(f"cannot write to {folder}: no permission")


def write_run(
    folder: str | Path,
    document: Mapping[str, Any],
    solution: Solution,
    extras: Callable[[Path, dict], None] | None = None,
) -> dict[str, Any]:
    """Write a run folder and return the content of its result.json.

    Parameters
    ----------
    folder : the run folder, created if missing; an earlier result in it is replaced only when the new one is complete
    document : the problem that was solved, everything embedded
    solution : Solution
    extras : called with the folder under construction and the content of result.json, to add pictures and the like

    Raises FileAccessError when the folder cannot be written.
    """
    folder = Path(folder)
    check_writable(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        stage = Path(tempfile.mkdtemp(prefix=".writing-", dir=folder))
        try:
            (stage / PROBLEM).write_text(to_json(document), encoding="utf-8")
            _write_arrays(stage / ARRAYS, solution.arrays)
            content = solution.as_dict()
            if extras is not None:
                extras(stage, content)
            written = sorted(p for p in stage.rglob("*") if p.is_file())
            content["files"] = {p.relative_to(stage).as_posix(): _digest(p) for p in written}
            (stage / RESULT).write_text(to_json(content), encoding="utf-8")
            _flush(stage)
            _commit(stage, folder)
        except BaseException:
            shutil.rmtree(stage, ignore_errors=True)
            raise
    except OSError as error:
        raise FileAccessError(f"cannot write to {folder}: {error.strerror or error}") from error
    return content


def _write_arrays(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """An .npz without pickles whose bytes depend on nothing but the arrays."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        for name in sorted(arrays):
            with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True) as file:
                np.lib.format.write_array(file, np.ascontiguousarray(arrays[name]), allow_pickle=False)


def _digest(path: Path) -> str:
    return "sha256:" + hashlib.sha256(path.read_bytes()).hexdigest()


def _flush(folder: Path) -> None:
    for path in [*(p for p in folder.rglob("*")), folder]:
        handle = os.open(path, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def _commit(stage: Path, folder: Path) -> None:
    _finish(folder)  # what an earlier, killed writer had committed
    old, new = _written_files(folder), _written_files(stage)
    os.rename(stage, folder / COMMITTED)
    _finish(folder)
    for name in old - new:  # pictures of the earlier result that the new one does not have
        (folder / name).unlink(missing_ok=True)


def _written_files(folder: Path) -> set[str]:
    """What the result.json in a folder says was written with it; nothing that lies outside of the folder."""
    try:
        names = load_json(folder / RESULT)["files"].keys()
    except (OSError, ProblemError, TypeError, KeyError, AttributeError):
        return set()
    return {name for name in names if not Path(name).is_absolute() and ".." not in Path(name).parts}


def _finish(folder: Path) -> None:
    """Move committed files to their places, result.json last."""
    committed = folder / COMMITTED
    if not committed.is_dir():
        return
    files = sorted((p for p in committed.rglob("*") if p.is_file()), key=lambda p: (p.name == RESULT, str(p)))
    for path in files:
        target = folder / path.relative_to(committed)
        target.parent.mkdir(parents=True, exist_ok=True)
        os.replace(path, target)
    shutil.rmtree(committed)


def _locate(folder: Path, name: str) -> Path:
    committed = folder / COMMITTED / name
    path = committed if committed.exists() else folder / name
    if not path.exists():
        hint = "occontrol solve FILE --out DIR writes a run folder"
        if not folder.is_dir():
            raise FileAccessError(f"{folder}: no such run folder\n  hint: {hint}")
        raise ProblemError(Mistake((), f"{name} is missing", hint, place=str(folder)))
    return path


def read_run(folder: str | Path, read_problem: Callable[[Path], Any]) -> tuple[Any, Solution]:
    """The problem and the Solution of the run folder `folder`; its numbers are a PlainResult, entry by entry.

    Parameters
    ----------
    folder : the run folder
    read_problem : builds the problem from problem.json

    Raises ProblemError naming the file that is missing, damaged, or does not belong to the others; FileAccessError when
    there is no such folder or it cannot be read.
    """
    folder = Path(folder)
    result_path, problem_path, arrays_path = (_locate(folder, name) for name in (RESULT, PROBLEM, ARRAYS))
    try:
        content = load_json(result_path)
        if not isinstance(content, dict) or any(key not in content for key in ("family", "status", "method")):
            raise ProblemError(
                Mistake((), "not the result of a run: family, status or method is missing", place=str(result_path))
            )
        if content["status"] not in list(Status):
            raise ProblemError(Mistake((), f"unknown status '{content['status']}'", place=str(result_path)))
        _check_digests(content, {PROBLEM: problem_path, ARRAYS: arrays_path}, result_path)
        problem = read_problem(problem_path)
        arrays = _read_arrays(arrays_path)
    except OSError as error:
        raise FileAccessError(f"cannot read {folder}: {error.strerror or error}") from error
    if problem.family != content["family"]:
        what = f"result.json is of family {content['family']}, problem.json of {problem.family}"
        raise ProblemError(Mistake((), what, place=str(folder)))
    return problem, _solution(problem, content, arrays, result_path)


def _check_digests(content: dict, paths: Mapping[str, Path], result_path: Path) -> None:
    recorded = content.get("files")
    if not isinstance(recorded, dict):
        raise ProblemError(Mistake((), "result.json does not say which files belong to it", place=str(result_path)))
    for name, path in paths.items():
        if recorded.get(name) != _digest(path):
            what = f"{name} is damaged, or does not belong to the result.json beside it"
            raise ProblemError(Mistake((), what, "solve again", place=str(path)))


def _read_arrays(path: Path) -> dict[str, np.ndarray]:
    try:
        with np.load(path, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except (ValueError, zipfile.BadZipFile, KeyError, EOFError, AttributeError) as error:
        raise ProblemError(Mistake((), f"not a readable .npz file: {error}", place=str(path))) from None


def _solution(problem: Any, content: dict, arrays: dict[str, np.ndarray], path: Path) -> Solution:
    result = {key: value for key, value in content.items() if key not in _OWN_KEYS}
    certificate = None
    numbers = [result.get("cost"), result.get("lower_bound")]
    if all(isinstance(x, int | float) for x in numbers):
        certificate = Certificate(float(numbers[0]), float(numbers[1]))  # type: ignore[arg-type]
    try:
        schedule = None
        if {"edges", "weights"} <= arrays.keys():
            if any(arrays[name].dtype.kind not in "fiu" for name in ("edges", "weights")):
                raise ValueError("edges and weights are not real numbers")
            schedule = Schedule(arrays["edges"], arrays["weights"], tuple(problem.sensors.names))
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

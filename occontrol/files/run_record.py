"""What a result says was written with it, and the removal of exactly that.

Only names that this program ever writes count, only ordinary files that no link leads to, and only as long as their
content has the recorded digest: what a user has changed or added stays.
"""

from __future__ import annotations

import hashlib
import os
import re
import stat
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path, PurePosixPath

from occontrol.core.errors import ProblemError, UsageError
from occontrol.files.atomic import refuse_same
from occontrol.files.plain_json import load_json

PROBLEM, RESULT, ARRAYS = "problem.json", "result.json", "arrays.npz"
PROVENANCE, REPORT, FIGURES = "provenance.json", "report.html", "figures"
KNOWN = (PROBLEM, RESULT, ARRAYS, PROVENANCE, REPORT)
_PICTURE = re.compile(rf"{FIGURES}/[A-Za-z0-9_][A-Za-z0-9_.-]{{0,99}}\.(png|svg|pdf|html)")
_MOST = 10_000  # files of one run


def remove_run(path: Path) -> None:
    """Remove DIR/.runs/N: every file whose name and digest stand in its own record, and then folders that are empty.

    Parameters
    ----------
    path : the folder of the run; links in it or to it are not followed
    """
    if path.is_symlink():
        return
    for name, digest in recorded_files(path).items():
        remove_recorded(path, name, digest)
    for name in (PROVENANCE, RESULT):
        with suppress(OSError):
            if stat.S_ISREG(os.lstat(path / name).st_mode):
                os.unlink(path / name)
    for folder in (path / FIGURES, path):
        with suppress(OSError):
            if not folder.is_symlink():
                os.rmdir(folder)


def refuse_run_files(run: Path, target: Path) -> None:
    """UsageError when `target` is one of the files that make the run folder `run`, or lies where they are kept.

    Parameters
    ----------
    run : a run folder
    target : file or folder that will be written
    """
    refuse_same([target], [run / name for name in KNOWN])
    if any(parent.is_file() for parent in target.parents):
        return  # nothing can be written there
    for kept in (run / ".runs", run / "current", run / FIGURES):
        if kept.is_dir() and target.resolve().is_relative_to(kept.resolve()):
            raise UsageError(f"{target} lies where {run} keeps its results\n  hint: name another output")


def recorded_files(folder: Path) -> dict[str, str]:
    """Digests by name of what the result in a folder says was written with it; only names that we ever write.

    Parameters
    ----------
    folder : that holds result.json
    """
    found: dict[str, str] = {}
    for record in (PROVENANCE, RESULT):
        with suppress(OSError, ProblemError):
            if not stat.S_ISREG(os.lstat(folder / record).st_mode) or os.lstat(folder / record).st_size > 64 * 2**20:
                continue
            content = load_json(folder / record)
            files = content.get("files") if isinstance(content, dict) else None
            if isinstance(files, Mapping) and len(files) <= _MOST:
                found |= {k: v for k, v in files.items() if isinstance(v, str) and _ever_written(k)}
    return found


def _ever_written(name: str) -> bool:
    return name in KNOWN or _PICTURE.fullmatch(name) is not None


def remove_recorded(folder: Path, name: str, digest: str) -> None:
    """Remove one file if it is an ordinary one, reached through no link, whose content has the recorded digest.

    Parameters
    ----------
    folder, name : where it is
    digest : "sha256:.."
    """
    with suppress(OSError):
        if digest_of(folder, name) == digest:
            os.unlink(folder / name)


def digest_of(folder: Path, name: str) -> str | None:
    """The digest of an ordinary file that is reached through no link below `folder`; None for anything else.

    Parameters
    ----------
    folder, name : where it is
    """
    path = folder
    for part in PurePosixPath(name).parts[:-1]:
        path = path / part
        if path.is_symlink():
            return None
    try:
        handle = os.open(folder / name, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError:
        return None
    with os.fdopen(handle, "rb") as file:
        if not stat.S_ISREG(os.fstat(handle).st_mode):
            return None
        return "sha256:" + hashlib.file_digest(file, "sha256").hexdigest()

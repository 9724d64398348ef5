"""Opening what a run folder shows at one moment: ordinary files, inside the folder, never larger than they may be."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO, TypeVar

from occontrol.core.errors import FileAccessError, Mistake, ProblemError
from occontrol.files.run_record import PROBLEM, PROVENANCE, RESULT
from occontrol.files.run_store import COMMITTED, current_run

T = TypeVar("T")
TRIES = 50  # a reader that is overtaken this often gives up
LARGEST = {PROBLEM: 64 * 2**20, RESULT: 256 * 2**20, PROVENANCE: 2**20}


def in_one_piece(folder: Path, read: Callable[[Callable[[str], Path]], T]) -> T:
    """read(locate), where locate(name) gives the path of each file of one and the same result.

    Parameters
    ----------
    folder : the run folder
    read : is called again when a writer has removed that result meanwhile

    Raises whatever `read` raises, when nobody has written, and FileAccessError when somebody writes all the time.
    """
    for _ in range(TRIES):
        before = current_run(folder)
        try:
            return read(lambda name, base=before: _locate(folder, base, name))
        except (FileNotFoundError, FileAccessError, ProblemError):
            if current_run(folder) == before:
                raise
    raise FileAccessError(f"cannot read {folder}: it is being written all the time")


def open_file(path: Path, place: Path) -> BinaryIO:
    """An ordinary file, open for reading; ProblemError for a pipe, a device, a folder, or one that is too large.

    Parameters
    ----------
    path : the file
    place : what to call it in a message
    """
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    file = os.fdopen(handle, "rb") if stat.S_ISREG(os.fstat(handle).st_mode) else None
    if file is None:
        os.close(handle)
        raise _wrong("this is not an ordinary file", place)
    limit = LARGEST.get(path.name)
    if limit is not None and os.fstat(handle).st_size > limit:
        file.close()
        raise _wrong(f"the file is larger than {limit >> 20} MB", place)
    return file


def _locate(folder: Path, base: Path | None, name: str) -> Path:
    """Where a file of the result lies: DIR/.runs/N, or, written by the first edition, DIR/.incoming or DIR."""
    if base is None and (folder / COMMITTED / name).exists() and not (folder / COMMITTED).is_symlink():
        base = folder / COMMITTED
    path = (base or folder) / name
    # whoever takes away the path that everybody knows has taken the file away
    if not path.exists() or not os.path.lexists(folder / name):
        hint = "occontrol solve FILE --out DIR writes a run folder"
        if not folder.is_dir():
            raise FileAccessError(f"{folder}: no such run folder\n  hint: {hint}")
        raise ProblemError(Mistake((), f"{name} is missing", hint, place=str(folder)))
    if path.is_symlink() and not path.resolve().is_relative_to(folder.resolve()):
        raise _wrong("this is a link that leads out of the run folder", folder / name)
    return path


def _wrong(what: str, place: Path) -> ProblemError:
    return ProblemError(Mistake((), what, place=str(place)))

"""Where results lie in a run folder: DIR/.runs/N, and DIR/current, whose one rename makes a result visible.

The paths that everybody knows (DIR/result.json, DIR/figures/overview.png, ..) are links through `current`, so that they
all change at that rename. Nothing is followed that is not one of these links, and nothing is removed but what was
written here: its name stands in the record of its run, and its content still has the recorded digest.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from occontrol.core.errors import FileAccessError, ProblemError
from occontrol.files.atomic import WRITTEN, flush_folder, sweep
from occontrol.files.owner import left_by_the_dead, mark
from occontrol.files.run_lock import RUNS, own_folder
from occontrol.files.run_record import (
    ARRAYS,
    FIGURES,
    KNOWN,
    PROBLEM,
    RESULT,
    digest_of,
    recorded_files,
    remove_recorded,
    remove_run,
)

CURRENT, COMMITTED = "current", ".incoming"
_CURRENT = re.compile(rf"{re.escape(RUNS)}/(\d{{1,9}})")


def current_run(folder: Path) -> Path | None:
    """DIR/.runs/N that DIR/current names; None where there is no such link.

    Parameters
    ----------
    folder : the run folder

    Raises ProblemError for a link `current` that leads anywhere else.
    """
    try:
        target = os.readlink(folder / CURRENT)
    except OSError:
        return None
    if not _CURRENT.fullmatch(target) or (folder / RUNS).is_symlink() or (folder / target).is_symlink():
        raise ProblemError(f"{folder}/{CURRENT} is a link that occontrol did not make: it leads to '{target}'")
    return folder / target


def refuse_links(folder: Path) -> None:
    """FileAccessError for a link at one of our places that we did not make; nothing is written through it.

    Parameters
    ----------
    folder : the run folder
    """
    try:
        current_run(folder)
    except ProblemError as error:
        raise FileAccessError(f"cannot write to {folder}: {error}") from None
    ours = {name: f"{CURRENT}/{name}" for name in KNOWN} | dict.fromkeys((FIGURES, COMMITTED, "interrupted"), "")
    for name, target in ours.items():
        path = folder / name
        if path.is_symlink() and os.readlink(path) != target:
            what = f"{path} is a link that occontrol did not make: it leads to '{os.readlink(path)}'"
            raise FileAccessError(f"cannot write to {folder}: {what}\n  hint: remove the link")


@contextmanager
def staged(folder: Path) -> Iterator[Path]:
    """A folder to write a result into; it becomes DIR/current when the block ends without an error.

    Parameters
    ----------
    folder : the run folder, locked by this process

    Raises FileAccessError; then the run folder shows what it showed before.
    """
    try:
        refuse_links(folder)
        sweep(folder)
        runs = folder / RUNS
        own_folder(runs)
        for name in os.listdir(runs):
            if left_by_the_dead(name):
                shutil.rmtree(runs / name, ignore_errors=True)
        stage = runs / mark()
        os.mkdir(stage)
        try:
            yield stage
            _flush(stage)
            _adopt_first_edition(folder)
            number = _free_number(runs)
            os.rename(stage, runs / str(number))
        except BaseException:
            shutil.rmtree(stage, ignore_errors=True)
            raise
        flush_folder(runs)
        _show(folder, number)
        WRITTEN.append(folder)
    except OSError as error:
        raise FileAccessError(f"cannot write to {folder}: {error.strerror or error}") from error


def _show(folder: Path, number: int) -> None:
    """Switch `current` to run `number`; add links for what is new in it, remove those of what it lacks."""
    runs = folder / RUNS
    before = current_run(folder)
    names = _files_below(runs / str(number))
    if any(name.startswith(f"{FIGURES}/") for name in names):
        own_folder(folder / FIGURES)
    for name in names:
        _link(folder / name, _target(name))
    _move_aside(folder / CURRENT)
    _replace_by_link(folder / CURRENT, f"{RUNS}/{number}")
    flush_folder(folder)
    _remove_stale_links(folder, set(names))
    kept = {str(number), "" if before is None else before.name}
    for name in os.listdir(runs):
        if name.isdigit() and name not in kept:
            remove_run(runs / name)


def discard(folder: Path) -> None:
    """Remove a whole run folder as far as it was written here; what is anybody else's stays.

    Parameters
    ----------
    folder : for example DIR/interrupted, locked by this process
    """
    with suppress(OSError, ProblemError):
        if folder.is_symlink() or current_run(folder) is None:
            return
        os.unlink(folder / CURRENT)
        _remove_stale_links(folder, set())
        for name in os.listdir(folder / RUNS):
            if name.isdigit() or left_by_the_dead(name):
                remove_run(folder / RUNS / name)


def _adopt_first_edition(folder: Path) -> None:
    """A result whose files lie in DIR itself becomes .runs/N: the same content before, during and after."""
    if current_run(folder) is not None:
        return
    committed = folder / COMMITTED if (folder / COMMITTED).is_dir() else folder

    def source(name: str) -> Path:
        return committed if (committed / name).exists() else folder

    recorded = recorded_files(source(RESULT))
    whole = {name: source(name) for name, digest in recorded.items() if digest_of(source(name), name) == digest}
    if PROBLEM in whole and ARRAYS in whole and digest_of(source(RESULT), RESULT):
        whole[RESULT] = source(RESULT)
        stage = folder / RUNS / mark()
        (stage / FIGURES).mkdir(parents=True)
        for name, where in whole.items():
            try:
                os.link(where / name, stage / name, follow_symlinks=False)
            except OSError:
                shutil.copyfile(where / name, stage / name, follow_symlinks=False)
        _flush(stage)
        number = _free_number(folder / RUNS)
        os.rename(stage, folder / RUNS / str(number))
        _move_aside(folder / CURRENT)
        _replace_by_link(folder / CURRENT, f"{RUNS}/{number}")
        for name in whole:
            if (folder / name).parent.is_dir():
                _replace_by_link(folder / name, _target(name))
    if committed is not folder:
        for name, digest in [*recorded.items(), (RESULT, digest_of(committed, RESULT) or "")]:
            remove_recorded(committed, name, digest)
        for path in (committed / FIGURES, committed):
            with suppress(OSError):
                os.rmdir(path)


def _target(name: str) -> str:
    return "../" * name.count("/") + f"{CURRENT}/{name}"


def _link(path: Path, target: str) -> None:
    """A link of ours at `path`; what anybody else has put there moves aside."""
    if path.is_symlink() and os.readlink(path) == target:
        return
    if path.is_symlink():
        raise FileAccessError(f"{path} is a link that occontrol did not make\n  hint: remove the link")
    _move_aside(path)
    _replace_by_link(path, target)


def _move_aside(path: Path) -> None:
    """What is not a link gets the name NAME.old, or the next one that is free: it may be the user's own."""
    if path.is_symlink() or not path.exists():
        return
    for number in range(1, 1000):
        target = path.with_name(f"{path.name}.old{number if number > 1 else ''}")
        if not os.path.lexists(target):
            os.rename(path, target)
            return
    raise FileAccessError(f"{path} was not written by occontrol, and there is no name left to keep it under")


def _replace_by_link(path: Path, target: str) -> None:
    part = path.with_name(f".{path.name}{mark()}")
    os.symlink(target, part)
    try:
        os.replace(part, path)
    except BaseException:
        with suppress(OSError):
            os.unlink(part)
        raise


def _remove_stale_links(folder: Path, names: set[str]) -> None:
    """Remove links of ours to what the current run does not have."""
    pictures = folder / FIGURES
    candidates = list(KNOWN)
    if pictures.is_dir() and not pictures.is_symlink():
        candidates += [f"{FIGURES}/{entry}" for entry in os.listdir(pictures)]
    for name in candidates:
        path = folder / name
        if name not in names and path.is_symlink() and os.readlink(path) == _target(name):
            os.unlink(path)
    with suppress(OSError):
        os.rmdir(pictures)


def _free_number(runs: Path) -> int:
    return 1 + max((int(name) for name in os.listdir(runs) if name.isdigit() and len(name) < 9), default=0)


def _files_below(folder: Path) -> list[str]:
    return sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())


def _flush(folder: Path) -> None:
    for path in [*folder.rglob("*"), folder]:
        handle = os.open(path, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)

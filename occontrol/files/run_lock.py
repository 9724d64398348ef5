"""One writer at a time for a run folder: a lock that the system releases with the process, and that names its owner."""

from __future__ import annotations

import os
import stat
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from occontrol.core.errors import FileAccessError
from occontrol.files.owner import alive, boot

try:
    import fcntl
except ImportError:  # a system without it: the number in the file has to do
    fcntl = None  # type: ignore[assignment]

RUNS, LOCK = ".runs", "lock"
PATIENCE, PAUSE = 200, 0.01  # how often, and after how many seconds, an owner without a number is looked at again
_held: dict[str, list[int]] = {}  # real path -> [thread, how often]
_guard = threading.Lock()


def check_writable(folder: Path) -> None:
    """Raise FileAccessError unless `folder` is, or can become, a folder that may be written to."""
    nearest = folder
    while not os.path.lexists(nearest) and nearest != nearest.parent:
        nearest = nearest.parent
    if not nearest.is_dir():
        raise FileAccessError(f"cannot write to {folder}: {nearest} is not a folder")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise FileAccessError(f"cannot write to {folder}: no permission")


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the run folder `folder` for this thread; it is created, and removed again if nothing came into it.

    Parameters
    ----------
    folder : the run folder; a thread that holds it already may enter again

    Raises FileAccessError, 'in use by pid N', when somebody else is at work in it, or when it cannot be written.
    """
    check_writable(folder)
    key = os.path.realpath(folder)
    me = threading.get_ident()
    with _guard:
        owner = _held.get(key)
        if owner is not None and owner[0] != me:
            raise _in_use(folder, os.getpid())
        if owner is not None:
            owner[1] += 1
    if owner is None:
        try:
            created = _create(folder)
            handle = _acquire(folder)
        except OSError as error:
            raise FileAccessError(f"cannot write to {folder}: {error.strerror or error}") from error
        with _guard:
            _held[key] = [me, 1]
    try:
        yield
    finally:
        with _guard:
            _held[key][1] -= 1
            last = _held[key][1] == 0
            if last:
                del _held[key]
        if last:
            _release(folder, handle, created)


def own_folder(path: Path) -> None:
    """Make a folder of ours, or see that it is one and not a link; FileAccessError otherwise.

    Parameters
    ----------
    path : the folder; its parent exists
    """
    with suppress(FileExistsError):
        os.mkdir(path)
    if not stat.S_ISDIR(os.lstat(path).st_mode):
        raise FileAccessError(f"cannot write to {path}: it is not a folder of occontrol's\n  hint: move it away")


def _create(folder: Path) -> list[Path]:
    """Make the folder and what is missing above it; what was made, the innermost first."""
    missing = []
    nearest = folder
    while not nearest.exists() and nearest != nearest.parent:
        missing.append(nearest)
        nearest = nearest.parent
    folder.mkdir(parents=True, exist_ok=True)
    own_folder(folder / RUNS)
    return missing


def _acquire(folder: Path) -> int:
    path = folder / RUNS / LOCK
    flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    while True:
        try:
            handle = os.open(path, flags, 0o666)
        except FileNotFoundError:  # the last one has just tidied up
            folder.mkdir(parents=True, exist_ok=True)
            own_folder(folder / RUNS)
            continue
        try:
            if not stat.S_ISREG(os.fstat(handle).st_mode):
                raise FileAccessError(f"cannot write to {folder}: {path} is not an ordinary file")
            _take(handle, folder)
            with suppress(OSError):
                if os.path.samestat(os.fstat(handle), os.lstat(path)):
                    os.ftruncate(handle, 0)
                    os.pwrite(handle, f"{os.getpid()} {boot()}\n".encode("ascii"), 0)
                    return handle
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)  # it was removed in between: once more


def _take(handle: int, folder: Path) -> None:
    """Lock the open file, or say who has it."""
    for _ in range(PATIENCE):
        if fcntl is not None:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                return
            except BlockingIOError:
                # the owner writes its number after it has got the lock: before that, it may be nobody's or a dead one's
                if pid := _owner(handle):
                    raise _in_use(folder, pid) from None
                time.sleep(PAUSE)
                continue
            except OSError:
                pass  # a file system without locks
        pid = _owner(handle)
        if pid and pid != os.getpid():
            raise _in_use(folder, pid)
        return
    raise _in_use(folder, 0)


def _owner(handle: int) -> int:
    """The number of the living process that has written itself into the file; 0 where there is none."""
    words = os.pread(handle, 100, 0).split()
    pid = int(words[0]) if len(words) == 2 and words[0].isdigit() else 0
    return pid if pid and alive(pid, words[1].decode("ascii", "replace")) else 0


def _in_use(folder: Path, pid: int) -> FileAccessError:
    who = f"pid {pid}" if pid else "another process"
    return FileAccessError(f"{folder}: in use by {who}\n  hint: wait for it, or name another folder with --out")


def _release(folder: Path, handle: int, created: list[Path]) -> None:
    with suppress(OSError):
        if set(os.listdir(folder / RUNS)) <= {LOCK}:  # nothing was written
            os.unlink(folder / RUNS / LOCK)
            os.rmdir(folder / RUNS)
            for path in created:
                os.rmdir(path)
    with suppress(OSError):
        os.ftruncate(handle, 0)
    os.close(handle)

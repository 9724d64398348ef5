"""The one way in which a file is written: beside its place, flushed, then moved there by one rename.

Whoever looks sees the old content or the new one, also when the disk is full or the process is killed. The unfinished
file carries its owner in its name, so that the next write into the folder removes what the dead have left. A link at
the place is replaced and never followed; what is no ordinary file (a pipe, a terminal) is written into as it stands.
"""

from __future__ import annotations

import errno
import io
import os
import stat
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from occontrol.core.errors import FileAccessError, UsageError
from occontrol.files.owner import left_by_the_dead, mark

WRITTEN: list[Path] = []  # by this process, so that an interruption can say what is there
_STREAMS = ("/dev/", "/proc/")


@contextmanager
def replacing(path: str | Path) -> Iterator[BinaryIO]:
    """A binary file that becomes the content of `path` when the block ends without an error.

    Parameters
    ----------
    path : the file; its folder must exist

    Raises FileAccessError when it cannot be written; then `path` is as it was.
    """
    path = Path(path)
    try:
        if _is_stream(path):
            with open(path, "wb") as stream:
                yield stream
            return
        if path.is_dir():
            raise FileAccessError(f"cannot write {path}: it is a folder")
        sweep(path.parent)
        mode = _mode_of(path)
        part = path.with_name(f".{path.name[:100]}{mark()}")
        handle = os.open(part, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
        try:
            with os.fdopen(handle, "w+b") as file:
                if mode is not None:
                    os.fchmod(handle, mode)
                yield file
                file.flush()
                os.fsync(file.fileno())
            os.replace(part, path)
        except BaseException:
            with suppress(OSError):
                os.unlink(part)
            raise
        flush_folder(path.parent)
        WRITTEN.append(path)
    except OSError as error:
        raise FileAccessError(f"cannot write {path}: {error.strerror or error}") from error


@contextmanager
def replacing_text(path: str | Path, encoding: str = "utf-8") -> Iterator[io.TextIOWrapper]:
    """The same for text; line ends are written as they are given.

    Parameters
    ----------
    path : the file
    encoding : of the text
    """
    with replacing(path) as file:
        text = io.TextIOWrapper(file, encoding=encoding, newline="", write_through=True)
        try:
            yield text
            text.flush()
        finally:
            with suppress(ValueError, OSError):
                text.detach()


def write_bytes(path: str | Path, content: bytes) -> Path:
    """Write a whole file and return its path; FileAccessError when it cannot be written.

    Parameters
    ----------
    path : the file
    content : all of it
    """
    with replacing(path) as file:
        file.write(content)
    return Path(path)


def write_text(path: str | Path, content: str) -> Path:
    """Write a whole file of UTF-8 text and return its path; FileAccessError when it cannot be written.

    Parameters
    ----------
    path : the file
    content : all of it
    """
    return write_bytes(path, content.encode("utf-8", "backslashreplace"))


def sweep(folder: Path) -> None:
    """Remove the unfinished files that dead processes have left in a folder.

    Parameters
    ----------
    folder : is not descended into
    """
    with suppress(OSError):
        for entry in os.scandir(folder):
            if left_by_the_dead(entry.name) and not entry.is_dir(follow_symlinks=False):
                with suppress(OSError):
                    os.unlink(entry.path)


def flush_folder(folder: Path) -> None:
    """Make the names in a folder last through a loss of power, where the file system can."""
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def refuse_same(outputs: Sequence[str | Path], inputs: Sequence[str | Path | None]) -> None:
    """UsageError when one of the files to be written is one of those that are read, under whatever name.

    Parameters
    ----------
    outputs : files that will be written
    inputs : files that are read; None is nothing
    """
    for output in outputs:
        for source in inputs:
            if source is not None and same(Path(output), Path(source)):
                also = f" ({source})" if str(output) != str(source) else ""
                raise UsageError(f"{output} is an input{also}, it would be lost\n  hint: name another output")


def same(one: Path, other: Path) -> bool:
    """Whether two paths are the same ordinary file."""
    try:
        return stat.S_ISREG(one.stat().st_mode) and os.path.samefile(one, other)
    except (OSError, ValueError):
        return False


def _mode_of(path: Path) -> int | None:
    """The permissions of the file that will be replaced; PermissionError where it must not be written."""
    try:
        found = os.lstat(path)
    except OSError:
        return None
    if not stat.S_ISREG(found.st_mode):
        return None
    if not os.access(path, os.W_OK):
        raise PermissionError(errno.EACCES, "no permission")
    return stat.S_IMODE(found.st_mode)


def _is_stream(path: Path) -> bool:
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):
        return str(path).startswith(_STREAMS)
    return (not stat.S_ISREG(mode) and not stat.S_ISDIR(mode)) or str(path.absolute()).startswith(_STREAMS)

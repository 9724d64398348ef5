"""Arrays of an .npz file that anybody may have made: names and sizes are judged from the headers, before any memory.

A member is a .npy file: a header that claims a type and a shape, then exactly so many bytes. What a header claims must
be what is there, and what is there unpacked may not be out of proportion to the file.
"""

from __future__ import annotations

import io
import math
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import BinaryIO

import numpy as np

from occontrol.core.errors import Mistake, ProblemError
from occontrol.files.names import TAKEN, check_names

PACKED = 64 * 2**20  # bytes that a compressed file may unpack to, whatever its own size
MEMBERS = 1000
HEADER = 10_000  # bytes
_DAMAGE = (ValueError, zipfile.BadZipFile, KeyError, EOFError, AttributeError, NotImplementedError, RuntimeError,
           OSError, zlib.error, SyntaxError, TypeError, IndexError, OverflowError, UnicodeError)  # fmt: skip


@dataclass(frozen=True)
class Claim:
    """What the header of one array says.

    Parameters
    ----------
    shape : of the array
    dtype : of its entries
    size : bytes of all entries
    """

    shape: tuple[int, ...]
    dtype: np.dtype
    size: int


def read_arrays(file: BinaryIO, place: str, names: bool = True) -> dict[str, np.ndarray]:
    """All arrays of an .npz file of this program.

    Parameters
    ----------
    file : open for reading
    place : what to call it in a message
    names : whether to check the names of the arrays, see files/names.py

    Raises ProblemError for anything else than plain arrays of the sizes that they claim, before they are allocated.
    """
    with _damage(place):
        length = file.seek(0, io.SEEK_END)
        with zipfile.ZipFile(file) as archive:
            members = _members(archive, place)
            if names:
                check_names(members, "an array", place, TAKEN)
            claims = {name: claim(archive, info, place) for name, info in members.items()}
            total = sum(info.file_size for info in members.values())
            if total > max(PACKED, length):
                what = f"claims {_size(total)} of arrays in a file of {_size(length)}"
                raise _wrong(what, "the arrays of a run are not compressed", place)
            return {name: load(archive, info, claims[name]) for name, info in members.items()}


def claim(archive: zipfile.ZipFile, info: zipfile.ZipInfo, place: str) -> Claim:
    """What the header of a member says, compared with the bytes that follow it.

    Parameters
    ----------
    archive, info : the member
    place : what to call the file in a message

    Raises ValueError where the header cannot be trusted, ProblemError where it claims more than there is.
    """
    name = info.filename.removesuffix(".npy")
    with archive.open(info) as member:
        version = np.lib.format.read_magic(member)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = read(member, max_header_size=HEADER)
        start = member.tell()
    if dtype.hasobject:
        raise ValueError(f"the array {name} holds Python objects")
    if any(size < 0 for size in shape):
        raise ValueError(f"the array {name} has a negative size")
    size = math.prod(shape) * dtype.itemsize
    if size != info.file_size - start:
        what = f"the array '{name}' claims {'x'.join(map(str, shape)) or 'one'} entries, {_size(size)}"
        raise _wrong(f"{what}; there are {_size(max(info.file_size - start, 0))}", "", place)
    return Claim(shape, dtype, size)


def load(archive: zipfile.ZipFile, info: zipfile.ZipInfo, claimed: Claim) -> np.ndarray:
    """One array whose claim has been judged.

    Parameters
    ----------
    archive, info : the member
    claimed : by its header

    Raises ValueError where the header is another one than before.
    """
    with archive.open(info) as member:
        array = np.lib.format.read_array(member, allow_pickle=False, max_header_size=HEADER)
    if array.shape != claimed.shape:
        raise ValueError("a header changed while it was read")
    return array


def _members(archive: zipfile.ZipFile, place: str) -> dict[str, zipfile.ZipInfo]:
    infos = archive.infolist()
    if len(infos) > MEMBERS:
        raise _wrong(f"holds {len(infos)} arrays, the limit is {MEMBERS}", "", place)
    members = {info.filename.removesuffix(".npy"): info for info in infos}
    if len(members) < len(infos):
        raise _wrong("holds two arrays of the same name", "", place)
    if not all(info.filename.endswith(".npy") for info in infos):
        raise _wrong("not a readable .npz file: it holds something that is no array", "", place)
    return members


@contextmanager
def _damage(place: str) -> Iterator[None]:
    try:
        yield
    except _DAMAGE as error:
        raise _wrong(f"not a readable .npz file: {error}", "", place) from None


def _size(count: int) -> str:
    for unit, power in (("GB", 30), ("MB", 20), ("kB", 10)):
        if count >= 2**power:
            return f"{count / 2**power:.4g} {unit}"
    return f"{count} bytes"


def _wrong(what: str, hint: str, place: str) -> ProblemError:
    return ProblemError(Mistake((), what, hint, place=place))

"""Arrays of a MATLAB file that anybody may have made (versions 4 to 7); sizes are judged before memory is taken."""

from __future__ import annotations

import math
import zlib
from pathlib import Path

import numpy as np

from occontrol.core.errors import Mistake, ProblemError

PACKED = 512 * 2**20  # bytes that a file may unpack to
NUMBERS = {"double", "single", "logical", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64))}
_COMPRESSED = 15


def mat_shapes(path: Path, place: str) -> dict[str, tuple[int, ...] | None]:
    """The shape of every array of numbers by name, None for what is something else (text, structs, cells).

    Parameters
    ----------
    path : the file
    place : what to call it in a message

    Raises ProblemError for what is no MATLAB file of version 4 to 7, or unpacks to too much.
    """
    from scipy.io import whosmat

    with path.open("rb") as file:
        head = file.read(128)
    if head.startswith(b"MATLAB 7.3") or head.startswith(b"\x89HDF"):
        raise _wrong("this is a MATLAB file of version 7.3, which is HDF5", "in MATLAB: save -v7 FILE", place)
    try:
        _measure(path, head)
        found = whosmat(str(path), appendmat=False)
    except ProblemError:
        raise
    except Exception:  # scipy raises a dozen kinds for files that are not what their name says
        raise _wrong("not a readable .mat file", "in MATLAB: save -v7 FILE", place) from None
    shapes = {name: tuple(shape) if kind in NUMBERS else None for name, shape, kind in found}
    if any(shape is not None and math.prod(shape) * 8 > PACKED for shape in shapes.values()):
        raise _wrong(f"holds an array of more than {PACKED >> 20} MB", "", place)
    return shapes


def read_mat(path: Path, name: str, place: str) -> np.ndarray:
    """One array of numbers, as MATLAB has it: at least two-dimensional.

    Parameters
    ----------
    path : the file, whose `mat_shapes` have been looked at
    name : of the array
    place : what to call the file in a message

    Raises ProblemError where it cannot be read or does not hold real numbers.
    """
    from scipy.io import loadmat

    try:
        value = loadmat(str(path), variable_names=[name], appendmat=False)[name]
    except Exception:
        raise _wrong("not a readable .mat file", "in MATLAB: save -v7 FILE", place) from None
    if hasattr(value, "toarray"):
        raise _wrong(f"the array '{name}' is sparse", f"in MATLAB: {name} = full({name})", place)
    if np.asarray(value).dtype.kind not in "fiub":
        raise _wrong(f"the array '{name}' does not hold real numbers", "", place)
    return np.array(value, dtype=float)


def _measure(path: Path, head: bytes) -> None:
    """ProblemError where the compressed parts of a file unpack to too much."""
    if head[126:128] not in (b"IM", b"MI"):
        return  # version 4, which compresses nothing
    order = "little" if head[126:128] == b"IM" else "big"
    total = 0
    with path.open("rb") as file:
        file.seek(128)
        while len(tag := file.read(8)) == 8:
            kind, size = (int.from_bytes(tag[i : i + 4], order) for i in (0, 4))
            if kind != _COMPRESSED:
                file.seek(size, 1)
                continue
            unpack, rest = zlib.decompressobj(), size
            while rest > 0 and (block := file.read(min(rest, 2**16))):
                rest -= len(block)
                while block:
                    total += len(unpack.decompress(block, 2**20))
                    block = unpack.unconsumed_tail
                    if total > PACKED:
                        raise _wrong(f"unpacks to more than {PACKED >> 20} MB", "", str(path))


def _wrong(what: str, hint: str, place: str) -> ProblemError:
    return ProblemError(Mistake((), f"{place}: {what}", hint))

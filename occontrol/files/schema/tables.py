"""Arrays in .npz and .mat files beside or below the problem file; nothing else is opened, and nothing is unpickled.

In a .mat file time is the last axis, as MATLAB has it: A(:,:,k) belongs to t(k).
"""

from __future__ import annotations

import math
import zipfile
from collections.abc import Callable
from pathlib import Path as FilePath

import numpy as np

from occontrol.core.errors import Collector, Mistake, Path, ProblemError
from occontrol.files.received_arrays import claim, load
from occontrol.files.schema.words import shown, suggest

MAX_BYTES = 512 * 2**20  # of one array, unpacked
LARGEST = 1000  # states; keeps {identity: 1000000000} from filling the memory
SMALL = 2_000_000  # entries of a table that may be read before its shape is judged
SHAPES = "times is (K,), values is (K, rows, columns)"


def shape_fits(
    wrong: Callable[..., None], path: Path, states: int | None, times: np.ndarray, shape: tuple[int, ...]
) -> bool:
    """Whether the values of a table may have this shape; False after the mistake was noted.

    Parameters
    ----------
    wrong : (path, what, hint, of=path) notes it
    path : of the table
    states : of the plant, where they are known
    times : (K,)
    shape : that the header of the values claims
    """
    if len(shape) not in (1, 3) or times.ndim != 1 or shape[0] != len(times):
        if math.prod(shape) <= SMALL:
            return True  # said by whoever builds the table
        wrong((*path, "values"), f": times has shape {times.shape}, values {shape}", SHAPES, of=path)
        return False
    rows, columns = shape[1:] if len(shape) == 3 else (1, 1)
    if path[-1] in ("C", "H") and states is not None and columns != states:
        what = f" is {rows}x{columns}, but the plant has {states} state{'s' * (states != 1)}"
        wrong(path, what, f"a row of {path[-1]} has one entry per state")
        return False
    if max(rows, columns) > LARGEST:
        what = f": the matrices are {rows}x{columns}"
        wrong((*path, "values"), what, f"at most {LARGEST} each way", of=path)
        return False
    return True


class TableFiles:
    """Loads arrays by file and name; a file that lies elsewhere, lacks the array or is no .npz is a mistake."""

    def __init__(self, folder: FilePath | None, found: Collector):
        self.folder, self.found = folder, found
        self.arrays: dict[tuple[FilePath, str], np.ndarray] = {}
        self.refused: set[str] = set()

    def load(
        self,
        file: object,
        array: object,
        path: Path,
        judge: Callable[[tuple[int, ...]], bool] = lambda shape: True,
        single: bool = False,
    ) -> np.ndarray | None:
        """The array, or None after its mistake was noted; path is that of the array's name.

        `judge` gets the shape that the header claims, before anything is unpacked; False where it has noted a mistake.
        `single` is for one matrix instead of a table of several.
        """
        place = (*path[:-1], "file")
        if not isinstance(file, str) or not file:
            self.found.add(place, f"file is {shown(file)}, it must be the name of an .npz or .mat file")
            return None
        if not isinstance(array, str):
            self.found.add(path, f"{path[-1]} is {shown(array)}, it must be the name of an array in {file}")
            return None
        if file in self.refused:
            return None
        target = self._inside(file, place)
        if target is None:
            self.refused.add(file)
            return None
        if (target, array) not in self.arrays:
            if target.suffix.lower() == ".mat":
                value = self._read_mat(target, file, array, path, place, judge, single)
            else:
                value = self._read(target, file, array, path, place, judge)
            if value is None:
                return None
            self.arrays[target, array] = value
        value = self.arrays[target, array]
        return _time_first(value) if target.suffix.lower() == ".mat" and not single else value

    def _inside(self, file: str, place: Path) -> FilePath | None:
        if self.folder is None:
            self.found.add(place, f"the table file '{file}' cannot be used here", "give the table as times and values")
            return None
        try:
            base = self.folder.resolve()
            target = (base / file).resolve()
            if not target.is_relative_to(base):
                self.found.add(
                    place,
                    f"the table file '{file}' lies outside the folder of the problem file",
                    "put it beside or below it",
                )
                return None
            if not target.is_file():
                self.found.add(place, f"there is no table file '{file}'", "it is looked for beside the problem file")
                return None
        except (OSError, ValueError, RuntimeError):
            self.found.add(place, f"'{file[:60]}' is not the name of a file")
            return None
        return target

    def _read_mat(
        self,
        target: FilePath,
        file: str,
        array: str,
        path: Path,
        place: Path,
        judge: Callable[[tuple[int, ...]], bool],
        single: bool,
    ) -> np.ndarray | None:
        from occontrol.files.mat_file import mat_shapes, read_mat

        try:
            shapes = mat_shapes(target, file)
            if array not in shapes:
                self.found.add(path, f"{file} has no array '{array}'", suggest(array, shapes) if shapes else "")
                return None
            shape = shapes[array]
            if shape is None:
                self.found.add(path, f"the array '{array}' of {file} does not hold numbers")
                return None
            # a view of one element tells which shape the table will have
            if not judge(shape if single else _time_first(np.broadcast_to(0.0, shape)).shape):
                return None
            return read_mat(target, array, file)
        except ProblemError as error:
            self.found.mistakes += [Mistake(place, m.what, m.hint) for m in error.mistakes]
            self.refused.add(file)
            return None

    def _read(
        self, target: FilePath, file: str, array: str, path: Path, place: Path, judge: Callable[[tuple[int, ...]], bool]
    ) -> np.ndarray | None:
        try:
            with zipfile.ZipFile(target) as archive:
                names = [n.removesuffix(".npy") for n in archive.namelist()]
                if array not in names:
                    self.found.add(path, f"{file} has no array '{array}'", suggest(array, names) if names else "")
                    return None
                info = archive.getinfo(f"{array}.npy")
                claimed = claim(archive, info, file)
                if not judge(claimed.shape):
                    return None
                if claimed.dtype.kind not in "fiu":
                    self.found.add(path, f"the array '{array}' of {file} does not hold numbers")
                    return None
                if info.file_size > MAX_BYTES or math.prod(claimed.shape) * 8 > MAX_BYTES:
                    self.found.add(path, f"the array '{array}' of {file} is larger than {MAX_BYTES >> 20} MB")
                    return None
                value = load(archive, info, claimed)
        except ProblemError as error:
            self.found.mistakes += [Mistake(path, m.what, m.hint) for m in error.mistakes]
            return None
        except Exception:  # zipfile and numpy raise a dozen kinds for files that are not what their name says
            self.found.add(place, f"{file} is not an .npz file of plain arrays", "write it with numpy.savez")
            self.refused.add(file)
            return None
        return value.astype(float, copy=False)


def _time_first(value: np.ndarray) -> np.ndarray:
    """(K, rows, columns) from MATLAB's (rows, columns, K), (K,) from a row or a column."""
    if value.ndim == 3:
        return np.moveaxis(value, 2, 0)
    return value.ravel() if value.ndim == 2 and 1 in value.shape else value

"""Tables in .npz files beside or below the problem file; nothing else is ever opened, and nothing is unpickled."""

from __future__ import annotations

import zipfile
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from occontrol.core.errors import Collector, Path
from occontrol.files.schema.words import shown, suggest

MAX_BYTES = 512 * 2**20  # of one array, unpacked


class TableFiles:
    """Loads arrays by file and name; a file that lies elsewhere, lacks the array or is no .npz is a mistake."""

    def __init__(self, folder: FilePath | None, found: Collector):
        self.folder, self.found = folder, found
        self.arrays: dict[tuple[FilePath, str], np.ndarray] = {}
        self.refused: set[str] = set()

    def load(self, file: Any, array: Any, path: Path) -> np.ndarray | None:
        """The array, or None after its mistake was noted; path is that of the array's name."""
        place = (*path[:-1], "file")
        if not isinstance(file, str) or not file:
            self.found.add(place, f"file is {shown(file)}, it must be the name of an .npz file")
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
            value = self._read(target, file, array, path, place)
            if value is None:
                return None
            self.arrays[target, array] = value
        return self.arrays[target, array]

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

    def _read(self, target: FilePath, file: str, array: str, path: Path, place: Path) -> np.ndarray | None:
        try:
            with zipfile.ZipFile(target) as archive:
                names = [n.removesuffix(".npy") for n in archive.namelist()]
                if array not in names:
                    self.found.add(path, f"{file} has no array '{array}'", suggest(array, names) if names else "")
                    return None
                if archive.getinfo(f"{array}.npy").file_size > MAX_BYTES:
                    self.found.add(path, f"the array '{array}' of {file} is larger than {MAX_BYTES >> 20} MB")
                    return None
            with np.load(target, allow_pickle=False) as archive:
                value = archive[array]
        except Exception:  # zipfile and numpy raise a dozen kinds for files that are not what their name says
            self.found.add(place, f"{file} is not an .npz file of plain arrays", "write it with numpy.savez")
            self.refused.add(file)
            return None
        if value.dtype.kind not in "fiu":
            self.found.add(path, f"the array '{array}' of {file} does not hold numbers")
            return None
        return value.astype(float)

"""Matrices that stand in tables: with their times in the problem file, or in a file beside it."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from occontrol.core.errors import Path, ProblemError
from occontrol.core.kinds import Plain
from occontrol.core.signal import Signal, TableSignal
from occontrol.files.schema.tables import SHAPES, shape_fits
from occontrol.files.schema.words import shown

if TYPE_CHECKING:
    from occontrol.files.schema.matrices import MatrixReader


def in_file(reader: MatrixReader, value: dict, path: Path) -> np.ndarray | None:
    """One matrix (rows, columns) in a file; None after a mistake.

    Parameters
    ----------
    reader : notes mistakes, knows the files
    value : {file, values}
    path : of the matrix
    """
    if "interpolation" in value:
        reader.wrong(path, " has no 'times'", "an interpolation goes with times")
        return None

    def fits(shape: tuple[int, ...]) -> bool:
        if len(shape) == 3:
            reader.wrong(path, " has no 'times'", "matrices that vary with time need the times of each: times: NAME")
        return len(shape) != 3 and shape_fits(reader.wrong, path, reader.states, np.zeros(1), (1, *shape))

    found = reader.load(value["file"], value["values"], (*path, "values"), fits, single=True)
    if found is not None and found.ndim != 2:
        reader.wrong((*path, "values"), f": the array has shape {found.shape}", "a matrix is (rows, columns)", of=path)
        return None
    if found is not None and not np.all(np.isfinite(found)):
        reader.wrong((*path, "values"), ": the array holds a value that is not finite", of=path)
        return None
    return None if found is None else np.array(found)


def tabulated(reader: MatrixReader, value: dict, path: Path) -> Signal | None:
    """A matrix with its times, written out or in a file; None after a mistake.

    Parameters
    ----------
    reader : notes mistakes, reads what is written out
    value : {times, values, interpolation} or {file, times, values, interpolation}
    path : of the table
    """
    if "file" in value:
        times = reader.load(value["file"], value["times"], (*path, "times"))
        values = None
        if times is not None:
            fits = partial(shape_fits, reader.wrong, path, reader.states, times)
            values = reader.load(value["file"], value["values"], (*path, "values"), fits)
    else:
        times = reader.vector(value["times"], (*path, "times"))
        values = _stack(reader, value["values"], (*path, "values"))
    if times is None or values is None:
        return None
    if values.ndim == 1:
        values = values.reshape(-1, 1, 1)
    if times.ndim != 1 or values.ndim != 3:
        shapes = f": times has shape {times.shape}, values {values.shape}"
        reader.wrong((*path, "values"), shapes, SHAPES, of=path)
        return None
    try:
        interpolation = value.get("interpolation", "linear")
        return TableSignal(times, values, interpolation if isinstance(interpolation, str) else shown(interpolation))
    except ProblemError as error:
        for m in error.mistakes:
            reader.found.add((*path, *m.path), f"{reader.name(path)}: {m.what}", m.hint)
        return None


def _stack(reader: MatrixReader, values: Plain, path: Path) -> np.ndarray | None:
    """(K, rows, columns) from a list of matrices of numbers."""
    try:
        kinds = {type(e) for matrix in values for row in matrix for e in row}
        if kinds <= {int, float}:
            return np.array(values, dtype=float)
    except (TypeError, ValueError):
        pass
    if not isinstance(values, list) or not values:
        reader.wrong(path, f" is {shown(values)}, it must be a list of matrices")
        return None
    read = [reader.constant(matrix, (*path, k)) for k, matrix in enumerate(values)]
    matrices = [matrix for matrix in read if matrix is not None]
    if len(matrices) < len(read):
        return None
    k = next((k for k, m in enumerate(matrices) if m.shape != matrices[0].shape), None)
    if k is not None:
        reader.wrong(
            (*path, k), f": matrix {k + 1} is {_size(matrices[k])}, the first is {_size(matrices[0])}", of=path
        )
        return None
    return np.array(matrices)


def _size(matrix: np.ndarray) -> str:
    return f"{matrix.shape[0]}x{matrix.shape[1]}"

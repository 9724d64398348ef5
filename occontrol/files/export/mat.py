"""One MATLAB file (version 5): structs `arrays`, `filter` and `result`, and the sensors' names as a cell array."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from occontrol.core.errors import UsageError
from occontrol.core.problem import BaseProblem
from occontrol.core.solution import Solution
from occontrol.core.versions import KEY, SCHEMA_VERSION
from occontrol.files.atomic import replacing

LONGEST = 31  # characters of a field's name that MATLAB reads
LARGEST = 2**31 - 1  # bytes of one variable in this version of the format


def write(problem: BaseProblem, solution: Solution, tables: Mapping[str, np.ndarray], target: Path) -> list[Path]:
    """Write one .mat file with SciPy.

    Parameters
    ----------
    problem : the problem
    solution : Solution
    tables : arrays of the filter, by name, of any shape
    target : the file

    Raises UsageError when an array is too large for the format.
    """
    from scipy.io import savemat

    names = getattr(getattr(problem, "sensors", None), "names", [])
    arrays = dict(solution.arrays)
    for name, value in {**arrays, **tables}.items():
        if np.asarray(value).nbytes > LARGEST:
            raise UsageError(f"the array {name} is too large for a .mat file\n  hint: --to npz")
    content = {
        KEY: SCHEMA_VERSION,
        "name": problem.name,
        "family": problem.family,
        "method": solution.method,
        "sensors": np.array(list(names), dtype=object),
        "result": _plain({key: value for key, value in solution.result.items() if key != "schedule"}),
        "arrays": {name[:LONGEST]: np.asarray(value) for name, value in arrays.items()},
        "filter": dict(tables),
    }
    target.parent.mkdir(parents=True, exist_ok=True)
    with replacing(target) as file:
        savemat(file, content, long_field_names=False, do_compression=True, oned_as="column")
    return [target]


def _plain(value: object) -> object:
    """Nested results in what MATLAB knows: structs, cells, numbers, text; None becomes an empty matrix."""
    if isinstance(value, dict):
        return {str(key)[:LONGEST]: _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        numbers = all(isinstance(entry, int | float) for entry in value)
        if numbers:
            return np.array(value, dtype=float)
        cell = np.empty(len(value), dtype=object)
        cell[:] = [_plain(entry) for entry in value]
        return cell
    if value is None:
        return np.zeros((0, 0))
    return value if isinstance(value, str | float | int | bool | np.ndarray | np.generic) else str(value)

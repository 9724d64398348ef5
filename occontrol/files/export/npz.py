"""One .npz file: the arrays of the run, the tables of the filter as filter_*, names as text."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from occontrol.core.problem import BaseProblem
from occontrol.core.solution import Solution
from occontrol.core.versions import KEY, SCHEMA_VERSION
from occontrol.files.atomic import replacing


def write(problem: BaseProblem, solution: Solution, tables: Mapping[str, np.ndarray], target: Path) -> list[Path]:
    """Write one .npz file without pickles.

    Parameters
    ----------
    problem : the problem
    solution : Solution
    tables : arrays of the filter, by name, of any shape
    target : the file
    """
    names = getattr(getattr(problem, "sensors", None), "names", [])
    content = {**solution.arrays, "sensors": np.array(list(names), dtype=np.str_)}
    content |= {f"filter_{name}": value for name, value in tables.items()}
    content[KEY] = np.array(SCHEMA_VERSION)
    target.parent.mkdir(parents=True, exist_ok=True)
    with replacing(target) as file:
        np.savez_compressed(file, **content)  # type: ignore[arg-type]
    return [target]

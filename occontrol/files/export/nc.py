"""One netCDF file for xarray and others: every array with named axes; cost, bound and status as attributes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from occontrol.core.problem import BaseProblem
from occontrol.core.solution import Solution
from occontrol.files.atomic import write_bytes
from occontrol.files.frames import to_xarray


def write(problem: BaseProblem, solution: Solution, tables: Mapping[str, np.ndarray], target: Path) -> list[Path]:
    """Write one netCDF file; needs `pip install 'occontrol[xarray]'`.

    Parameters
    ----------
    problem : the problem
    solution : Solution
    tables : arrays of the filter, by name, of any shape; they go in as filter_*
    target : the file
    """
    content = to_xarray(solution)
    for name, value in tables.items():
        value = np.asarray(value)
        axes = [f"filter_{name}_{place + 1}" for place in range(value.ndim)]
        content[f"filter_{name}"] = (axes, value)
    target.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory() as folder:  # before 2025.5 xarray closes a buffer that it wrote to
        path = Path(folder) / "run.nc"
        content.to_netcdf(path, engine="h5netcdf")
        return [write_bytes(target, path.read_bytes())]

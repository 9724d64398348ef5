"""Schedules and estimates as pandas frames, whole solutions as xarray data sets; both libraries are optional."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from occontrol.core.calendar import calendar_of
from occontrol.core.errors import UsageError
from occontrol.core.measurement import Estimate
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Solution
from occontrol.core.state_labels import state_names
from occontrol.core.versions import KEY, SCHEMA_VERSION

if TYPE_CHECKING:
    import pandas as pd  # type: ignore[import-not-found]
    import xarray as xr  # type: ignore[import-not-found]

NODE, INTERVAL = "node", "interval"


def to_frame(given: Schedule | Estimate, problem: object = None) -> pd.DataFrame:
    """A schedule as start, end, sensors; an estimate as t, states and their deviations, predictions, nis.

    Parameters
    ----------
    given : Schedule or Estimate
    problem : whose states are named; x1, x2, .. without it

    Raises UsageError where pandas is not installed, or `given` is neither.
    """
    try:
        import pandas as pd  # type: ignore[import-not-found]
    except ImportError:
        raise UsageError("pandas is not installed\n  hint: pip install 'occontrol[pandas]'") from None
    if isinstance(given, Schedule):
        return pd.DataFrame(given.segments(), columns=["start", "end", "sensors"])
    if not isinstance(given, Estimate):
        raise UsageError(f"{type(given).__name__} is neither a schedule nor an estimate")
    names = state_names(problem if problem is not None else given.mean.shape[1])
    columns = {"t": given.times, **dict(zip(names, given.mean.T, strict=True))}
    columns |= {f"sd_{name}": column for name, column in zip(names, given.standard_deviation.T, strict=True)}
    columns |= {f"w{i + 1}": column for i, column in enumerate(given.predicted.T)}
    columns |= {f"sd_w{i + 1}": column for i, column in enumerate(given.predicted_deviation.T)}
    return pd.DataFrame({**columns, "nis": given.nis})


def to_xarray(solution: Solution) -> xr.Dataset:
    """Every array of a solution with named axes, and cost, bound and status as attributes.

    Parameters
    ----------
    solution : Solution, of any family

    Raises UsageError where xarray is not installed.
    """
    try:
        import xarray as xr  # type: ignore[import-not-found]
    except ImportError:
        raise UsageError("xarray is not installed\n  hint: pip install 'occontrol[xarray]'") from None
    arrays, problem = dict(solution.arrays), solution.problem
    edges = arrays.get("edges")
    count = -1 if edges is None else len(edges)
    sensors = list(getattr(getattr(problem, "sensors", None), "names", ()))
    names = state_names(problem)
    variables = {}
    for name, value in arrays.items():
        value, axes = np.asarray(value), []
        for place, size in enumerate(value.shape):
            axis = f"{name}_{place + 1}"
            if place == 0 and size in (count, count - 1):
                axis = NODE if size == count else INTERVAL
            elif place and name in ("weights", "switching", "relaxed_weights", "measuring") and size == len(sensors):
                axis = "sensor"
            elif place and "covariance" in name and size == len(names):
                axis = "state" if place == 1 else "state_2"
            axes.append(axis)
        variables[name] = (axes, value)
    used = {axis for axes, _ in variables.values() for axis in axes}
    labels = {"sensor": sensors, "state": names, "state_2": names}
    certificate = solution.certificate.as_dict() if solution.certificate is not None else {}
    calendar = calendar_of(problem)
    dates = {} if calendar is None else calendar.document()
    said = {"family": solution.family, "method": solution.method, "status": str(solution.status), **certificate}
    said |= {KEY: SCHEMA_VERSION, "name": str(getattr(problem, "name", "")), **dates}
    return xr.Dataset(variables, {axis: words for axis, words in labels.items() if axis in used}, said)

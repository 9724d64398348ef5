"""Measurements onto the intervals that they end: the one place that says which sample belongs where, and which do not.

A sample belongs to the interval at whose end it arrives. Everything that does not fit the plan of sensors is refused
together, each by its line and its sensor.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from occontrol.core.errors import Mistake, ProblemError
from occontrol.core.measurement import Measurement

TIME_SLACK = 0.01  # of an interval's length: times may be rounded, but not ambiguous
MOST_MISTAKES = 20


def arrange(
    edges: np.ndarray,
    names: Sequence[str],
    rows: Sequence[int],
    in_use: Sequence[Collection[int]],
    measurements: Sequence[Measurement],
) -> list[dict[str, np.ndarray]]:
    """{sensor: values} of every interval; an empty one where nothing arrived.

    Parameters
    ----------
    edges : (N+1,) increasing times
    names : the M sensor names
    rows : (M,) how many values one sample of each sensor has
    in_use : N collections of positions in `names`: the sensors whose samples may end each interval
    measurements : in any order; a NaN among the values is a missing one and is kept

    Raises ProblemError: outside the horizon, not at the end of an interval, a sensor that is unknown or not in use
    then, twice the same, a wrong number of values, infinite values.
    """
    samples: list[dict[str, np.ndarray]] = [{} for _ in range(len(edges) - 1)]
    found: list[Mistake] = []
    for measurement in measurements:
        place = f"line {measurement.line}" if measurement.line else ""
        try:
            k = _interval(edges, names, measurement)
            _check(edges, names, rows, in_use[k], k, measurement, samples[k])
        except ProblemError as error:
            found += [Mistake((), m.what, m.hint, place=place) for m in error.mistakes]
            if len(found) >= MOST_MISTAKES:
                break
            continue
        samples[k][measurement.sensor] = np.asarray(measurement.values, dtype=float)
    if found:
        raise ProblemError(found)
    return samples


def _interval(edges: np.ndarray, names: Sequence[str], measurement: Measurement) -> int:
    """The interval that the sample ends."""
    t, name, last = float(measurement.time), measurement.sensor, len(edges) - 2
    if not np.isfinite(t):
        raise ProblemError(f"the sample of sensor '{name}' has no finite time")
    if name not in names:
        raise ProblemError(f"there is no sensor '{name}'", "sensors: " + ", ".join(names))
    k = int(np.clip(np.searchsorted(edges[1:], t), 0, last))
    nearest = k - 1 if k and abs(edges[k] - t) < abs(edges[k + 1] - t) else k
    slack = TIME_SLACK * float(edges[nearest + 1] - edges[nearest])
    if abs(edges[nearest + 1] - t) <= slack:
        return nearest
    if not edges[0] < t <= edges[-1] + slack:
        raise ProblemError(
            f"the sample of sensor '{name}' at t = {t:.9g} lies outside the horizon [{edges[0]:g}, {edges[-1]:g}]",
            "t is the end of the interval that the sample averages",
        )
    raise ProblemError(
        f"the sample of sensor '{name}' at t = {t:.9g} is not at the end of an interval",
        f"the nearest ends are {edges[k]:.9g} and {edges[k + 1]:.9g}",
    )


def _check(
    edges: np.ndarray,
    names: Sequence[str],
    rows: Sequence[int],
    in_use: Collection[int],
    k: int,
    measurement: Measurement,
    already: Mapping[str, np.ndarray],
) -> None:
    """Whether the sample may end interval k, beside what arrived there already."""
    name, values = measurement.sensor, np.asarray(measurement.values, dtype=float)
    j = list(names).index(name)
    if j not in in_use:
        used = ", ".join(names[i] for i in in_use) or "no sensor"
        raise ProblemError(f"sensor '{name}' is not in use over [{edges[k]:g}, {edges[k + 1]:g}]", f"in use: {used}")
    if name in already:
        raise ProblemError(f"sensor '{name}' has a second sample at t = {measurement.time:.9g}")
    if values.shape != (rows[j],):
        raise ProblemError(
            f"the sample of sensor '{name}' has {values.size} values, its C has {rows[j]} rows",
            "leave the line of a missing sample out, or its missing value empty",
        )
    if np.any(np.isinf(values)):
        raise ProblemError(f"the sample of sensor '{name}' is infinite")

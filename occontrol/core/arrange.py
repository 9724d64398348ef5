"""Measurements onto the times that they belong to: the one place that says which sample goes where, and which do not.

On intervals a sample belongs to the interval at whose end it arrives; at instants (the steps k of discrete time, for
example) it belongs to the instant itself. Everything that does not fit is refused together, each by its line and its
sensor, and the same mistake on many lines is named once, with their number.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from occontrol.core.errors import Mistake, ProblemError, one_per_cause, plural, suggest
from occontrol.core.measurement import Measurement

TIME_SLACK = 0.01  # of an interval's length: times may be rounded, but not ambiguous
STEP_SLACK = 1e-9  # of a step: whole numbers are written as they are
MOST_NAMES = 8


def arrange(
    edges: np.ndarray,
    names: Sequence[str],
    rows: Sequence[int],
    in_use: Sequence[Collection[int]] | None,
    measurements: Sequence[Measurement],
    *,
    slack: float = TIME_SLACK,
    instants: bool = False,
) -> list[dict[str, np.ndarray]]:
    """{sensor: values} of every interval, or of every instant; an empty one where nothing arrived.

    Parameters
    ----------
    edges : (N+1,) increasing times, of which a sample over interval k has the time edges[k+1]; with `instants` the
        (N,) times of the samples themselves
    names : the M sensor names
    rows : (M,) how many values one sample of each sensor has
    in_use : N collections of positions in `names`: the sensors whose samples may be there; None where any may
    measurements : in any order, which is kept among those of the same time; a NaN among the values is a missing one and
        is kept too
    slack : how far a time may lie from where it belongs, as a share of the time between edges (of the shorter gap
        beside an instant)
    instants : whether `edges` are instants

    Raises ProblemError: outside the horizon, not at the end of an interval (not at a step), a sensor that is unknown or
    not in use then, twice the same, a wrong number of values, infinite values.
    """
    times = np.asarray(edges, dtype=float)
    ends, lengths = (times, _gaps(times)) if instants else (times[1:], np.diff(times))
    place_of = {name: j for j, name in enumerate(names)}
    samples: list[dict[str, np.ndarray]] = [{} for _ in ends]
    found: list[Mistake] = []
    for measurement in measurements:
        name, values = measurement.sensor, np.atleast_1d(np.asarray(measurement.values, dtype=float))
        mistake, k = None, -1
        if name not in place_of:
            mistake = Mistake((), f"there is no sensor '{name}'", suggest(name, names))
        elif not np.isfinite(measurement.time):
            mistake = Mistake((), f"the sample of sensor '{name}' has no finite time", cause="finite time")
        else:
            t = float(measurement.time)
            k = int(np.clip(np.searchsorted(ends, t), 0, len(ends) - 1))
            if k and abs(ends[k - 1] - t) < abs(ends[k] - t):
                k -= 1
            if abs(ends[k] - t) > slack * lengths[k] + 4 * np.spacing(abs(t)):
                mistake = _misplaced(times, slack * lengths[-1], instants, name, t)
            else:
                j = place_of[name]
                allowed = None if in_use is None else in_use[k]
                when = f"at t = {times[k]:.9g}" if instants else f"over [{times[k]:.9g}, {times[k + 1]:.9g}]"
                mistake = _unfit(names, rows[j], j, allowed, when, measurement, values, samples[k])
        if mistake is None:
            samples[k][name] = values
        else:
            place = f"line {measurement.line}" if measurement.line else ""
            found.append(Mistake((), mistake.what, mistake.hint, place=place, cause=mistake.cause))
    if found:
        raise ProblemError(one_per_cause(found))
    return samples


def step_times(first: int, last: int) -> np.ndarray:
    """The instants first, first + 1, .., last of discrete time, as `arrange` wants them."""
    return np.arange(first, last + 1, dtype=float)


def _gaps(times: np.ndarray) -> np.ndarray:
    """(N,) the shorter of the two gaps beside every instant; 1 for a single one."""
    if len(times) < 2:
        return np.ones(len(times))
    gaps = np.diff(times)
    return np.minimum(np.append(gaps, np.inf), np.append(np.inf, gaps))


def _misplaced(times: np.ndarray, slack: float, instants: bool, name: str, t: float) -> Mistake:
    """What is wrong with a time that belongs nowhere."""
    head = f"the sample of sensor '{name}' at t = {t:.9g}"
    before_all = t < times[0] - slack if instants else t <= times[0]
    if before_all or t > times[-1] + slack:
        middle = f"{times[1]:.9g}, .. " if len(times) > 2 else ""
        hint = f"t is {times[0]:.9g}, {middle}{times[-1]:.9g}" if instants else (
            "t is the end of the interval that the sample averages"
        )  # fmt: skip
        return Mistake((), f"{head} lies outside the horizon [{times[0]:g}, {times[-1]:g}]", hint, cause="outside")
    k = int(np.clip(np.searchsorted(times, t), 1, len(times) - 1))
    nearest = f"{times[k - 1]:.9g} and {times[k]:.9g}"
    if instants:
        return Mistake((), f"{head} is not at a step", f"the nearest steps are {nearest}", cause="between steps")
    return Mistake(
        (), f"{head} is not at the end of an interval", f"the nearest ends are {nearest}", cause="inside an interval"
    )


def _unfit(
    names: Sequence[str],
    rows: int,
    j: int,
    allowed: Collection[int] | None,
    when: str,
    measurement: Measurement,
    values: np.ndarray,
    already: Mapping[str, np.ndarray],
) -> Mistake | None:
    """What is wrong with a sample that has found its time, beside what arrived there already; None if nothing."""
    name = measurement.sensor
    if allowed is not None and j not in allowed:
        listed = [names[i] for i in list(allowed)[:MOST_NAMES]] or ["no sensor"]
        more = f" and {len(allowed) - MOST_NAMES} more" if len(allowed) > MOST_NAMES else ""
        hint = f"in use: {', '.join(listed)}{more}"
        return Mistake((), f"sensor '{name}' is not in use {when}", hint, cause=f"use {name}")
    if name in already:
        return Mistake((), f"sensor '{name}' has a second sample at t = {measurement.time:.9g}", cause=f"twice {name}")
    if values.shape != (rows,):
        what = f"the sample of sensor '{name}' has {plural(values.size, 'value')}, it must have {rows}"
        hint = "leave the line of a missing sample out, or its missing value empty"
        return Mistake((), what, hint, cause=f"size {name}")
    if np.any(np.isinf(values)):
        return Mistake((), f"the sample of sensor '{name}' is infinite", cause=f"infinite {name}")
    return None

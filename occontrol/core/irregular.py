"""Measurements at nearly the times of the schedule: each is moved to the nearest one, within a stated tolerance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from occontrol.core.errors import Mistake, ProblemError, UsageError, one_per_cause, plural
from occontrol.core.measurement import Measurement


def expected_times(problem: object) -> np.ndarray:
    """(N,) the times that samples of a problem may have: its instants, or the ends of its intervals.

    Parameters
    ----------
    problem : with a clock of readings, or edges

    Raises UsageError for a problem without times.
    """
    clock = getattr(problem, "clock", None)
    times = getattr(clock, "times", None) if clock is not None else getattr(problem, "edges", np.empty(0))[1:]
    if times is None or not len(times):
        raise UsageError("samples of this family belong to whole steps: a tolerance of their times means nothing")
    return np.asarray(times, dtype=float)


def moved(measurements: Sequence[Measurement], times: np.ndarray, tolerance: float) -> tuple[list[Measurement], str]:
    """The measurements at the nearest of `times`, and a sentence on how far they were moved.

    Parameters
    ----------
    measurements : in any order
    times : (N,) increasing, in the unit of time
    tolerance : how far a sample may be moved, in the unit of time

    Raises UsageError for a tolerance that is not above 0, ProblemError naming the line of every sample that is farther
    from all of them, and of two samples of a sensor that would come to the same.
    """
    if not (np.isfinite(tolerance) and tolerance > 0):
        raise UsageError(f"the tolerance is {tolerance:g}\n  hint: a time above 0, in the unit of the problem")
    found: list[Mistake] = []
    result, shifts, seen = [], [], {}
    for m in measurements:
        k = int(np.clip(np.searchsorted(times, m.time), 1, max(len(times) - 1, 1)))
        k -= int(len(times) < 2 or m.time - times[k - 1] <= times[k] - m.time)
        shift = float(times[k]) - m.time
        place = f"line {m.line}" if m.line else ""
        if not abs(shift) <= tolerance:
            what = f"the sample of sensor '{m.sensor}' at t = {m.time:.9g} is {abs(shift):.3g} from the nearest time"
            found.append(Mistake((), what, f"the tolerance is {tolerance:g}", place=place, cause="far"))
        elif (k, m.sensor) in seen:
            what = f"two samples of sensor '{m.sensor}' belong to t = {times[k]:.9g}"
            hint = f"the other is at t = {seen[k, m.sensor]:.9g}"
            found.append(Mistake((), what, hint, place=place, cause="two"))
        else:
            seen[k, m.sensor] = m.time
            result.append(replace(m, time=float(times[k])))
            shifts += [abs(shift)] if shift else []
    if found:
        raise ProblemError(one_per_cause(found))
    farthest = max(shifts, default=0.0)
    said = f"{plural(len(shifts), 'sample')} moved to the times of the schedule, by at most {farthest:.3g}"
    return result, said if shifts else ""

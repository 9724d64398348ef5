"""When readings are taken: at the steps k of discrete time, or at the sample times of a continuous plant."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from occontrol.core.clock import elapsed, tolerance
from occontrol.core.errors import Collector
from occontrol.core.kinds import VectorField

MOST_READINGS = 1_000_000


@dataclass(frozen=True, eq=False)
class Steps:
    """Discrete time k = 0 .. steps-1: measure at k, then x(k+1) = F(k) x(k) + G(k) w(k).

    Parameters
    ----------
    steps : N, whole number
    epoch : a choice is kept for that many steps

    Raises ProblemError for numbers that are not whole and above 0.
    """

    steps: int
    epoch: int = 1
    variable: str = field(default="k", init=False)

    def __post_init__(self) -> None:
        found = Collector()
        for key, most in (("steps", MOST_READINGS), ("epoch", MOST_READINGS)):
            value = getattr(self, key)
            if isinstance(value, bool) or not 1 <= value <= most or int(value) != value:
                found.add((key,), f"horizon.{key} is {value:g}", f"a whole number from 1 to {most}")
            else:
                object.__setattr__(self, key, int(value))
        found.raise_if_any()

    @property
    def start(self) -> float:
        """0"""
        return 0.0

    @property
    def end(self) -> float:
        """N: the step after the last reading."""
        return float(self.steps)

    @cached_property
    def times(self) -> np.ndarray:
        """(N,) the steps."""
        return np.arange(self.steps, dtype=float)

    @cached_property
    def owner(self) -> np.ndarray:
        """(N,) the decision that each reading belongs to."""
        return np.arange(self.steps) // self.epoch

    @cached_property
    def nodes(self) -> np.ndarray:
        """(N+1,) the steps and N."""
        return np.arange(self.steps + 1, dtype=float)


@dataclass(frozen=True, eq=False)
class SampleTimes:
    """Times at which a continuous plant is read.

    Parameters
    ----------
    times : (N,) increasing, inside [start, end]
    start : t0, where the initial covariance holds
    end : T >= the last reading

    Raises ProblemError for times that do not increase or lie outside.
    """

    times: VectorField
    start: float
    end: float
    variable: str = field(default="t", init=False)

    def __post_init__(self) -> None:
        found = Collector()
        times = np.atleast_1d(np.asarray(self.times, dtype=float)).ravel()
        object.__setattr__(self, "times", times)
        hint = f"sample times increase inside [{self.start:g}, {self.end:g}], both ends allowed"
        if not 1 <= len(times) <= MOST_READINGS:
            found.add(("sample_times",), f"there are {len(times)} sample times", f"1 to {MOST_READINGS}")
        elif not (np.all(np.isfinite(times)) and np.isfinite(self.start) and np.isfinite(self.end)):
            found.add(("sample_times",), "a time of the horizon is not finite")
        elif self.end < self.start:
            found.add(("end",), f"the horizon ends at {self.end:g}, before its start {self.start:g}")
        else:
            if np.any(np.diff(times) <= 0):
                k = int(np.argmax(np.diff(times) <= 0)) + 1
                what = f"sample times must increase: {times[k]:g} comes after {times[k - 1]:g}"
                found.add(("sample_times", k), what, hint)
            slack = tolerance(self.end - self.start, self.start, self.end)
            outside = (times < self.start - slack) | (times > self.end + slack)
            if np.any(outside):
                k = int(np.argmax(outside))
                found.add(("sample_times", k), f"the sample time {times[k]:g} lies outside the horizon", hint)
            object.__setattr__(self, "times", np.clip(times, self.start, self.end))
        found.raise_if_any()

    @property
    def epoch(self) -> int:
        """1: every reading is a choice of its own."""
        return 1

    @cached_property
    def owner(self) -> np.ndarray:
        """(N,) 0 .. N-1"""
        return np.arange(len(self.times))

    @cached_property
    def nodes(self) -> np.ndarray:
        """(N+1,) the sample times and the end of the picture: T, or as much later than the last as a gap is long."""
        last = self.end
        if last <= self.times[-1]:
            gap = float(self.times[-1] - self.times[-2]) if len(self.times) > 1 else 1.0
            last = self.times[-1] + gap
        return np.append(self.times, last)

    @cached_property
    def since(self) -> np.ndarray:
        """(N+2,) start, sample times and end, counted from the start so that they keep their digits."""
        distinct, where = np.unique(np.concatenate([[self.start], self.times, [self.end]]), return_inverse=True)
        return elapsed(distinct)[where] if len(distinct) > 1 else np.zeros(len(where))


def evenly(start: float, end: float, samples: int) -> np.ndarray:
    """(samples,) start + i (end - start)/samples, i = 0 .. samples-1."""
    return start + (end - start) * np.arange(samples) / samples

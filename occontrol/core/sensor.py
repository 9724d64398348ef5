"""Sensors and suites of sensors."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol, SupportsIndex, TypeVar, overload

import numpy as np

from occontrol.core.clock import resolution, tolerance
from occontrol.core.errors import Collector, Mistake, ProblemError
from occontrol.core.kinds import SignalField, unless_given
from occontrol.core.signal import ConstantSignal, Signal, as_signal

IDLE = "idle"


def check_name(name: object, found: Collector) -> None:
    """A sensor's name stands in CSV files and messages: printable, without ';' and ','."""
    if not isinstance(name, str) or not name.strip() or name != name.strip():
        found.add(("name",), f"the name of a sensor is {name!r}", "a word or words, without blanks at the ends")
    elif len(name) > 100 or not name.isprintable():
        found.add(("name",), f"the sensor name {name[:40]!r} is not usable", "up to 100 printable characters")
    elif set(name) & set(';,"'):
        hint = "names stand in the columns of CSV files: use letters, digits, blanks, - and _"
        found.add(("name",), f'the sensor name {name} holds one of ; , "', hint)


@dataclass(frozen=True, eq=False)
class Sensor:
    """One sensor (or a group that reports together).

    z = C(t) x + theta,   cov theta = Theta(t) delta,   cost rate q(t) >= 0

    Parameters
    ----------
    name : str, unique within a suite
    C : (m, n) [measurement unit]/[state unit]; number, rows, array, formulas of t, or a Signal
    noise : (m, m) intensity Theta, [measurement unit]^2 * time, symmetric positive definite
    cost : cost rate q, cost/time, a number or a formula of t
    windows : list of times (start, end) inside which the sensor may be used; None is always
    variable : what formulas call time: "t", or "k" for the steps of discrete time

    Where a problem takes single readings instead of continuous sensing, `noise` is the covariance of one reading,
    [measurement unit]^2, and `cost` the price of one.
    Athans (1971), equations (2.9)-(2.15).
    """

    name: str
    C: SignalField
    noise: SignalField
    cost: SignalField = unless_given(0.0)
    windows: Sequence[tuple[float, float]] | None = None
    variable: str = "t"

    def __post_init__(self) -> None:
        found = Collector()
        check_name(self.name, found)
        for name in ("C", "noise", "cost"):
            with found.under(name):
                object.__setattr__(self, name, as_signal(getattr(self, name), self.variable))
        found.raise_if_any()
        mistakes = []
        m = self.C.shape[0]
        if self.noise.shape != (m, m):
            rows, columns = self.noise.shape
            what = f"noise of sensor '{self.name}' is {rows}x{columns}, its C has {m} row{'s' * (m != 1)}"
            mistakes.append(Mistake(("noise",), what, f"it must be {m}x{m}"))
        if self.cost.shape != (1, 1):
            mistakes.append(Mistake(("cost",), f"cost of sensor '{self.name}' is not a single number or formula"))
        if self.name == IDLE and m > 0:
            what = "the name 'idle' is kept for the sensor that measures nothing"
            mistakes.append(Mistake(("name",), what, "rename the sensor, or write idle alone in the list of sensors"))
        if self.windows is not None:
            windows = []
            if not self.windows:
                mistakes.append(
                    Mistake(("windows",), f"sensor '{self.name}' has no window", "leave windows out for always")
                )
            for i, window in enumerate(self.windows):
                if (
                    len(window) != 2
                    or not np.all(np.isfinite(np.asarray(window, dtype=float)))
                    or not (window[0] < window[1] or (self.variable == "k" and window[0] == window[1]))
                ):
                    what = f"window {i + 1} of sensor '{self.name}' is {list(window)}"
                    mistakes.append(Mistake(("windows", i), what, "a window is [start, end] with start < end"))
                else:
                    windows.append((float(window[0]), float(window[1])))
            object.__setattr__(self, "windows", tuple(sorted(windows)))
        if mistakes:
            raise ProblemError(mistakes)

    @property
    def rows(self) -> int:
        """The number m of values that one measurement has."""
        return self.C.shape[0]

    @property
    def is_idle(self) -> bool:
        """Whether this is the sensor that measures nothing."""
        return self.rows == 0

    @property
    def signals(self) -> dict[str, Signal]:
        """The time functions of the sensor, by name."""
        return {"C": self.C, "noise": self.noise, "cost": self.cost}

    def available(self, start: float, end: float) -> bool:
        """Whether all times of [start, end] lie inside the windows (those that touch count as one)."""
        if self.windows is None:
            return True
        slack = tolerance(end - start, start, end)
        for a, b in self.windows:  # in order of time
            if a > start + slack:
                return False
            start = max(start, b)
            if end <= start + slack:
                return True
        return False

    def available_between(self, edges: np.ndarray) -> np.ndarray:
        """(N,) the answers of `available` for the intervals between edges.

        Parameters
        ----------
        edges : (N+1,) increasing times
        """
        starts, ends = edges[:-1], edges[1:]
        if self.windows is None:
            return np.ones(len(starts), dtype=bool)
        inside = np.zeros(len(starts), dtype=bool)
        # an interval that no window meets is out, unless it is as short as what its times may lose
        unclear = ends - starts <= 16 * resolution(edges)
        for a, b in self.windows:
            inside |= (a <= starts) & (ends <= b)
            unclear |= (a < ends) & (starts < b)
        for k in np.flatnonzero(unclear & ~inside):
            inside[k] = self.available(float(starts[k]), float(ends[k]))
        return inside

    def readable(self, time: float) -> bool:
        """Whether a reading at `time`, in the unit of time, lies inside a window, both ends included."""
        if self.windows is None:
            return True
        return any(a - tolerance(b - a, a, time) <= time <= b + tolerance(b - a, b, time) for a, b in self.windows)


def idle_sensor(states: int) -> Sensor:
    """The sensor that measures nothing and costs nothing (L = 0, q = 0), for a plant with that many `states`."""
    return Sensor(IDLE, ConstantSignal(np.zeros((0, states))), ConstantSignal(np.zeros((0, 0))))


class Named(Protocol):
    """What has a name of the user's."""

    @property
    def name(self) -> str:
        """What the user calls it."""
        ...


SensorKind = TypeVar("SensorKind", bound=Named)


@dataclass(frozen=True, eq=False)
class SensorSuite(Sequence[SensorKind]):
    """The sensors that one problem chooses among, in the user's order."""

    sensors: tuple[SensorKind, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "sensors", tuple(self.sensors))
        mistakes = []
        if not self.sensors:
            mistakes.append(Mistake((), "there is no sensor", "give at least one"))
        seen: dict[str, int] = {}
        for j, sensor in enumerate(self.sensors):
            if sensor.name in seen:
                mistakes.append(
                    Mistake((j, "name"), f"the name '{sensor.name}' is used twice", "sensor names must differ")
                )
            seen[sensor.name] = j
        if mistakes:
            raise ProblemError(mistakes)

    def __len__(self) -> int:
        return len(self.sensors)

    @overload
    def __getitem__(self, index: SupportsIndex) -> SensorKind: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[SensorKind]: ...
    def __getitem__(self, index: SupportsIndex | slice) -> SensorKind | Sequence[SensorKind]:
        return self.sensors[index]

    def __iter__(self) -> Iterator[SensorKind]:
        return iter(self.sensors)

    @property
    def names(self) -> list[str]:
        """The users' names, in order."""
        return [s.name for s in self.sensors]

    def index(self, name: str) -> int:  # type: ignore[override]
        """The position of a sensor by its name; KeyError if there is none."""
        for j, sensor in enumerate(self.sensors):
            if sensor.name == name:
                return j
        raise KeyError(name)

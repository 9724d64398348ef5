"""The nominal path of a nonlinear plant at any time, and functions of the state as functions of time along it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from occontrol.core.kinds import CasadiFunction, Plain
from occontrol.core.signal import ConstantSignal, Signal


class Path(Protocol):
    """A state for every time."""

    def at(self, times: np.ndarray) -> np.ndarray:
        """(K, n) states at `times` (K,), in the unit of time."""
        ...


@dataclass(frozen=True, eq=False)
class SmoothPath:
    """Hermite's cubic between nodes, whose slopes are those of the plant: as accurate as the Runge-Kutta steps.

    Parameters
    ----------
    times : (K,) increasing, in the unit of time
    states : (K, n), in state units
    slopes : (K, n) dx/dt there
    """

    times: np.ndarray
    states: np.ndarray
    slopes: np.ndarray

    def at(self, times: np.ndarray) -> np.ndarray:
        """(K, n) states at `times` (K,), in the unit of time; outside, those of the nearest end."""
        if len(self.times) == 1:
            return np.repeat(self.states, len(times), axis=0)
        t = np.clip(np.asarray(times, dtype=float), self.times[0], self.times[-1])
        i = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, len(self.times) - 2)
        h = self.times[i + 1] - self.times[i]
        u = ((t - self.times[i]) / h)[:, None]
        left, right, h = self.states[i], self.states[i + 1], h[:, None]
        cubic = u * u * (3 - 2 * u)
        inner = h * u * (1 - u) * ((1 - u) * self.slopes[i] - u * self.slopes[i + 1])
        return left + cubic * (right - left) + inner


@dataclass(frozen=True, eq=False)
class StatedPath:
    """A path that the problem file gives.

    Parameters
    ----------
    column : (n, 1) Signal
    """

    column: Signal

    def at(self, times: np.ndarray) -> np.ndarray:
        """(K, n) states at `times` (K,), in the unit of time."""
        return np.array(self.column.sample(np.asarray(times, dtype=float))[:, :, 0])


@dataclass(frozen=True, eq=False)
class SteppedPath:
    """A state for every step k = 0 .. N of discrete time.

    Parameters
    ----------
    states : (N+1, n), in state units
    """

    states: np.ndarray

    def at(self, times: np.ndarray) -> np.ndarray:
        """(K, n) states at the steps `times` (K,)."""
        k = np.rint(np.asarray(times, dtype=float)).astype(int)
        return self.states[np.clip(k, 0, len(self.states) - 1)]


@dataclass(frozen=True, eq=False)
class PathSignal(Signal):
    """A matrix that depends on state and time, along a path.

    Parameters
    ----------
    function : CasADi function (x, t) -> (rows, columns)
    path : Path
    """

    function: CasadiFunction
    path: Path

    @property
    def shape(self) -> tuple[int, int]:  # type: ignore[override]
        return self.function.size_out(0)

    def sample(self, times: np.ndarray) -> np.ndarray:
        """The matrices (K, rows, columns) at `times` (K,), in the unit of time."""
        times = np.asarray(times, dtype=float)
        return evaluate(self.function, self.path.at(times), times)

    def document(self) -> Plain:
        raise NotImplementedError("a problem file holds the formulas, not what they are along a path")


def evaluate(function: CasadiFunction, states: np.ndarray, times: np.ndarray) -> np.ndarray:
    """(K, rows, columns) values of a CasADi function of state and time at K states.

    Parameters
    ----------
    function : (x, t) -> (rows, columns)
    states : (K, n), in state units
    times : (K,), in the unit of time
    """
    rows, columns = function.size_out(0)
    if len(times) == 0 or rows * columns == 0:
        return np.zeros((len(times), rows, columns))
    found = np.array(function(np.asarray(states).T, np.asarray(times, dtype=float)[None]))
    return np.ascontiguousarray(np.swapaxes(found.T.reshape(len(times), columns, rows), 1, 2))


def along(function: CasadiFunction, path: Path, states: int) -> Signal:
    """A function of state and time as a Signal along a path: a constant one where it depends on neither.

    Parameters
    ----------
    function : (x, t) -> (rows, columns)
    path : Path
    states : n
    """
    import casadi

    x, t = casadi.SX.sym("x", states), casadi.SX.sym("t")
    if casadi.depends_on(function(x, t), casadi.vertcat(x, t)):
        return PathSignal(function, path)
    return ConstantSignal(evaluate(function, np.zeros((1, states)), np.zeros(1))[0])


def runs_above_zero(values: np.ndarray) -> list[tuple[int, int]]:
    """First and last index of every run of positive `values` (K,)."""
    above = np.concatenate([[False], np.asarray(values) > 0, [False]])
    starts, ends = np.flatnonzero(~above[:-1] & above[1:]), np.flatnonzero(above[:-1] & ~above[1:]) - 1
    return list(zip(starts.tolist(), ends.tolist(), strict=True))


def times_above_zero(
    function: CasadiFunction, path: Path, times: np.ndarray, resolution: float
) -> list[tuple[float, float]]:
    """The stretches of time in which a function is above 0 along a path, its ends bisected.

    Parameters
    ----------
    function : (x, t) -> number
    path : Path
    times : (K,) increasing: what happens between two of them and is over again is not seen
    resolution : of the ends, in the unit of time
    """

    def value(at: np.ndarray) -> np.ndarray:
        return evaluate(function, path.at(at), at)[:, 0, 0]

    def end(inside: float, outside: float) -> float:
        while abs(outside - inside) > max(resolution, 4 * np.spacing(max(abs(inside), abs(outside)))):
            middle = (inside + outside) / 2
            inside, outside = (middle, outside) if value(np.array([middle]))[0] > 0 else (inside, middle)
        return inside

    found = []
    for first, last in runs_above_zero(value(times)):
        start = times[0] if first == 0 else end(times[first], times[first - 1])
        stop = times[-1] if last == len(times) - 1 else end(times[last], times[last + 1])
        found.append((float(start), float(stop)))
    return found


def common(first: Sequence[Sequence[float]], second: Sequence[Sequence[float]]) -> list[tuple[float, float]]:
    """The stretches of time that lie in both lists of [start, end]."""
    found = [(max(a, c), min(b, d)) for a, b in first for c, d in second if max(a, c) <= min(b, d)]
    return sorted(found)

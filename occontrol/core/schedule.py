"""Schedules: a control lives on intervals; schedules of one grid on another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from occontrol.core.clock import nearest_edge
from occontrol.core.errors import ProblemError, suggest
from occontrol.core.sensor import IDLE

INTEGER = 1e-6


@dataclass(frozen=True, eq=False)
class Schedule:
    """Which sensor is used when.

    Parameters
    ----------
    edges : (K+1,) increasing times; interval k is [edges[k], edges[k+1])
    weights : (K, M) v_j on each interval, 0 <= v_j <= 1, summing to the number of sensors used at a time
    names : the M sensor names

    Fractional weights belong to the relaxed problem: a sensor used that share of the time by fast switching.
    """

    edges: np.ndarray
    weights: np.ndarray
    names: tuple[str, ...]

    def __post_init__(self) -> None:
        edges = np.asarray(self.edges, dtype=float)
        weights = np.asarray(self.weights, dtype=float)
        if weights.shape != (len(edges) - 1, len(self.names)):
            raise ValueError(f"weights are {weights.shape}, expected {(len(edges) - 1, len(self.names))}")
        if not (np.all(np.isfinite(edges)) and np.all(np.diff(edges) > 0)):
            raise ValueError("the edges of the schedule are not increasing numbers")
        if not (np.all(np.isfinite(weights)) and np.all(weights >= -INTEGER)):
            raise ValueError("the weights of the schedule are not all numbers from 0 upwards")
        object.__setattr__(self, "edges", edges)
        object.__setattr__(self, "weights", weights)
        object.__setattr__(self, "names", tuple(self.names))

    @property
    def is_integer(self) -> bool:
        """Whether every sensor is either on or off."""
        return bool(np.all(np.minimum(np.abs(self.weights), np.abs(self.weights - 1)) <= INTEGER))

    @property
    def switches(self) -> int:
        """The number of inner edges at which the set of sensors changes (above rounding)."""
        return int(np.sum(np.any(np.abs(np.diff(self.weights, axis=0)) > INTEGER, axis=1)))

    @property
    def singular_fraction(self) -> float:
        """The share of the horizon on which a weight is fractional (singular arcs of the relaxed problem)."""
        fractional = np.any((self.weights > 1e-3) & (self.weights < 1 - 1e-3), axis=1)
        lengths = np.diff(self.edges)
        return float(np.sum(lengths[fractional]) / np.sum(lengths))

    def common_edges(self, edges: np.ndarray) -> np.ndarray:
        """The union of a grid and of the times at which the schedule has edges: what both can be written on.

        Parameters
        ----------
        edges : (N+1,) increasing times of the grid; an edge of the schedule that nearly meets one of them is that one

        Returns the times (K+1,), `edges` among them bit for bit. Raises ProblemError when the schedule is not over the
        grid's horizon.
        """
        edges = np.asarray(edges, dtype=float)
        self.require_horizon(edges)
        return np.union1d(edges, np.clip(snap(self.edges, edges), edges[0], edges[-1]))

    def on_grid(self, edges: np.ndarray, names: Sequence[str], select: int | None = None) -> np.ndarray:
        """The weights on the intervals of a grid, for sensors in another order.

        Parameters
        ----------
        edges : (N+1,) increasing times that hold every switch of the schedule, see `common_edges`
        names : the M sensors of the columns; those that the schedule does not name are not used
        select : how many sensors are used at a time, where that is to be checked

        Returns (N, M). Raises ProblemError when the schedule is not over the grid's horizon, switches inside an
        interval of the grid, uses a sensor that is not among `names`, or has weights out of range: each at least 0 and,
        but for idle, at most 1, and together `select`.
        """
        edges, names = np.asarray(edges, dtype=float), list(names)
        self.require_horizon(edges)
        changes = np.flatnonzero(np.any(np.abs(np.diff(self.weights, axis=0)) > INTEGER, axis=1)) + 1
        switches = self.edges[changes]
        inside = switches[~np.isin(snap(switches, edges), edges)]
        if len(inside):
            k = int(np.searchsorted(edges, inside[0])) - 1
            raise ProblemError(
                f"the schedule switches at t = {inside[0]:.12g}, inside the interval "
                f"[{edges[k]:.12g}, {edges[k + 1]:.12g}]",
                "the grid must have an edge there",
            )
        middle = edges[:-1] + np.diff(edges) / 2
        which = np.clip(np.searchsorted(self.edges, middle, side="right") - 1, 0, len(self.weights) - 1)
        weights = np.zeros((len(middle), len(names)))
        for i, name in enumerate(self.names):
            column = self.weights[which, i]
            if name in names:
                weights[:, names.index(name)] += column
            elif np.any(self.weights[:, i] > INTEGER):
                raise ProblemError(f"there is no sensor '{name}'", suggest(name, names))
        self._require_range(edges, names, weights, select)
        return weights

    def require_horizon(self, edges: np.ndarray) -> None:
        """Raise ProblemError unless the schedule begins and ends where the grid does, `edges` (N+1,) times."""
        hint = f"the schedule must cover the horizon [{edges[0]:.12g}, {edges[-1]:.12g}]"
        start, end = self.edges[0], self.edges[-1]
        if snap(start, edges) != edges[0]:
            if start > edges[0]:
                raise ProblemError(f"nothing is scheduled between t = {edges[0]:.12g} and {start:.12g}", hint)
            raise ProblemError(f"the schedule starts at {start:.12g}, the horizon at {edges[0]:.12g}", hint)
        if snap(end, edges) != edges[-1]:
            if end < edges[-1]:
                raise ProblemError(f"nothing is scheduled between t = {end:.12g} and {edges[-1]:.12g}", hint)
            raise ProblemError(f"the schedule ends at {end:.12g}, the horizon at {edges[-1]:.12g}", hint)

    def _require_range(self, edges: np.ndarray, names: list[str], weights: np.ndarray, select: int | None) -> None:
        """ProblemError naming the first weight out of range, or the first interval whose sum is not `select`."""
        most = np.array([np.inf if name == IDLE else 1.0 for name in names])
        wrong = np.argwhere((weights < -INTEGER) | (weights > most + INTEGER))
        if len(wrong):
            k, j = (int(i) for i in wrong[0])
            what = f"the weight of sensor '{names[j]}' is {weights[k, j]:g} at t = {edges[k]:.12g}"
            raise ProblemError(f"{what}, it must lie between 0 and 1")
        total = np.sum(weights, axis=1)
        if select is not None and np.any(np.abs(total - select) > INTEGER * max(1, select)):
            k = int(np.argmax(np.abs(total - select) > INTEGER * max(1, select)))
            raise ProblemError(f"the weights add up to {total[k]:g} at t = {edges[k]:.12g}, but select is {select}")

    def segments(self) -> list[dict]:
        """[{start, end, sensors: [name, ..]}], neighbours with equal weights merged.

        Fractional segments carry `weights` beside `sensors` (those above 1e-6).
        """
        result: list[dict] = []
        previous: np.ndarray | None = None
        for k, v in enumerate(self.weights):
            if previous is not None and np.all(np.abs(v - previous) <= INTEGER):
                result[-1]["end"] = float(self.edges[k + 1])
                continue
            used = [j for j in range(len(v)) if v[j] > INTEGER]
            segment: dict = {
                "start": float(self.edges[k]),
                "end": float(self.edges[k + 1]),
                "sensors": [self.names[j] for j in used],
            }
            if any(abs(v[j] - 1) > INTEGER for j in used):
                segment["weights"] = [float(v[j]) for j in used]
            result.append(segment)
            previous = v
        return result


def snap(times: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Times moved onto the edges of a grid that they nearly meet (core/clock.py says how nearly).

    An edge takes the nearest of these times only: a diffuse start may be cut into segments far shorter than the grid
    tells apart, and none of them may vanish.

    Parameters
    ----------
    times : (K,) or a single time
    edges : (N+1,) increasing times, N >= 1

    Returns the times (K,) or the single one.
    """
    edges = np.asarray(edges, dtype=float)
    index, same = nearest_edge(times, edges)
    near = np.where(same, np.abs(edges[index] - times), np.inf)
    nearest = np.full(len(edges), np.inf)
    np.minimum.at(nearest, index, near)
    return np.where(same & (near <= nearest[index]), edges[index], times)


def constant_schedule(edges: np.ndarray, names: Sequence[str], weights: Sequence[float]) -> Schedule:
    """The same weights (M,) on every interval between the times `edges` (K+1,)."""
    return Schedule(edges, np.tile(np.asarray(weights, dtype=float), (len(edges) - 1, 1)), tuple(names))

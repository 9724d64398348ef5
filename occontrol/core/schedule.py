"""Schedules: a control lives on intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

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


def constant_schedule(edges: np.ndarray, names: Sequence[str], weights: Sequence[float]) -> Schedule:
    """The same weights (M,) on every interval of `edges` (K+1,)."""
    return Schedule(edges, np.tile(np.asarray(weights, dtype=float), (len(edges) - 1, 1)), tuple(names))

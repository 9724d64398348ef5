"""Trajectories: a state lives on nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Values at times.

    Parameters
    ----------
    times : (N+1,) increasing, in the unit of time
    values : (N+1, ...) one array per time, in the units of what it follows
    """

    times: np.ndarray
    values: np.ndarray

    def __post_init__(self) -> None:
        if len(self.times) != len(self.values):
            raise ValueError(f"{len(self.values)} values for {len(self.times)} times")

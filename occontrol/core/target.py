"""What of a run goes onto a target: a schedule, and the sampled model of the filter along it where there is one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from occontrol.core.schedule import Schedule


@dataclass(frozen=True, eq=False)
class TargetModel:
    """The Kalman filter along a schedule, interval by interval, plant noise and reading noise correlated.

    z = H x + d + v,   x+ = F x + g + w,   cov [w; v] = N N'

    Parameters
    ----------
    transition, input : F (N, n, n), g (N, n), in state units
    observe, offset : N arrays H (m, n), d (m,), m differing by interval; in measurement units
    noise_root : N arrays N (n + m, s), s >= m, the rows of w first
    mean, covariance : (n,), (n, n) of x at the start, in state units
    predict_matrix, predict_offset, predict_noise : (N+1, p, n), (N+1, p), (N+1, p, p) of the prediction from every
        node; p = 0 where nothing is predicted
    """

    transition: np.ndarray
    input: np.ndarray
    observe: Sequence[np.ndarray]
    offset: Sequence[np.ndarray]
    noise_root: Sequence[np.ndarray]
    mean: np.ndarray
    covariance: np.ndarray
    predict_matrix: np.ndarray
    predict_offset: np.ndarray
    predict_noise: np.ndarray

    @property
    def states(self) -> int:
        """The number n of states."""
        return len(self.mean)

    @property
    def outputs(self) -> int:
        """The number p of predicted outputs."""
        return self.predict_matrix.shape[1]


@dataclass(frozen=True, eq=False)
class TargetPlan:
    """A schedule for a target; values arrive at the ends of its intervals.

    Parameters
    ----------
    edges : (N+1,) times, in the unit of time; only readings may have an empty first interval
    names : of the M sensors
    rows : (M,) values of one sample of each
    active : N collections of positions in `names`: who measures
    instants : whether values are readings at the ends of the intervals, and not averages over them
    variable : "t", or "k" in discrete time
    predicted_for : the time of the prediction in words, such as " at t = 12"; empty where nobody says
    model : TargetModel, or None where the family has no filter for a target
    why : the reason where there is none
    states : names of the states, with their units; () where nobody says
    """

    edges: np.ndarray
    names: tuple[str, ...]
    rows: tuple[int, ...]
    active: Sequence[Sequence[int]]
    instants: bool
    variable: str = "t"
    predicted_for: str = ""
    model: TargetModel | None = None
    why: str = ""
    states: tuple[str, ...] = ()

    @property
    def intervals(self) -> int:
        """The number N of intervals."""
        return len(self.edges) - 1


def schedule_alone(schedule: Schedule, why: str) -> TargetPlan:
    """The plan of a schedule without a filter.

    Parameters
    ----------
    schedule : with whole weights; of shared times the sensor with the largest share is taken
    why : the reason why there is no filter
    """
    largest = np.max(schedule.weights, axis=1, keepdims=True)
    chosen = (schedule.weights > 0.5) | ((schedule.weights == largest) & (largest <= 0.5))
    return TargetPlan(
        edges=schedule.edges,
        names=schedule.names,
        rows=(0,) * len(schedule.names),
        active=[tuple(np.flatnonzero(row).tolist()) for row in chosen],
        instants=False,
        why=why,
    )

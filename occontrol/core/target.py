"""What of a run goes onto a target: a schedule, and the sampled model of the filter along it where there is one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from occontrol.core.kinds import CasadiFunction
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
class FormulaModel:
    """The extended Kalman filter of a nonlinear plant, read at the ends of N intervals.

    dx/dt = f(x, t) + w, or x+ = f(x, k) + w;   z = h(x, t) + v

    Parameters
    ----------
    right : CasADi function (x, t) -> f (n,) and df/dx (n, n), in state units, per time unless `discrete`
    noise : CasADi function (x, t) -> intensity of w (n, n), in discrete time its covariance; None where there is none
    reports : CasADi functions (x, t) -> h (m,), dh/dx (m, n), cov v (m, m), one a sensor; None for one without values
    angles : for every sensor which of its values are angles, whose differences lie between -pi and pi
    mean, covariance : (n,), (n, n) of x at the start, in state units
    since, lengths : (G,) beginning and length of the spans of time, one before every reading and the rest up to the
        prediction, in the unit of time; a span of length 0 moves nothing
    substeps : of a span, two steps of Runge and Kutta each
    discrete : whether f is the map of one step
    output : D (p, n) of the prediction D x, in output units per state unit; p = 0 where nothing is predicted
    last : number of spans up to the prediction
    """

    right: CasadiFunction
    noise: CasadiFunction | None
    reports: Sequence[CasadiFunction | None]
    angles: Sequence[Sequence[bool]]
    mean: np.ndarray
    covariance: np.ndarray
    since: np.ndarray
    lengths: np.ndarray
    substeps: int
    discrete: bool
    output: np.ndarray
    last: int

    @property
    def states(self) -> int:
        """The number n of states."""
        return len(self.mean)

    @property
    def outputs(self) -> int:
        """The number p of predicted outputs."""
        return len(self.output)


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
    model : TargetModel, or None where the filter is not linear or the family has none for a target
    formulas : FormulaModel, or None where the filter is linear or there is none
    why : the reason where there is none
    states : names of the states, with their units; () where nobody says
    again : of a cycle that is repeated for ever the interval that follows the last one; None where the horizon ends
    """

    edges: np.ndarray
    names: tuple[str, ...]
    rows: tuple[int, ...]
    active: Sequence[Sequence[int]]
    instants: bool
    variable: str = "t"
    predicted_for: str = ""
    model: TargetModel | None = None
    formulas: FormulaModel | None = None
    why: str = ""
    states: tuple[str, ...] = ()
    again: int | None = None

    @property
    def intervals(self) -> int:
        """The number N of intervals."""
        return len(self.edges) - 1

    @property
    def filter(self) -> TargetModel | FormulaModel | None:
        """The filter, of either kind; None where there is none."""
        return self.formulas if self.model is None else self.model


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

"""Elements of the collocation: intervals of the grid, cut where data breaks and where the covariance falls steeply."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from occontrol.core.signal import Signal, TableSignal
from occontrol.families.athans.collocation.simulation import Data, simulate_interval
from occontrol.families.athans.problem import SchedulingProblem

LARGEST = 80
CORNER = 0.05


@dataclass(frozen=True, eq=False)
class Mesh:
    """Elements and a simulated covariance on them.

    Parameters
    ----------
    starts, lengths : (E,);  interval : (E,) the interval of the grid that each lies in
    first : (N,) the first element of each interval
    stages : (E, s, n, n) simulated covariance at the collocation points
    ends : (E + 1, n, n) simulated covariance at the ends of the elements
    """

    starts: np.ndarray
    lengths: np.ndarray
    interval: np.ndarray
    first: np.ndarray
    stages: np.ndarray
    ends: np.ndarray

    def times(self, points: np.ndarray) -> np.ndarray:
        """(E, s) times of the collocation `points` (s,); an end is taken from inside, because tables may jump there."""
        return self.starts[:, None] + self.lengths[:, None] * np.minimum(points, 1 - 1e-12)


def simulate_mesh(
    problem: SchedulingProblem,
    weights: np.ndarray,
    points: np.ndarray,
    step: float,
    by_growth: bool = False,
    cuts: np.ndarray | None = None,
) -> Mesh:
    """Simulate a policy and cut every interval so that length * tr(Sigma L(v)) <= step at the start of each element.

    Parameters
    ----------
    problem : SchedulingProblem
    weights : (N, M)
    points : (s,) collocation points on [0, 1]
    step : a covariance that falls like 1/t is followed by elements that grow like (1 + step)^k
    by_growth : look at tr(Xi Sigma^-1) instead, the rate that matters to the inverse of Sigma
    cuts : (K,) times that are ends of elements in any case
    """
    data, covariance = Data(problem), problem.plant.covariance
    breaks = coarse_breaks(problem)
    if cuts is not None:
        breaks = np.unique(np.concatenate([breaks, cuts]))
    starts, lengths, interval, first, stages, ends = [], [], [], [], [], [covariance]
    for k, (a, b) in enumerate(zip(problem.edges[:-1], problem.edges[1:], strict=True)):
        path = simulate_interval(data, a, b, covariance, weights[k])
        slack = 1e-9 * (b - a)
        inner = breaks[(breaks > a + slack) & (breaks < b - slack)]
        marks = _cut(data, path, np.concatenate([[a], inner, [b]]), weights[k], step, by_growth, covariance)
        first.append(len(starts))
        for left, right in itertools.pairwise(marks):
            starts.append(left)
            lengths.append(right - left)
            interval.append(k)
            found = path(np.append(left + (right - left) * points, right))
            stages.append(found[:-1])
            ends.append(found[-1])
        covariance = ends[-1]
    return Mesh(*map(np.array, (starts, lengths, interval, first, stages, ends)))


def coarse_breaks(problem: SchedulingProblem) -> np.ndarray:
    """Times at which elements must end: jumps of tables, and corners where the slope changes much.

    A finely tabulated smooth function bends a little at every breakpoint; elements across such kinks are accurate
    enough, or are cut later because the simulation of the policy says so.
    """
    ends = float(problem.edges[0]), float(problem.edges[-1])
    return np.unique(np.concatenate([np.empty(0), *[_corners(s, *ends) for s in problem.signals.values()]]))


def _corners(signal: Signal, start: float, end: float) -> np.ndarray:
    if not isinstance(signal, TableSignal) or signal.interpolation != "linear" or len(signal.times) < 2:
        return signal.breaks(start, end)
    steps = np.diff(signal.times)
    slopes = np.diff(signal.values, axis=0) / steps[:, None, None]
    bends = np.abs(np.diff(slopes, axis=0)) * np.minimum(steps[1:], steps[:-1])[:, None, None]
    return signal.times[1:-1][np.any(bends > CORNER * np.max(np.abs(signal.values), axis=0), axis=(1, 2))]


def _cut(
    data: Data,
    path: Callable[[np.ndarray], np.ndarray],
    pieces: np.ndarray,
    weights: np.ndarray,
    step: float,
    by_growth: bool,
    covariance: np.ndarray,
) -> list[float]:
    marks = [float(pieces[0])]
    for end in pieces[1:]:
        while len(marks) <= LARGEST:
            left = marks[-1]
            here = path(np.array([left]))[0] if len(marks) > 1 else covariance
            if by_growth:
                fall = float(np.trace(np.linalg.solve(here, data.plant(left)[1])))
            else:
                fall = float(np.trace(data.information(left, weights) @ here))
            length = step / fall if fall > 0 else np.inf
            if left + 1.2 * length >= end:
                break
            marks.append(left + length)
        marks.append(float(end))
    return marks

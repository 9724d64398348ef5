"""Relaxed weights become one sensor (or `select` sensors) at a time: sum-up rounding (Sager 2009).

`sum_up` is the compiled loop behind `IntervalPolytopes.round`; solvers ask for `roundings`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from occontrol.numerics.loops import ENTRY

if TYPE_CHECKING:
    from occontrol.scheduling.feasible_set import FeasibleSet


@njit(cache=True, error_model="numpy", **ENTRY)
def _sum_up(weights, steps, upper, select, result, deficit, room):
    N, M = weights.shape
    for k in range(N):
        h = steps[k]
        for j in range(M):
            deficit[j] += h * weights[k, j]
            room[j] = upper[k, j]
        for _ in range(select):
            best = -1
            for j in range(M):
                if room[j] > 0.5 and (best < 0 or deficit[j] > deficit[best] + 1e-12 * h):
                    best = j
            result[k, best] += 1.0
            room[best] -= 1.0
            deficit[best] -= h


def sum_up(
    weights: np.ndarray, lengths: np.ndarray, upper: np.ndarray, select: int, backward: bool = False
) -> np.ndarray:
    """The integral policy whose accumulated use stays closest to the relaxed one's.

    On every interval each of the `select` places goes to the available sensor with the largest deficit
    sum_{i<=k} h_i v_ij - sum_{i<k} h_i w_ij, ties to the lowest index.

    Parameters
    ----------
    weights : (N, M) relaxed policy
    lengths : (N,) of the intervals
    upper : (N, M) largest weights
    select : places per interval
    backward : from the last interval to the first

    Returns (N, M) integral.
    """
    turn = slice(None, None, -1 if backward else 1)
    result, space = np.zeros_like(weights), np.zeros((2, weights.shape[1]))
    _sum_up(*(np.ascontiguousarray(x[turn]) for x in (weights, lengths, upper)), select, result, *space)
    return np.ascontiguousarray(result[turn])


def roundings(weights: np.ndarray, feasible_set: FeasibleSet) -> list[np.ndarray]:
    """Integral policies (N, M) near a relaxed one; none of these kinds is the best on every problem.

    The last has the largest weights on every interval: clean switches, but nothing like singular arcs.

    Parameters
    ----------
    weights : (N, M) relaxed policy
    feasible_set : FeasibleSet that they belong to
    """
    by_use = [feasible_set.round(weights, backward=backward) for backward in (False, True)]
    return [*by_use, feasible_set.vertex(-weights)]


SHORTEST = 4
CHANGES = 3


def singular_intervals(relaxed: np.ndarray, rounded: np.ndarray) -> np.ndarray:
    """(N,) whether an interval lies on a singular arc: relaxed weights fractional, the switching policy chatters.

    A switch time inside an interval, or one not yet sharp at the target gap, leaves a few fractional intervals too;
    there the rounded policy changes once or twice. So a run of fractional intervals counts when it has at least
    SHORTEST of them and the rounded policy changes at least CHANGES times within it.

    Parameters
    ----------
    relaxed : (N, M) relaxed optimum
    rounded : (N, M) integral policy made from it
    """
    fractional = np.any((np.abs(relaxed - np.round(relaxed)) > 1e-3), axis=1)
    singular = np.zeros(len(relaxed), dtype=bool)
    starts = np.flatnonzero(fractional & ~np.r_[False, fractional[:-1]])
    ends = np.flatnonzero(fractional & ~np.r_[fractional[1:], False]) + 1
    changed = np.r_[False, np.any(np.abs(np.diff(rounded, axis=0)) > 0.5, axis=1)]
    for a, b in zip(starts, ends, strict=True):
        if b - a >= SHORTEST and np.sum(changed[a + 1 : b]) >= CHANGES:
            singular[a:b] = True
    return singular

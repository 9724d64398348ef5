"""Relaxed weights become one sensor (or `select` sensors) at a time: sum-up rounding (Sager 2009)."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def _sum_up(weights, steps, upper, select, result):
    N, M = weights.shape
    deficit = np.zeros(M)
    room = np.empty(M)
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


def sum_up_rounding(weights: np.ndarray, steps: np.ndarray, upper: np.ndarray, select: int) -> np.ndarray:
    """The integral policy whose accumulated use stays closest to the relaxed one's.

    On every interval each of the `select` places goes to the available sensor with the largest deficit
    sum_{i<=k} h_i v_ij - sum_{i<k} h_i w_ij, ties to the lowest index.

    Parameters
    ----------
    weights : (N, M) relaxed policy
    steps : (N,) interval lengths
    upper : (N, M) largest weights
    select : places per interval

    Returns (N, M) integral.
    """
    result = np.zeros_like(weights)
    _sum_up(np.ascontiguousarray(weights), steps, upper, select, result)
    return result

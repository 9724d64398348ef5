"""The face that a policy lies on, as compiled loops behind scheduling/feasible_set.py."""

from __future__ import annotations

import numpy as np
from numba import njit

from occontrol.numerics.loops import ENTRY

_OPTIONS = {"cache": True, "nogil": True, "fastmath": {"contract", "nsz", "reassoc"}, "error_model": "numpy", **ENTRY}


@njit(**_OPTIONS, inline="always")
def face_row(v, g, upper, near, free, move):
    """The free weights of one interval: between their bounds, or at one that the reduced gradient pushes away from.

    move (M,) : what nearly stands at a bound and is pushed there goes all the way, instead of dragging the direction
    along. Returns how many are free.
    """
    M = len(v)
    # the multiplier is the gradient at the weight farthest from its bounds; at a vertex it lies between the largest
    # gradient of the used and the smallest of the unused weights
    anchor, room = -1, near
    used, unused = -np.inf, np.inf
    for j in range(M):
        if upper[j] > 0.0:
            x = v[j] if v[j] < upper[j] - v[j] else upper[j] - v[j]
            if x > room:
                anchor, room = j, x
            if v[j] > near:
                used = g[j] if g[j] > used else used
            else:
                unused = g[j] if g[j] < unused else unused
    number, excess = 0, 0.0
    for j in range(M):
        inside = upper[j] > 0.0
        x = 0.0
        if inside and v[j] <= near and j != anchor:
            inside = g[j] < (g[anchor] if anchor >= 0 else used)
            x = 0.0 if inside else -v[j]
        elif inside and v[j] >= upper[j] - near and j != anchor:
            inside = g[j] > (g[anchor] if anchor >= 0 else unused)
            x = 0.0 if inside else upper[j] - v[j]
        free[j] = inside
        number += inside
        move[j] = x
        excess += x
    if anchor >= 0:
        move[anchor] -= excess  # by the sign of g_j - g_anchor a descent; left to the projection it may not be
    return number


@njit(**_OPTIONS)
def _face(v, g, upper, near, free, count, move):
    for k in range(len(v)):
        count[k] = face_row(v[k], g[k], upper[k], near, free[k], move[k])


@njit(**_OPTIONS)
def _list_face(free, count, listed, ends):
    """The free weights of intervals with two or more of them, interval by interval; their number and the intervals'."""
    N, M = free.shape
    size = rows = 0
    for k in range(N):
        if count[k] > 1:
            for j in range(M):
                if free[k, j]:
                    listed[size] = k * M + j
                    size += 1
            ends[rows] = size
            rows += 1
    return size, rows


def face(
    weights: np.ndarray, gradient: np.ndarray, upper: np.ndarray, near: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The free weights interval by interval, where each interval's list ends, and what goes straight to its bound.

    Parameters
    ----------
    weights, gradient, upper : (N, M)
    near : distance at which a weight counts as standing at its bound

    Returns listed (F,) flat indices, ends (G,), move (N, M); intervals with fewer than two free weights list none.
    """
    N, M = weights.shape
    free, count = np.empty((N, M), dtype=np.bool_), np.empty(N, dtype=np.int64)
    listed, ends = np.empty(N * M, dtype=np.int64), np.empty(N, dtype=np.int64)
    move = np.empty((N, M))
    _face(weights, gradient, upper, near, free, count, move)
    size, rows = _list_face(free, count, listed, ends)
    return listed[:size], ends[:rows], move

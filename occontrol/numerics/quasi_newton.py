"""Limited-memory BFGS restricted to the face of V that the policy lies on (two-metric projection, Bertsekas 1982).

On the free weights of every interval the direction lies in the plane sum_j d_j = 0; the others stay at their bounds.
"""

from __future__ import annotations

import numpy as np
from numba import njit

_OPTIONS = {"cache": True, "nogil": True, "fastmath": {"contract", "nsz", "reassoc"}, "error_model": "numpy"}
CURVATURE = 1e-10
BOUND = 1e-10
NEAR = 1e-6  # larger: what goes all the way disturbs the rest, and steps fail near a gap of 1e-6


@njit(**_OPTIONS)
def _face(v, g, upper, free, count):
    """Free weights: between their bounds, or at a bound that the reduced gradient pushes them away from."""
    N, M = v.shape
    for k in range(N):
        # the multiplier is the gradient at the weight farthest from its bounds; at a vertex it lies between the largest
        # gradient of the used and the smallest of the unused weights
        anchor, room = -1, BOUND
        used, unused = -np.inf, np.inf
        for j in range(M):
            if upper[k, j] > 0.0:
                x = min(v[k, j], upper[k, j] - v[k, j])
                if x > room:
                    anchor, room = j, x
                if v[k, j] > BOUND:
                    used = max(used, g[k, j])
                else:
                    unused = min(unused, g[k, j])
        number = 0
        for j in range(M):
            inside = upper[k, j] > 0.0
            if inside and v[k, j] <= NEAR and j != anchor:
                inside = g[k, j] < (g[k, anchor] if anchor >= 0 else used)
            elif inside and v[k, j] >= upper[k, j] - NEAR and j != anchor:
                inside = g[k, j] > (g[k, anchor] if anchor >= 0 else unused)
            free[k, j] = inside
            number += inside
        count[k] = max(number, 1)


@njit(**_OPTIONS)
def _flatten(x, mask, count, out):
    """out <- x projected on the plane of the face."""
    N, M = x.shape
    for k in range(N):
        mean = 0.0
        for j in range(M):
            mean += mask[k, j] * x[k, j]
        mean /= count[k]
        for j in range(M):
            out[k, j] = mask[k, j] * (x[k, j] - mean)


@njit(**_OPTIONS)
def _two_loops(g, mask, count, S, Y, oldest, stored, first_length, q, t, alpha, curvature):
    """-B g on the face, into q; returns whether any pair was used. mask (N, M) is 1 on the face and 0 off it."""
    size = g.size
    memory = S.shape[0]
    _flatten(g, mask, count, q)
    m1, q1, t1 = mask.reshape(-1), q.reshape(-1), t.reshape(-1)
    gamma = -1.0
    for i in range(stored - 1, -1, -1):
        slot = (oldest + i) % memory
        s1 = S[slot].reshape(-1)
        _flatten(Y[slot], mask, count, t)
        sy = yy = ss = sq = 0.0
        for j in range(size):  # t and q vanish off the face
            sy += s1[j] * t1[j]
            yy += t1[j] * t1[j]
            ss += m1[j] * s1[j] * s1[j]
            sq += s1[j] * q1[j]
        if not sy > CURVATURE * np.sqrt(ss * yy):
            curvature[i] = 0.0
            continue
        curvature[i] = sy
        if gamma < 0.0:
            gamma = sy / yy
        a = sq / sy
        alpha[i] = a
        for j in range(size):
            q1[j] -= a * t1[j]
    used = gamma > 0.0
    if not used:
        largest = np.max(np.abs(q1))
        gamma = first_length / largest if largest > 0.0 else 1.0
    for j in range(size):
        q1[j] *= gamma
    for i in range(stored):
        if curvature[i] <= 0.0:
            continue
        slot = (oldest + i) % memory
        y1 = Y[slot].reshape(-1)
        yd = 0.0
        for j in range(size):
            yd += y1[j] * q1[j]
        b = alpha[i] - yd / curvature[i]
        _flatten(S[slot], mask, count, t)
        for j in range(size):
            q1[j] += b * t1[j]
    for j in range(size):
        q1[j] = -q1[j]
    return used


class FaceBFGS:
    """The last `memory` pairs (step, change of gradient) and the direction they give on a face.

    Parameters
    ----------
    shape : (N, M) of the policies
    memory : pairs kept
    first_length : largest component of the very first step
    """

    def __init__(self, shape: tuple[int, int], memory: int = 20, first_length: float = 0.3):
        self.memory, self.first_length = memory, first_length
        self._S, self._Y = np.empty((memory, *shape)), np.empty((memory, *shape))
        self._q, self._t = np.empty(shape), np.empty(shape)
        self._free, self._count = np.empty(shape, dtype=np.bool_), np.empty(shape[0])
        self._mask = np.empty(shape)
        self._alpha, self._curvature = np.empty(memory), np.empty(memory)
        self.reset()

    def reset(self) -> None:
        """Forget all pairs."""
        self._oldest = self._stored = 0

    def update(self, step: np.ndarray, change: np.ndarray) -> None:
        """Take one pair.

        Parameters
        ----------
        step : (N, M) difference of two policies
        change : (N, M) difference of their gradients
        """
        slot = (self._oldest + self._stored) % self.memory
        if self._stored == self.memory:
            self._oldest = (self._oldest + 1) % self.memory
        else:
            self._stored += 1
        self._S[slot], self._Y[slot] = step, change

    def direction(self, weights: np.ndarray, gradient: np.ndarray, upper: np.ndarray) -> np.ndarray:
        """The quasi-Newton direction (N, M) on the face of `weights`; a fresh array.

        Parameters
        ----------
        weights, gradient, upper : (N, M)
        """
        _face(weights, gradient, upper, self._free, self._count)
        self._mask[:] = self._free
        args = (gradient, self._mask, self._count, self._S, self._Y, self._oldest, self._stored)
        _two_loops(*args, self.first_length, self._q, self._t, self._alpha, self._curvature)
        if np.vdot(self._q, gradient) >= 0:
            _two_loops(*args[:6], 0, self.first_length, self._q, self._t, self._alpha, self._curvature)
        # what is nearly at a bound and pushed there goes all the way, instead of dragging the direction along
        low = ~self._free & (weights < 0.5 * upper)
        return np.where(self._free, self._q, np.where(low, -weights, upper - weights))

"""A better lower bound from several gradients together.

Every gradient gives a cut J(w) >= a_i + g_i.w on V, so for any shares lam the bound
    max over lam of  min over w in V of  sum_i lam_i (a_i + g_i.w)
holds. The last cuts of a quasi-Newton run lean to different sides of the optimum; their mixture cancels that.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from occontrol.scheduling.polytope import fill


@njit(cache=True, nogil=True, fastmath={"contract", "nsz", "reassoc"}, error_model="numpy")
def _mixture(a, g, count, last, upper, select, rounds, wanted):
    """The best bound of the first `count` cuts by entropic ascent on their shares, from cut `last`, up to `wanted`."""
    N, M = upper.shape
    shares, values = np.zeros(count), np.empty(count)
    shares[last] = 1.0
    mixed, w = np.empty(M), np.empty(M)
    best = -np.inf
    for turn in range(rounds):
        values[:] = a[:count]
        for k in range(N):
            mixed[:] = 0.0
            for i in range(count):
                x = shares[i]
                if x > 1e-9:  # any shares are valid, so the smallest may be dropped
                    for j in range(M):
                        mixed[j] += x * g[i, k, j]
            fill(mixed, upper[k], select, w)
            for j in range(M):
                x = w[j]
                if x > 0.0:
                    for i in range(count):
                        values[i] += x * g[i, k, j]
        # w minimises the mixture of the kept shares, so their sum is the divisor
        total = kept = 0.0
        low, high = np.inf, -np.inf
        for i in range(count):
            if shares[i] > 1e-9:
                total += shares[i] * values[i]
                kept += shares[i]
            low, high = min(low, values[i]), max(high, values[i])
        best = max(best, total / kept)
        if not high > low or best >= wanted:
            break
        total = 0.0
        for i in range(count):
            shares[i] = (shares[i] + 1e-4) * np.exp(3.0 / (high - low) / np.sqrt(turn + 1.0) * (values[i] - high))
            total += shares[i]
        for i in range(count):
            shares[i] /= total
    return best


class Cuts:
    """The last `size` cuts and the bound that they prove together.

    Parameters
    ----------
    shape : (N, M)
    upper : (N, M)
    select : sum of the weights
    size : cuts kept
    """

    def __init__(self, shape: tuple[int, int], upper: np.ndarray, select: int, size: int = 20):
        self.upper, self.select, self.size = upper, select, size
        self._g = np.zeros((size, *shape))
        self._a = np.full(size, -np.inf)
        self._next = 0

    def add(self, cost: float, gradient: np.ndarray, weights: np.ndarray) -> None:
        """The cut at a policy.

        Parameters
        ----------
        cost : J there
        gradient, weights : (N, M)
        """
        slot = self._next % self.size
        self._g[slot] = np.where(self.upper > 0, gradient, 0.0)
        self._a[slot] = cost - float(np.vdot(self._g[slot], weights))
        self._next += 1

    def bound(self, rounds: int = 50, wanted: float = np.inf) -> float:
        """The best mixture of at most `rounds` steps of entropic ascent, up to `wanted`; valid whenever it stops."""
        count, last = min(self._next, self.size), (self._next - 1) % self.size
        return _mixture(self._a, self._g, count, last, self.upper, self.select, rounds, wanted)

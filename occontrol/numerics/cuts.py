"""A better lower bound from several gradients together.

Every gradient gives a cut J(w) >= a_i + g_i.w on V, so for any shares lam the bound
    max over lam of  min over w in V of  sum_i lam_i (a_i + g_i.w)
holds. The last cuts of a quasi-Newton run lean to different sides of the optimum; their mixture cancels that.
"""

from __future__ import annotations

import numpy as np

from occontrol.numerics.polytope import vertex


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

    def bound(self, rounds: int = 50) -> float:
        """The best mixture found in `rounds` steps of entropic ascent; valid whenever it stops."""
        count = min(self._next, self.size)
        a, G = self._a[:count], self._g[:count].reshape(count, -1)
        lam = np.zeros(count)
        lam[(self._next - 1) % self.size] = 1.0
        best = -np.inf
        for i in range(rounds):
            mixed = (lam @ G).reshape(self.upper.shape)
            w = vertex(mixed, self.upper, self.select)
            values = a + G @ w.ravel()
            best = max(best, float(lam @ values))
            spread = float(np.ptp(values))
            if spread <= 0:
                break
            lam = (lam + 1e-4) * np.exp(3.0 / spread / np.sqrt(i + 1) * (values - values.max()))
            lam /= lam.sum()
        return best

"""A better lower bound from several gradients together.

Every gradient gives a cut J(w) >= a_i + g_i.w on V, so for any shares lam the bound
    max over lam of  min over w in V of  sum_i lam_i (a_i + g_i.w)
holds. The last cuts of a quasi-Newton run lean to different sides of the optimum; their mixture cancels that.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from occontrol.scheduling.feasible_set import FeasibleSet


class Cuts:
    """The last `size` cuts and the bound that they prove together.

    Parameters
    ----------
    feasible_set : FeasibleSet of the policies (N, M)
    size : cuts kept
    """

    def __init__(self, feasible_set: FeasibleSet, size: int = 20):
        self.feasible_set, self.size = feasible_set, size
        self._g = np.zeros((size, *feasible_set.shape))
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
        self._g[slot] = gradient
        self._a[slot] = cost - float(np.vdot(self._g[slot], weights))
        self._next += 1

    def bound(self, rounds: int = 50, wanted: float = np.inf) -> float:
        """The best mixture of at most `rounds` steps of entropic ascent, up to `wanted`; valid whenever it stops."""
        count, last = min(self._next, self.size), (self._next - 1) % self.size
        return self.feasible_set.mixture(self._a[:count], self._g[:count], last, rounds, wanted)

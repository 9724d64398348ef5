"""IntervalPolytopes some of whose weights are fixed at 1: the sets of a tree over single readings."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from occontrol.scheduling import polytope
from occontrol.scheduling.feasible_set import Face, FeasibleSet, IntervalPolytopes
from occontrol.scheduling.polytope_face import face as polytope_face


@dataclass(frozen=True, eq=False)
class Committed(IntervalPolytopes):
    """IntervalPolytopes with v = 1 where `fixed`; no interval has more of them than `select`.

    What is fixed comes first in every choice: its price is below, its weight above all others.

    Parameters
    ----------
    upper, select, edges, names : as there; upper is 1 where a weight is fixed
    fixed : (N, M) bool
    """

    fixed: np.ndarray = field(default_factory=lambda: np.zeros((0, 0), dtype=bool))

    def _priced(self, gradient: np.ndarray) -> np.ndarray:
        """Prices (N, M) for which what is fixed is the cheapest."""
        return np.where(self.fixed, -4.0 * (float(np.max(np.abs(gradient), initial=0.0)) + 1e-300), gradient)

    def vertex(self, gradient: np.ndarray) -> np.ndarray:
        """The cheapest schedule (N, M) with the fixed weights for `gradient` (N, M)."""
        return polytope.vertex(self._priced(gradient), self.upper, self.select)

    def project(self, weights: np.ndarray) -> np.ndarray:
        """The nearest policy (N, M) with the fixed weights to `weights` (N, M)."""
        lifted = weights + 4.0 * (float(np.max(np.abs(weights), initial=0.0)) + 2.0)
        return polytope.project(np.where(self.fixed, lifted, weights), self.upper, self.select)

    def excess(self, weights: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        """(N,) interval by interval, for `weights` (N, M) and `gradient` (N, M)."""
        saved = gradient * (weights - self.vertex(gradient))
        return np.sum(np.where(self.upper > 0.0, saved, 0.0), axis=1)

    def face(self, weights: np.ndarray, gradient: np.ndarray, near: float) -> Face:
        """As in IntervalPolytopes, with what is fixed kept; `weights` (N, M), `gradient` (N, M)."""
        return Face(*polytope_face(weights, self._priced(gradient), self.upper, near))

    def mixture(
        self, constants: np.ndarray, gradients: np.ndarray, last: int, rounds: int, wanted: float = np.inf
    ) -> float:
        """As in FeasibleSet, by the vertices of this set; constants (K,), gradients (K, N, M)."""
        return FeasibleSet.mixture(self, constants, gradients, last, rounds, wanted)

    def round(self, weights: np.ndarray, backward: bool = False) -> np.ndarray:
        """The schedule (N, M) with the largest weights (N, M) and those that are fixed."""
        return self.vertex(-weights)

    def uniform(self) -> np.ndarray:
        """A policy (N, M) of the set."""
        return self.project(polytope.uniform(self.upper, self.select))

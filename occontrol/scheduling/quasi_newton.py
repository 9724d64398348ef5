"""Limited-memory BFGS restricted to the face of V that the policy lies on (two-metric projection, Bertsekas 1982).

On every group of free weights (`Face`: those of one interval) the direction lies in the plane sum_j d_j = 0; the others
stay at their bounds.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from occontrol.numerics.loops import ENTRY

if TYPE_CHECKING:
    from occontrol.scheduling.feasible_set import FeasibleSet

_OPTIONS = {"cache": True, "nogil": True, "fastmath": {"contract", "nsz", "reassoc"}, "error_model": "numpy", **ENTRY}
CURVATURE = 1e-10
NEAR = 1e-6  # larger: what goes all the way disturbs the rest, and steps fail near a gap of 1e-6


@njit(**_OPTIONS)
def _on_face(x, listed, ends, out):
    """out (size, c) <- the first c columns of x at the rows of the face, less the mean of each interval."""
    begin = 0
    for end in ends:
        for i in range(out.shape[1]):
            mean = 0.0
            for a in range(begin, end):
                mean += x[listed[a], i]
            mean /= end - begin
            for a in range(begin, end):
                out[a, i] = x[listed[a], i] - mean
        begin = end


@njit(**_OPTIONS)
def _row_products(s, pairs, moved, out):
    """out (c,) <- s' times the first c columns of pairs, of which only the rows in `moved` count."""
    for a in range(moved.shape[0]):
        k = moved[a]
        for i in range(out.shape[0]):
            out[i] += s[k] * pairs[k, i]


class FaceBFGS:
    """The last `memory` pairs (step s, change of gradient y) and the direction they give on a face.

    With S = [s ..], Y = [y ..], D = diag(s'y) and L the part of S'Y below the diagonal, B = gamma I - W K^-1 W' with
    W = [gamma S, Y], K = [[gamma S'S, L], [L', -D]] (Byrd, Nocedal and Schnabel 1994, theorem 2.3). B is built from
    whole pairs and only then restricted to the plane of the face: pairs that were restricted one by one would lose what
    they know whenever the face changes.

    Parameters
    ----------
    size : N M, the weights of a policy
    memory : pairs kept
    first_length : largest component of the very first step
    """

    def __init__(self, size: int, memory: int = 20, first_length: float = 0.3):
        self.memory, self.first_length = memory, first_length
        self._pairs = np.zeros((size, 2 * memory))  # s, y, s, y, ..: what a face needs of them stands together
        self._SS, self._SY, self._younger = (np.zeros((memory, memory)) for _ in range(3))
        self.reset()

    def reset(self) -> None:
        """Forget all pairs."""
        self._order: list[int] = []  # slots, the oldest first

    def update(self, step: np.ndarray, change: np.ndarray) -> None:
        """Take one pair.

        Parameters
        ----------
        step : (N, M) difference of two policies
        change : (N, M) difference of their gradients
        """
        s, y, memory = step.ravel(), change.ravel(), self.memory
        if not float(s @ y) > 0.0:
            return
        slot = self._order.pop(0) if len(self._order) == memory else len(self._order)
        self._order.append(slot)
        self._pairs[:, 2 * slot], self._pairs[:, 2 * slot + 1] = s, y
        moved, stored = np.flatnonzero(s), len(self._order)
        products = np.zeros(2 * stored)
        _row_products(s, self._pairs, moved, products)
        self._SS[slot, :stored] = self._SS[:stored, slot] = products[0::2]
        self._SY[slot, :stored] = products[1::2]
        self._younger[slot], self._younger[:, slot] = 1.0, 0.0

    def direction(self, weights: np.ndarray, gradient: np.ndarray, feasible_set: FeasibleSet) -> np.ndarray:
        """The quasi-Newton direction (N, M) on the face of `weights`; a fresh array.

        Parameters
        ----------
        weights, gradient : (N, M)
        feasible_set : FeasibleSet of the policies
        """
        face = feasible_set.face(weights, gradient, NEAR)
        found, listed, ends = face.move, face.listed, face.ends
        g = np.empty((len(listed), 1))
        _on_face(gradient.reshape(-1, 1), listed, ends, g)
        found.reshape(-1)[listed] += self._step(g[:, 0], listed, ends)
        return found

    def _step(self, g: np.ndarray, listed: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """-B^-1 g on the plane of the face; a gradient step where no pair helps."""
        m = len(self._order)
        if m and len(g):
            W = np.empty((len(g), 2 * m))
            _on_face(self._pairs, listed, ends, W)
            inner = W.T @ W
            diagonal = np.diagonal(inner).copy()
            curvature = np.diagonal(inner, 1)[::2]  # s'y on the face
            useful = curvature > CURVATURE * np.sqrt(diagonal[0::2] * diagonal[1::2])
            newest = next((slot for slot in reversed(self._order) if useful[slot]), None)
            if newest is not None:
                gamma = diagonal[2 * newest + 1] / curvature[newest]
                # K - W'W / gamma in the units in which gamma S'S and D have a diagonal of ones
                whole = np.diagonal(self._SY)[:m]
                units = np.empty(2 * m)
                units[0::2] = np.sqrt(gamma / np.diagonal(self._SS)[:m])
                units[1::2] = 1.0 / np.sqrt(whole)
                older = self._SY[:m, :m] * self._younger[:m, :m]
                inner *= -1.0
                inner[0::2, 0::2] += self._SS[:m, :m]
                inner[0::2, 1::2] += older
                inner[1::2, 0::2] += older.T
                inner.flat[2 * m + 1 :: 4 * m + 2] -= gamma * whole
                inner *= units[:, None] * (units / gamma)
                try:
                    z = np.linalg.solve(inner, units * (g @ W))
                except np.linalg.LinAlgError:
                    z = np.full(2 * m, np.nan)
                step = -(g + W @ (units * z) / gamma) / gamma
                if step @ g < 0.0:
                    return step
        largest = np.max(np.abs(g), initial=0.0)
        return -g * (self.first_length / largest) if largest > 0.0 else -g

"""The matrices of a recursion as square roots, and the same moved by units in the last place: for certified.py."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from occontrol.numerics.linalg import square_root
from occontrol.scheduling.recursion import Recursion

EXPONENT = 4.0  # digits, in units of the last place, that F loses for each e by which it stretches
ULP = np.finfo(float).eps


@dataclass(frozen=True, eq=False)
class Roots:
    """A Recursion as square roots.

    Parameters
    ----------
    recursion : Recursion
    initial : (n, n) X with X X' the covariance at the start
    transition : (U, n, n);  noise : (U, n, n) roots of Q
    rows : (S, r, n)
    terminal : (n, n) V with V' V = W
    running, negative : (V, n, n) with R = running' running - negative' negative; the second is empty unless R is
        slightly below zero
    doubt : (U, 1, 1) units in the last place by which F and Q may be off
    """

    recursion: Recursion
    initial: np.ndarray
    transition: np.ndarray
    noise: np.ndarray
    rows: np.ndarray
    terminal: np.ndarray
    running: np.ndarray
    negative: np.ndarray
    doubt: np.ndarray

    @classmethod
    def of(cls, recursion: Recursion) -> Roots:
        """The roots of a recursion's matrices."""
        r = recursion
        return cls._taken(r, r.initial, r.transition, r.noise, r.rows, r.terminal, r.running, _doubt(r.transition))

    @classmethod
    def _taken(cls, recursion: Recursion, initial, transition, noise, rows, terminal, running, doubt) -> Roots:
        """The roots of these matrices in place of the recursion's own."""
        above = below = np.zeros((0, *initial.shape))
        if len(running):
            above, below = (_turned(square_root(part)) for part in _signed(running))
        return cls(
            recursion, square_root(initial), transition, square_root(noise), rows, _turned(square_root(terminal)),
            above, below if np.any(below) else below[:0], doubt,
        )  # fmt: skip

    def moved(self, rng: np.random.Generator) -> Roots:
        """The same of matrices with every number moved by a unit in the last place or none; the first root is turned.

        The matrices are moved, not their roots: a small eigenvalue beside a large one is known less well than its root.
        """
        r, d = self.recursion, self.doubt

        def nudged(matrix: np.ndarray, units: np.ndarray | float = 1.0) -> np.ndarray:
            return matrix * (1.0 + ULP * units * rng.integers(-1, 2, size=matrix.shape))

        def symmetric(matrix: np.ndarray, units: np.ndarray | float = 1.0) -> np.ndarray:
            upper = np.triu(nudged(matrix, units))
            return upper + np.swapaxes(np.triu(upper, 1), -1, -2)

        found = self._taken(
            r, symmetric(r.initial), nudged(r.transition, d), symmetric(r.noise, d), nudged(r.rows),
            symmetric(r.terminal), symmetric(r.running), d,
        )  # fmt: skip
        return replace(found, initial=found.initial @ np.linalg.qr(rng.standard_normal(r.initial.shape))[0])


def _signed(matrices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positive semidefinite P and N (V, n, n) with matrices = P - N; N is zero but for what counts below zero."""
    values, vectors = np.linalg.eigh(matrices)
    below = np.where(values < -64 * ULP * np.max(np.abs(values), axis=1, keepdims=True), -values, 0.0)
    if not np.any(below):
        return matrices, np.zeros_like(matrices)
    negative = (vectors * below[:, None, :]) @ np.swapaxes(vectors, 1, 2)
    return matrices + negative, negative


def _doubt(transition: np.ndarray) -> np.ndarray:
    """1 + EXPONENT |log of a stretch of F|, (U, 1, 1)."""
    stretch = np.linalg.svd(transition, compute_uv=False)
    with np.errstate(divide="ignore"):
        logs = np.abs(np.log(stretch[:, [0, -1]]))
    return (1.0 + EXPONENT * np.max(np.minimum(logs, 100.0), axis=1))[:, None, None]


def _turned(matrices: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(np.swapaxes(matrices, -1, -2))

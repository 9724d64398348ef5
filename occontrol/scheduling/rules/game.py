"""The best mixture for the largest of some linear functions: a matrix game, by the simplex method.

    theta = min over shares lam of max over i of (A lam)_i = max over weights mu of min over p of (mu A)_p

With B = A + constant > 0 it is  max sum x  s.t.  B x <= 1, x >= 0, so that x = 0 is where the method begins
(Dantzig 1951); lam = x / sum x, and mu are the duals. Rounding may leave both a little off the best: they are used to
propose, and what they propose is proven by other means.
"""

from __future__ import annotations

import numpy as np
from numba import njit

SMALL = 1e-11
DEGENERATE = 40  # pivots without gain after which the first column, and not the best, is taken


@njit(cache=True, nogil=True)
def _simplex(T, basis, most):
    """Pivots of a tableau T (I+1, I+P+1) whose last row holds the negative gains, the last column the right sides."""
    end, last = T.shape[0] - 1, T.shape[1] - 1
    idle = 0
    for _ in range(most):
        enter = -1
        least = -SMALL
        for c in range(last):
            if T[end, c] < least:
                enter = c
                if idle > DEGENERATE:
                    break
                least = T[end, c]
        if enter < 0:
            return True
        leave, ratio = -1, np.inf
        for i in range(end):
            if T[i, enter] > SMALL:
                x = T[i, last] / T[i, enter]
                if x < ratio - 1e-15 or (x <= ratio + 1e-15 and leave >= 0 and basis[i] < basis[leave]):
                    ratio, leave = x, i
        if leave < 0:
            return False
        idle = idle + 1 if ratio <= 1e-15 else 0
        pivot = T[leave, enter]
        for c in range(last + 1):
            T[leave, c] /= pivot
        for i in range(end + 1):
            x = T[i, enter]
            if i != leave and x != 0.0:
                for c in range(last + 1):
                    T[i, c] -= x * T[leave, c]
        basis[leave] = enter
    return False


def play(A: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Shares (P,), weights (I,) and theta.

    Parameters
    ----------
    A : (I, P) value of every linear function at every column
    """
    count, columns = A.shape
    low, high = float(np.min(A)), float(np.max(A))
    scale = max(high - low, 1e-300)
    T = np.zeros((count + 1, count + columns + 1))
    T[:count, :columns] = (A - low) / scale + 0.1
    T[:count, columns:-1] = np.eye(count)
    T[:count, -1] = 1.0
    T[count, :columns] = -1.0
    basis = columns + np.arange(count)
    _simplex(T, basis, 50 * (count + columns))
    shares = np.zeros(columns)
    inside = basis < columns
    shares[basis[inside]] = np.maximum(T[:count, -1][inside], 0.0)
    weights = np.maximum(T[count, columns:-1], 0.0)
    total, dual = float(np.sum(shares)), float(np.sum(weights))
    if total <= 0 or dual <= 0:
        return np.full(columns, 1.0 / columns), np.full(count, 1.0 / count), low
    shares, weights = shares / total, weights / dual
    return shares, weights, float(np.max(A @ shares))

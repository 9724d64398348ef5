"""The front of a set of symmetric matrices in the positive semidefinite order: which of them no other one is below.

A compiled pairwise test with early exits: a diagonal look first, then a Cholesky factorisation that stops at the first
pivot that is not positive.
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def _below(a, b, factor, slack, work):  # pragma: no cover - compiled
    """Whether a <= factor b + slack diag(b)."""
    n = a.shape[0]
    for i in range(n):
        if (factor + slack) * b[i, i] - a[i, i] < 0.0:
            return False
    for j in range(n):
        for i in range(j, n):
            s = factor * b[i, j] - a[i, j]
            if i == j:
                s += slack * b[i, i]
            for k in range(j):
                s -= work[i, k] * work[j, k]
            if i == j:
                if s <= 0.0:
                    return False
                work[j, j] = np.sqrt(s)
            else:
                work[i, j] = s / work[j, j]
    return True


@njit(cache=True, nogil=True)
def _front(matrices, factor, slack, reach, owner):  # pragma: no cover - compiled
    count, n = matrices.shape[0], matrices.shape[1]
    kept = np.empty(count, dtype=np.int64)
    work = np.empty((n, n))
    size = 0
    for b in range(count):
        found = -1
        for position in range(min(size, reach)):
            a = kept[position]
            if _below(matrices[a], matrices[b], factor, slack, work):
                found = a
                if position > 0:
                    # a matrix that is below many should be asked early
                    kept[position] = kept[position - 1]
                    kept[position - 1] = a
                break
        owner[b] = b if found < 0 else found
        if found < 0:
            kept[size] = b
            size += 1
    return size


def front(matrices: np.ndarray, factor: float = 1.0, slack: float = 1e-13, reach: int = 400) -> np.ndarray:
    """Who stands for whom.

    Parameters
    ----------
    matrices : (R, n, n) symmetric positive definite, the most promising first
    factor : a matrix a may stand for b when a <= factor b, in the positive semidefinite order
    slack : rounding that is forgiven, relative to every diagonal entry
    reach : each matrix is compared with so many kept ones at most, those first that stand for many

    Returns owner (R,): the index of the kept matrix that stands for each, its own index where it is kept.
    """
    matrices = np.ascontiguousarray(matrices)
    owner = np.empty(len(matrices), dtype=np.int64)
    _front(matrices, float(factor), float(slack), int(reach), owner)
    return owner

"""Eigenvalues of small symmetric matrices by Jacobi's rotations, for compiled loops."""

from __future__ import annotations

import numpy as np
from numba import njit

_SWEEPS = 40  # six are usual
_SMALL = 1e-34  # of the squares: what lies off the diagonal is then rounding


@njit(cache=True, nogil=True)
def diagonalise(A, V, n):
    """A[:n, :n], symmetric: its eigenvalues on the diagonal, in place; V[:n, :n] <- its eigenvectors, by column."""
    for i in range(n):
        for j in range(n):
            V[i, j] = 1.0 if i == j else 0.0
    for _ in range(_SWEEPS):
        off, total = 0.0, 0.0
        for i in range(n):
            total += A[i, i] * A[i, i]
            for j in range(i):
                off += A[i, j] * A[i, j]
        if off <= _SMALL * (total + off):
            return
        for p in range(n - 1):
            for q in range(p + 1, n):
                if A[p, q] == 0.0:
                    continue
                theta = 0.5 * (A[q, q] - A[p, p]) / A[p, q]
                t = (1.0 if theta >= 0.0 else -1.0) / (abs(theta) + np.sqrt(theta * theta + 1.0))
                c = 1.0 / np.sqrt(t * t + 1.0)
                s = t * c
                for i in range(n):
                    x, y = A[i, p], A[i, q]
                    A[i, p], A[i, q] = c * x - s * y, s * x + c * y
                for i in range(n):
                    x, y = A[p, i], A[q, i]
                    A[p, i], A[q, i] = c * x - s * y, s * x + c * y
                for i in range(n):
                    x, y = V[i, p], V[i, q]
                    V[i, p], V[i, q] = c * x - s * y, s * x + c * y

"""Covariances that lie below two others: for labels that are merged."""

from __future__ import annotations

import numpy as np
from numba import njit

from occontrol.numerics.jacobi import diagonalise
from occontrol.scheduling.whole.kernels import OPTIONS


@njit(**OPTIONS)
def _positive(at, n, X, E):
    """Whether the block that begins at X[at], packed, is positive semidefinite; E (n, n) work space."""
    i = at
    for r in range(n):
        for c in range(r + 1):
            E[r, c] = X[i]
            i += 1
    for k in range(n):
        if E[k, k] < 0.0:
            return False
        for r in range(k + 1, n):
            if E[k, k] == 0.0:
                if E[r, k] != 0.0:
                    return False
                continue
            f = E[r, k] / E[k, k]
            for c in range(k + 1, r + 1):
                E[r, c] -= f * E[c, k]
    return True


@njit(**OPTIONS)
def above(sizes, A, B, X, E):
    """Whether A >= B, block by block; packed (D,), X (D,) and E (n, n) work space."""
    for i in range(len(A)):
        X[i] = A[i] - B[i]
    at = 0
    for b in range(len(sizes)):
        n = sizes[b, 0]
        if not _positive(at, n, X, E):
            return False
        at += n * (n + 1) // 2
    return True


@njit(**OPTIONS)
def _part(n, E, U, scale, at, A):
    """A[at:] <- A - D E+ D for E (n, n), D = diag(scale): E+ has its positive eigenvalues, by Jacobi's rotations."""
    diagonalise(E, U, n)
    at_ = at
    for i in range(n):
        for j in range(i + 1):
            x = 0.0
            for k in range(n):
                if E[k, k] > 0.0:
                    x += E[k, k] * U[i, k] * U[j, k]
            A[at_] -= scale[i] * x * scale[j]
            at_ += 1


@njit(**OPTIONS)
def meet(sizes, A, B, lowest, factor, X, E, U, scale):
    """A <- factor times a covariance below A and B, A - (A - B)+ in the scale of A; `lowest` where it is not definite.

    Packed (D,); X (D,), E, U (n, n) and scale (n,) work space. `lowest` lies below both.
    """
    at = 0
    for b in range(len(sizes)):
        n = sizes[b, 0]
        i = at
        for r in range(n):
            scale[r] = np.sqrt(max(A[at + r * (r + 1) // 2 + r], 1e-300))
        for r in range(n):
            for c in range(r + 1):
                E[r, c] = E[c, r] = (A[i] - B[i]) / (scale[r] * scale[c])
                i += 1
        _part(n, E, U, scale, at, A)
        for i in range(at, at + n * (n + 1) // 2):
            A[i] *= factor
        if not _positive(at, n, A, E):
            for i in range(at, at + n * (n + 1) // 2):
                A[i] = lowest[i]
        at += n * (n + 1) // 2
    for i in range(len(A)):
        X[i] = A[i]

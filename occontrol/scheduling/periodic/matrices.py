"""Small dense matrices in compiled loops: LAPACK's calls take numba many seconds to compile, and more time to call."""

from __future__ import annotations

import numpy as np
from numba import njit

from occontrol.numerics.jacobi import diagonalise

OPTIONS = {"cache": True, "nogil": True}


@njit(**OPTIONS)
def product(A, B):
    """A B for A (n, m) and B (m, k)."""
    n, m, k = A.shape[0], A.shape[1], B.shape[1]
    C = np.zeros((n, k))
    for i in range(n):
        for p in range(m):
            a = A[i, p]
            for j in range(k):
                C[i, j] += a * B[p, j]
    return C


@njit(**OPTIONS)
def left(A, B):
    """A' B for A (m, n) and B (m, k)."""
    m, n, k = A.shape[0], A.shape[1], B.shape[1]
    C = np.zeros((n, k))
    for p in range(m):
        for i in range(n):
            a = A[p, i]
            for j in range(k):
                C[i, j] += a * B[p, j]
    return C


@njit(**OPTIONS)
def right(A, B):
    """A B' for A (n, m) and B (k, m)."""
    n, m, k = A.shape[0], A.shape[1], B.shape[0]
    C = np.zeros((n, k))
    for i in range(n):
        for j in range(k):
            x = 0.0
            for p in range(m):
                x += A[i, p] * B[j, p]
            C[i, j] = x
    return C


@njit(**OPTIONS)
def inner(A, B):
    """tr(A' B) of two (n, m)."""
    x = 0.0
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            x += A[i, j] * B[i, j]
    return x


@njit(**OPTIONS)
def trace(A):
    """The sum of the diagonal of A (n, n)."""
    x = 0.0
    for i in range(A.shape[0]):
        x += A[i, i]
    return x


@njit(**OPTIONS)
def even(A):
    """Make A (n, n) symmetric in its place: (A + A')/2."""
    for i in range(A.shape[0]):
        for j in range(i):
            x = 0.5 * (A[i, j] + A[j, i])
            A[i, j] = x
            A[j, i] = x
    return A


@njit(**OPTIONS)
def plus_identity(A):
    """Add 1 to the diagonal of A (n, n) in its place."""
    for i in range(A.shape[0]):
        A[i, i] += 1.0
    return A


@njit(**OPTIONS)
def solve(A, B):
    """A^-1 B for A (n, n) and B (n, k): elimination with partial pivoting; A is overwritten. A zero pivot gives inf."""
    n, k = B.shape
    X = B.copy()
    for c in range(n):
        p = c
        for i in range(c + 1, n):
            if abs(A[i, c]) > abs(A[p, c]):
                p = i
        if p != c:
            for j in range(c, n):
                A[c, j], A[p, j] = A[p, j], A[c, j]
            for j in range(k):
                X[c, j], X[p, j] = X[p, j], X[c, j]
        d = A[c, c]
        if d == 0.0:
            X[:] = np.inf
            return X
        for i in range(c + 1, n):
            f = A[i, c] / d
            if f != 0.0:
                for j in range(c + 1, n):
                    A[i, j] -= f * A[c, j]
                for j in range(k):
                    X[i, j] -= f * X[c, j]
    for c in range(n - 1, -1, -1):
        for i in range(c + 1, n):
            f = A[c, i]
            for j in range(k):
                X[c, j] -= f * X[i, j]
        d = A[c, c]
        for j in range(k):
            X[c, j] /= d
    return X


@njit(**OPTIONS)
def eigen(S, V):
    """Eigenvalues (n,) of a symmetric S (n, n); fills V (n, n) with the eigenvectors."""
    n = S.shape[0]
    A = S.copy()
    diagonalise(A, V, n)
    values = np.empty(n)
    for i in range(n):
        values[i] = A[i, i]
    return values

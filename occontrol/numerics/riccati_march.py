"""The steps of a square root of the covariance in compiled loops, for few states: `march` of riccati_flow.py."""

from __future__ import annotations

import numpy as np
from numba import njit

from occontrol.numerics.loops import ENTRY

_OPTIONS = {"cache": True, "nogil": True, "error_model": "numpy", **ENTRY}


@njit(**_OPTIONS)
def _triangle(A, tau):
    """Householder's QR of A (m, n), m >= n, in place: R above, the reflections below the diagonal; tau (n,) of them."""
    m, n = A.shape
    for j in range(n):
        size = 0.0
        for i in range(j, m):
            x = abs(A[i, j])
            size = x if x > size else size
        below = 0.0
        for i in range(j + 1, m):
            x = abs(A[i, j])
            below = x if x > below else below
        tau[j] = 0.0
        if below == 0.0:
            continue
        total = 0.0
        for i in range(j, m):
            total += (A[i, j] / size) ** 2
        beta = -size * np.sqrt(total) if A[j, j] >= 0.0 else size * np.sqrt(total)
        tau[j] = (beta - A[j, j]) / beta
        away = A[j, j] - beta
        for i in range(j + 1, m):
            A[i, j] /= away
        A[j, j] = beta
        for c in range(j + 1, n):
            s = A[j, c]
            for i in range(j + 1, m):
                s += A[i, j] * A[i, c]
            s *= tau[j]
            A[j, c] -= s
            for i in range(j + 1, m):
                A[i, c] -= s * A[i, j]


@njit(**_OPTIONS, inline="always")
def _orthogonal(A, tau, Q):
    """Q (m, n) <- the first n columns of the product of the reflections that `_triangle` left in A (m, n)."""
    m, n = A.shape
    for i in range(m):
        for j in range(n):
            Q[i, j] = 1.0 if i == j else 0.0
    for j in range(n - 1, -1, -1):
        for c in range(j, n):
            s = Q[j, c]
            for i in range(j + 1, m):
                s += A[i, j] * Q[i, c]
            s *= tau[j]
            Q[j, c] -= s
            for i in range(j + 1, m):
                Q[i, c] -= s * A[i, j]


@njit(**_OPTIONS)
def march_small(F, gamma, driven, S, E, reduced, tall, stacked, Q, tau):
    """S (k+1, n, n), from S[0] on, E and reduced (k, n, n) of the steps F, gamma, driven (k, n, n), see `march`.

    tall = [I; Gamma S] = Q_1 U,  reduced = U^-T S',  [reduced F'; driven] = Q_2 S+',  E = U^-1 Q_2[:n]
    tall, stacked, Q (2 n, n) and tau (n,) are work space.
    """
    count, n = F.shape[0], F.shape[1]
    for k in range(count):
        for i in range(n):
            for j in range(n):
                tall[i, j] = 1.0 if i == j else 0.0
                s = 0.0
                for m in range(n):
                    s += gamma[k, i, m] * S[k, m, j]
                tall[n + i, j] = s
        _triangle(tall, tau)
        for c in range(n):  # U' x = column c of S'
            for i in range(n):
                s = S[k, c, i]
                for m in range(i):
                    s -= tall[m, i] * reduced[k, m, c]
                reduced[k, i, c] = s / tall[i, i]
        for i in range(n):
            for j in range(n):
                s = 0.0
                for m in range(n):
                    s += reduced[k, i, m] * F[k, j, m]
                stacked[i, j] = s
                stacked[n + i, j] = driven[k, i, j]
        _triangle(stacked, tau)
        for i in range(n):
            for j in range(n):
                S[k + 1, i, j] = stacked[j, i] if j <= i else 0.0
        _orthogonal(stacked, tau, Q)
        for c in range(n):  # U x = column c of Q
            for i in range(n - 1, -1, -1):
                s = Q[i, c]
                for m in range(i + 1, n):
                    s -= tall[i, m] * E[k, m, c]
                E[k, i, c] = s / tall[i, i]

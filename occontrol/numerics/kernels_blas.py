"""The sweeps of numerics/kernels.py for many states: products by BLAS, active rows in blocks; nothing padded.

F S F' + Q is symmetric: its second product is done for panels of about PANEL rows, each only as far as the diagonal.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from occontrol.numerics.kernels import CANCEL, trace_product
from occontrol.numerics.vectors import OPTIONS

BLOCK = 32
PANEL = 48
TILE = 8


@njit(**OPTIONS)
def _symmetrise(S, n):
    for i in range(n):
        for j in range(i):
            mean = 0.5 * (S[i, j] + S[j, i])
            S[i, j] = mean
            S[j, i] = mean


@njit(**OPTIONS)
def _cholesky_solve(A, B, count, n):
    """B <- L^-1 B for the (count, count) matrix A = L L'; A is overwritten by L."""
    for j in range(count):
        d = A[j, j]
        for m in range(j):
            d -= A[j, m] * A[j, m]
        d = np.sqrt(d)
        A[j, j] = d
        for i in range(j + 1, count):
            s = A[i, j]
            for m in range(j):
                s -= A[i, m] * A[j, m]
            A[i, j] = s / d
    for i in range(count):
        for m in range(i):
            x = A[i, m]
            for j in range(n):
                B[i, j] -= x * B[m, j]
        x = 1.0 / A[i, i]
        for j in range(n):
            B[i, j] *= x


@njit(**OPTIONS)
def _subtract(S, D, count, n):
    """S <- S - D'D for the first `count` rows of D, four at a time; exactly symmetric."""
    r = 0
    while r < count:
        d0 = D[r]
        if r + 4 <= count:
            d1, d2, d3 = D[r + 1], D[r + 2], D[r + 3]
            for i in range(n):
                x0, x1, x2, x3 = d0[i], d1[i], d2[i], d3[i]
                for j in range(n):
                    S[i, j] -= x0 * d0[j] + x1 * d1[j] + x2 * d2[j] + x3 * d3[j]
            r += 4
        else:
            for i in range(n):
                x0 = d0[i]
                for j in range(n):
                    S[i, j] -= x0 * d0[j]
            r += 1


@njit(**OPTIONS)
def _update_block(S, C, B, D, T, count, n):
    """All `count` rows of C (already times sqrt(w)) at once: S <- S - B'(I + C B')^-1 B with B = C S."""
    c, b, d = C[:count], B[:count], D[:count]
    np.dot(c, S, b)
    inner = np.empty((count, count))
    largest = 0.0
    for i in range(count):
        for j in range(i + 1):
            s = 0.0
            for m in range(n):
                s += c[i, m] * b[j, m]
            inner[i, j] = s
            inner[j, i] = s
        largest = max(largest, inner[i, i])
        inner[i, i] += 1.0
    d[:, :] = b
    _cholesky_solve(inner, d, count, n)
    _subtract(S, d, count, n)
    if largest < CANCEL:
        return
    # S now holds (I - kC) S; the Joseph form multiplies by (I - kC)' and adds kk', k = B'(I + C B')^-1
    for i in range(count - 1, -1, -1):
        x = 1.0 / inner[i, i]
        for j in range(n):
            d[i, j] *= x
        for m in range(i):
            x = inner[i, m]
            for j in range(n):
                d[m, j] -= x * d[i, j]
    np.dot(c, S.T, b)  # rows: ((I - kC) S c)'
    for i in range(count):
        for j in range(n):
            b[i, j] = d[i, j] - b[i, j]
    np.dot(b.T, d, T)
    for i in range(n):
        for j in range(n):
            S[i, j] += T[i, j]
    _symmetrise(S, n)


@njit(**OPTIONS)
def _predict(X, f, q, T, S, panel, n):
    """S <- F X F' + Q, S symmetric; T (n, n) and panel (2 PANEL n,) are work space. S may be X."""
    np.dot(f, X, T)
    tall = -(-n // max(1, (n + PANEL // 2) // PANEL))
    for i0 in range(0, n, tall):
        i1 = min(i0 + tall, n)
        part = panel[: (i1 - i0) * i1].reshape(i1 - i0, i1)
        np.dot(T[i0:i1], f[:i1].T, part)
        for i in range(i0, i1):
            for j in range(i + 1):
                S[i, j] = part[i - i0, j] + q[i, j]
    # the upper triangle, by tiles that stay in the first cache
    for i0 in range(0, n, TILE):
        for j0 in range(0, i0 + 1, TILE):
            for i in range(i0, min(i0 + TILE, n)):
                for j in range(j0, min(j0 + TILE, i)):
                    S[j, i] = S[i, j]


@njit(**OPTIONS)
def forward_large(k0, k1, S, T, F, Q, predict, rows, row_set, offsets, steps, v, R, running_set, kept, panel, C, B, D):
    """forward_small for many states; S, T (n, n), kept (K, n, n), panel (2 PANEL n,), C, B, D (BLOCK, n)."""
    n = S.shape[0]
    M = offsets.shape[0] - 1
    keep = kept.shape[0] > 0
    running = R.shape[0] > 0
    total = 0.0
    last = X = S
    for k in range(k0, k1):
        if keep:
            X = kept[k - k0]
        _predict(last, F[predict[k]], Q[predict[k]], T, X, panel, n)
        h = steps[k]
        if running:
            total += 0.5 * h * trace_product(R[running_set[k]], X, n)
        c = rows[row_set[k]]
        count = 0
        for j in range(M):
            w = h * v[k, j]
            if w > 0.0:
                x = np.sqrt(w)
                for r in range(offsets[j], offsets[j + 1]):
                    for i in range(n):
                        C[count, i] = x * c[r, i]
                    count += 1
                    if count == BLOCK:
                        _update_block(X, C, B, D, T, count, n)
                        count = 0
        if count > 0:
            _update_block(X, C, B, D, T, count, n)
        if running:
            total += 0.5 * h * trace_product(R[running_set[k]], X, n)
        last = X
    if keep and k1 > k0:
        S[:, :] = kept[k1 - 1 - k0]
    return total


@njit(**OPTIONS)
def backward_large(k0, k1, V, U, F, predict, rows, row_set, offsets, steps, v, upper, cost, kept, gradient, c, work, G):
    """backward_small for many states; c (r, n) gathers the rows of available sensors, work (r, p) holds C U'."""
    remember = G.shape[0] > 0
    p, n = V.shape
    M = offsets.shape[0] - 1
    for k in range(k1 - 1, k0 - 1, -1):
        np.dot(V, kept[k - k0], U)
        h = steps[k]
        count = 0
        for j in range(M):
            if upper[k, j] > 0.0:
                count += offsets[j + 1] - offsets[j]
        if count == rows.shape[1]:
            np.dot(rows[row_set[k]], U.T, work)
        elif count > 0:
            count = 0
            for j in range(M):
                if upper[k, j] > 0.0:
                    for r in range(offsets[j], offsets[j + 1]):
                        c[count, :] = rows[row_set[k], r]
                        count += 1
            np.dot(c[:count], U.T, work[:count])
        count = 0
        for j in range(M):
            gradient[k, j] = cost[k, j]
            if upper[k, j] > 0.0:
                total = 0.0
                w = h * v[k, j]
                for r in range(offsets[j], offsets[j + 1]):
                    for a in range(p):
                        total += work[count, a] * work[count, a]
                        if remember:
                            G[k, r, a] = work[count, a]
                    if w > 0.0:
                        for a in range(p):
                            x = w * work[count, a]
                            for i in range(n):
                                V[a, i] -= x * rows[row_set[k], r, i]
                    count += 1
                gradient[k, j] -= h * total
        np.dot(V, F[predict[k]], U)
        V[:, :] = U


@njit(**OPTIONS)
def backward_large_dense(
    k0, k1, P, T, F, predict, rows, row_set, offsets, steps, v, upper, cost, R, running_set, kept, gradient, Y, Z
):
    """backward_small_dense for large n; Y, Z (r, n) hold C S+ and C S+ P."""
    n = P.shape[0]
    M = offsets.shape[0] - 1
    for k in range(k1 - 1, k0 - 1, -1):
        S = kept[k - k0]
        c = rows[row_set[k]]
        h = steps[k]
        weight = R[running_set[k]]
        for i in range(n):
            for j in range(n):
                P[i, j] += 0.5 * h * weight[i, j]
        np.dot(c, S, Y)
        np.dot(Y, P, Z)
        for j in range(M):
            total = 0.0
            w = h * v[k, j]
            for r in range(offsets[j], offsets[j + 1]):
                for i in range(n):
                    total += Y[r, i] * Z[r, i]
                if w > 0.0:
                    for i in range(n):
                        x = w * Z[r, i]
                        for m in range(n):
                            P[i, m] -= x * c[r, m]
            gradient[k, j] = cost[k, j] - (h * total if upper[k, j] > 0.0 else 0.0)
        # P holds T = P K; Z <- Y T, then P- = T - sum w c (Y T)
        np.dot(Y, P, Z)
        for j in range(M):
            w = h * v[k, j]
            if w > 0.0:
                for r in range(offsets[j], offsets[j + 1]):
                    for i in range(n):
                        x = w * c[r, i]
                        for m in range(n):
                            P[i, m] -= x * Z[r, m]
        for i in range(n):
            for m in range(n):
                P[i, m] += 0.5 * h * weight[i, m]
        f = F[predict[k]]
        np.dot(P, f, T)
        np.dot(f.T, T, P)
        _symmetrise(P, n)

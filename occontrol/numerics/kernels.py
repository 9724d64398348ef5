"""Compiled loops of the forward and backward sweep; arrays in, arrays out, nothing allocated inside.

Unknowns of one interval k, in the order of time:
    S-  = F S F' + Q                     predict k       S: covariance after update k-1
    S+  = (S-^-1 + sum_r w_r c_r c_r')^-1   update k      c_r: scaled sensor rows, w_r = h v_j
backwards, with P = dJ/dS+ and K = I - S+ sum_r w_r c_r c_r':
    dJ/dv_j = cost_j - h sum_{r in j} c_r' S+ P S+ c_r,     P- = K' P K,     P <- F' P- F
Without a running weight P = V'V with few rows V (p, n), and V- = V K needs no n x n product at all.
Two regimes: hand-written loops ("small"), and BLAS through numpy.dot ("large").
An update whose normalised innovation exceeds CANCEL is done in Joseph's form, which keeps the digits that
S - b b' would cancel (S0 = 1e6, Theta = 1e-3).
"""

from __future__ import annotations

import numpy as np
from numba import njit

CANCEL = 100.0
BLOCK = 32
_OPTIONS = {"cache": True, "nogil": True, "fastmath": {"contract", "nsz", "nnan"}, "error_model": "numpy"}


@njit(**_OPTIONS)
def _trace_product(a, b, n):
    total = 0.0
    for i in range(n):
        for j in range(n):
            total += a[i, j] * b[i, j]
    return total


@njit(**_OPTIONS)
def _update_row(S, c, w, b, n):
    """One scalar measurement with row c and information w, in place; b is a work vector."""
    innovation = 0.0
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += S[i, j] * c[j]
        b[i] = total
        innovation += total * c[i]
    innovation *= w
    if innovation < CANCEL:
        scale = np.sqrt(w / (1.0 + innovation))
        for i in range(n):
            b[i] *= scale
        for i in range(n):
            x = b[i]
            for j in range(n):
                S[i, j] -= x * b[j]
        return
    gain = w / (1.0 + innovation)
    for i in range(n):
        x = gain * b[i]
        for j in range(n):
            S[i, j] -= x * b[j]
    # second factor of (I - kc')S(I - kc')' + kk'/w, with k = gain b
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += S[i, j] * c[j]
        x = total
        for j in range(n):
            S[i, j] += gain * b[j] * (gain * b[i] / w - x)
    for i in range(n):
        for j in range(i):
            mean = 0.5 * (S[i, j] + S[j, i])
            S[i, j] = mean
            S[j, i] = mean


@njit(**_OPTIONS)
def forward_small(k0, k1, S, T, F, FT, Q, predict, rows, row_set, offsets, steps, v, R, running_set, store, b):
    """Predicts and updates k0..k1-1 in place on S; returns the running cost. store[k-k0] = S+ unless it is empty."""
    n = S.shape[0]
    M = offsets.shape[0] - 1
    keep = store.shape[0] > 0
    running = R.shape[0] > 0
    total = 0.0
    for k in range(k0, k1):
        f, ft, q = F[predict[k]], FT[predict[k]], Q[predict[k]]
        for i in range(n):
            for j in range(n):
                T[i, j] = 0.0
            for m in range(n):
                x = f[i, m]
                if x != 0.0:
                    for j in range(n):
                        T[i, j] += x * S[m, j]
        for i in range(n):
            for j in range(n):
                S[i, j] = q[i, j]
            for m in range(n):
                x = T[i, m]
                for j in range(n):
                    S[i, j] += x * ft[m, j]
        for i in range(n):
            for j in range(i):
                mean = 0.5 * (S[i, j] + S[j, i])
                S[i, j] = mean
                S[j, i] = mean
        h = steps[k]
        if running:
            total += 0.5 * h * _trace_product(R[running_set[k]], S, n)
        c = rows[row_set[k]]
        for j in range(M):
            w = h * v[k, j]
            if w > 0.0:
                for r in range(offsets[j], offsets[j + 1]):
                    _update_row(S, c[r], w, b, n)
        if running:
            total += 0.5 * h * _trace_product(R[running_set[k]], S, n)
        if keep:
            store[k - k0, :, :] = S
    return total


@njit(**_OPTIONS)
def backward_small(k0, k1, V, U, F, predict, rows, row_set, offsets, steps, v, upper, cost, store, gradient, T, G):
    """Rows k1-1..k0 of the gradient without a running weight; V (p, n) with P = V'V is changed in place.

    G (N, r, p), unless empty, receives c_r'x with x = S+ V' (what numerics/exchange.py starts from).
    """
    remember = G.shape[0] > 0
    p, n = V.shape
    M = offsets.shape[0] - 1
    for k in range(k1 - 1, k0 - 1, -1):
        S = store[k - k0]
        for a in range(p):
            for j in range(n):
                U[a, j] = 0.0
            for i in range(n):
                x = V[a, i]
                for j in range(n):
                    U[a, j] += x * S[i, j]
        c = rows[row_set[k]]
        h = steps[k]
        for j in range(M):
            gradient[k, j] = cost[k, j]
            if upper[k, j] > 0.0:
                w = h * v[k, j]
                total = 0.0
                for r in range(offsets[j], offsets[j + 1]):
                    for a in range(p):
                        d = 0.0
                        for i in range(n):
                            d += c[r, i] * U[a, i]
                        total += d * d
                        if remember:
                            G[k, r, a] = d
                        if w > 0.0:
                            d *= w
                            for i in range(n):
                                V[a, i] -= d * c[r, i]
                gradient[k, j] -= h * total
        f = F[predict[k]]
        for a in range(p):
            for j in range(n):
                T[a, j] = 0.0
            for i in range(n):
                x = V[a, i]
                for j in range(n):
                    T[a, j] += x * f[i, j]
            for j in range(n):
                V[a, j] = T[a, j]


@njit(**_OPTIONS)
def backward_small_dense(
    k0, k1, P, T, F, FT, predict, rows, row_set, offsets, steps, v, upper, cost, R, running_set, store, gradient, y, z
):
    """As backward_small, with a full costate P (n, n) and a running weight."""
    n = P.shape[0]
    M = offsets.shape[0] - 1
    for k in range(k1 - 1, k0 - 1, -1):
        S = store[k - k0]
        c = rows[row_set[k]]
        h = steps[k]
        weight = R[running_set[k]]
        for i in range(n):
            for j in range(n):
                P[i, j] += 0.5 * h * weight[i, j]
                T[i, j] = P[i, j]
        for j in range(M):
            gradient[k, j] = cost[k, j]
            if upper[k, j] > 0.0:
                w = h * v[k, j]
                total = 0.0
                for r in range(offsets[j], offsets[j + 1]):
                    for i in range(n):
                        s = 0.0
                        for m in range(n):
                            s += S[i, m] * c[r, m]
                        y[i] = s
                    for i in range(n):
                        s = 0.0
                        for m in range(n):
                            s += P[i, m] * y[m]
                        z[i] = s
                        total += s * y[i]
                    if w > 0.0:
                        for i in range(n):
                            x = w * z[i]
                            for m in range(n):
                                T[i, m] -= x * c[r, m]
                gradient[k, j] -= h * total
        # T = P K; now P- = K'T, K = I - S+ sum w c c'
        for i in range(n):
            for m in range(n):
                P[i, m] = T[i, m]
        for j in range(M):
            w = h * v[k, j]
            if w > 0.0:
                for r in range(offsets[j], offsets[j + 1]):
                    for i in range(n):
                        s = 0.0
                        for m in range(n):
                            s += S[i, m] * c[r, m]
                        y[i] = s
                        z[i] = 0.0
                    for i in range(n):
                        x = y[i]
                        for m in range(n):
                            z[m] += x * T[i, m]
                    for i in range(n):
                        x = w * c[r, i]
                        for m in range(n):
                            P[i, m] -= x * z[m]
        for i in range(n):
            for m in range(n):
                P[i, m] += 0.5 * h * weight[i, m]
        f, ft = F[predict[k]], FT[predict[k]]
        for i in range(n):
            for j in range(n):
                T[i, j] = 0.0
            for m in range(n):
                x = ft[i, m]
                for j in range(n):
                    T[i, j] += x * P[m, j]
        for i in range(n):
            for j in range(n):
                P[i, j] = 0.0
            for m in range(n):
                x = T[i, m]
                for j in range(n):
                    P[i, j] += x * f[m, j]
        for i in range(n):
            for j in range(i):
                mean = 0.5 * (P[i, j] + P[j, i])
                P[i, j] = mean
                P[j, i] = mean


@njit(**_OPTIONS)
def _symmetrise(S, n):
    for i in range(n):
        for j in range(i):
            mean = 0.5 * (S[i, j] + S[j, i])
            S[i, j] = mean
            S[j, i] = mean


@njit(**_OPTIONS)
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


@njit(**_OPTIONS)
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
    np.dot(d.T, d, T)
    for i in range(n):
        for j in range(n):
            S[i, j] -= T[i, j]
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


@njit(**_OPTIONS)
def forward_large(k0, k1, S, T, F, Q, predict, rows, row_set, offsets, steps, v, R, running_set, store, C, B, D):
    """forward_small for large n: products by BLAS, active rows gathered in blocks."""
    n = S.shape[0]
    M = offsets.shape[0] - 1
    keep = store.shape[0] > 0
    running = R.shape[0] > 0
    total = 0.0
    for k in range(k0, k1):
        f, q = F[predict[k]], Q[predict[k]]
        np.dot(f, S, T)
        np.dot(T, f.T, S)
        for i in range(n):
            for j in range(i + 1):
                mean = 0.5 * (S[i, j] + S[j, i]) + q[i, j]
                S[i, j] = mean
                S[j, i] = mean
        h = steps[k]
        if running:
            total += 0.5 * h * _trace_product(R[running_set[k]], S, n)
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
                        _update_block(S, C, B, D, T, count, n)
                        count = 0
        if count > 0:
            _update_block(S, C, B, D, T, count, n)
        if running:
            total += 0.5 * h * _trace_product(R[running_set[k]], S, n)
        if keep:
            store[k - k0, :, :] = S
    return total


@njit(**_OPTIONS)
def backward_large(k0, k1, V, U, F, predict, rows, row_set, offsets, steps, v, upper, cost, store, gradient, work, G):
    """backward_small for large n; work (r, p) holds C U'."""
    remember = G.shape[0] > 0
    p, n = V.shape
    M = offsets.shape[0] - 1
    for k in range(k1 - 1, k0 - 1, -1):
        np.dot(V, store[k - k0], U)
        c = rows[row_set[k]]
        h = steps[k]
        np.dot(c, U.T, work)
        if remember:
            G[k, :, :] = work
        for j in range(M):
            total = 0.0
            w = h * v[k, j]
            for r in range(offsets[j], offsets[j + 1]):
                for a in range(p):
                    total += work[r, a] * work[r, a]
                if w > 0.0:
                    for a in range(p):
                        x = w * work[r, a]
                        for i in range(n):
                            V[a, i] -= x * c[r, i]
            gradient[k, j] = cost[k, j] - (h * total if upper[k, j] > 0.0 else 0.0)
        np.dot(V, F[predict[k]], U)
        V[:, :] = U


@njit(**_OPTIONS)
def backward_large_dense(
    k0, k1, P, T, F, predict, rows, row_set, offsets, steps, v, upper, cost, R, running_set, store, gradient, Y, Z
):
    """backward_small_dense for large n; Y, Z (r, n) hold C S+ and C S+ P."""
    n = P.shape[0]
    M = offsets.shape[0] - 1
    for k in range(k1 - 1, k0 - 1, -1):
        S = store[k - k0]
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

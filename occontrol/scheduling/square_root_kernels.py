"""Compiled loops of the square-root pass: Householder reflections only, so that no digits cancel.

S = X X'. A predict and an update of one row c with information w are

    [F X, Q^1/2] = X- Z',  Z orthonormal            X+ = X- H D,   H b = -sign(b_p) |b| e_p,  b = X-' c
    g = Z_1 g-,  Z_1 the first n rows of Z          g- = H D g+,   D = 1 but for D_pp = (1 + w b'b)^-1/2

where g = X' V' carries a costate P = V' V back. H turns the measured direction into one column, which D then shortens:
a prior of 1e14 leaves no error of its own size in what has been measured. Rows and columns are taken by size, which
keeps the error of every row relative to that row.
Source: Bierman, Factorization Methods for Discrete Sequential Estimation; Cox & Higham (1998) for the order.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from occontrol.numerics.loops import ENTRY, copy_matrix

OPTIONS = {"cache": True, "nogil": True, "fastmath": {"contract", "nsz"}, "error_model": "numpy", **ENTRY}
# a part that is called at one place is compiled there: by itself it would be compiled, and then again with its caller
PART = {**OPTIONS, "inline": "always"}


@njit(**PART)
def _ordered(M, work, order):
    """order (rows,) <- the columns of M (n, rows) by falling largest entry (insertion sort); work (n, rows)."""
    n, rows = M.shape
    for r in range(rows):
        work[0, r] = 0.0
    for i in range(n):
        for r in range(rows):
            size = abs(M[i, r])
            if size > work[0, r]:
                work[0, r] = size
    for r in range(rows):
        s = r
        while s > 0 and work[0, order[s - 1]] < work[0, r]:
            order[s] = order[s - 1]
            s -= 1
        order[s] = r


@njit(**OPTIONS)
def triangle(M, work, tau, order, pivot, X):
    """X (n, n) with X X' = M M' for M (n, rows), rows >= n; `work` (n, rows) keeps the reflections.

    order (rows,), pivot (n,) and tau (n,): the order of columns, of rows, and the factors of the reflections.
    """
    n, rows = M.shape
    _ordered(M, work, order)
    for i in range(n):
        pivot[i] = i
        for r in range(rows):
            work[i, r] = M[i, order[r]]
    for j in range(n):
        best, most = j, -1.0
        for i in range(j, n):
            total = 0.0
            for r in range(j, rows):
                total += work[i, r] * work[i, r]
            if total > most:
                best, most = i, total
        if best != j:
            pivot[j], pivot[best] = pivot[best], pivot[j]
            for r in range(rows):
                work[j, r], work[best, r] = work[best, r], work[j, r]
        tau[j] = 0.0
        if most > 0.0:
            head = work[j, j]
            alpha = -np.sqrt(most) if head >= 0.0 else np.sqrt(most)
            # v = x - alpha e, v'v = 2 alpha (alpha - head)
            work[j, j] = head - alpha
            tau[j] = 1.0 / (alpha * (alpha - head))
            for i in range(j + 1, n):
                dot = 0.0
                for r in range(j, rows):
                    dot += work[j, r] * work[i, r]
                dot *= tau[j]
                for r in range(j, rows):
                    work[i, r] -= dot * work[j, r]
            X[pivot[j], j] = alpha
        else:
            X[pivot[j], j] = 0.0
        for i in range(j):
            X[pivot[j], i] = work[j, i]
        for i in range(j + 1, n):
            X[pivot[j], i] = 0.0


@njit(**PART)
def _orthonormal(work, tau, order, E, Z):
    """Z (n, n) <- the rows of the orthonormal factor that belong to the first n columns of M; E (n, rows) is work."""
    n, rows = work.shape
    for i in range(n):
        for r in range(rows):
            E[i, r] = 0.0
        E[i, i] = 1.0
    for j in range(n - 1, -1, -1):
        if tau[j] != 0.0:
            for i in range(j, n):
                dot = 0.0
                for r in range(j, rows):
                    dot += work[j, r] * E[i, r]
                dot *= tau[j]
                for r in range(j, rows):
                    E[i, r] -= dot * work[j, r]
    for r in range(rows):
        if order[r] < n:
            for i in range(n):
                Z[order[r], i] = E[i, r]


@njit(**PART)
def predict(X, F, root, M, work, E, tau, order, pivot, Z):
    """X <- the root after the predict F, root (n, n), in place; Z_1 into Z."""
    n = X.shape[0]
    for i in range(n):
        for j in range(n):
            M[i, j] = 0.0
            M[i, n + j] = root[i, j]
        for m in range(n):
            f = F[i, m]
            if f != 0.0:
                for j in range(n):
                    M[i, j] += f * X[m, j]
    triangle(M, work, tau, order, pivot, X)
    _orthonormal(work, tau, order, E, Z)


@njit(**PART)
def update(X, c, w, record):
    """X <- the root after one row c (n,) with information w; record (n+3,) <- u, tau, p, D_pp of the reflection."""
    n = X.shape[0]
    total = 0.0
    p = 0
    for j in range(n):
        b = 0.0
        for i in range(n):
            b += X[i, j] * c[i]
        record[j] = b
        total += b * b
        if abs(b) > abs(record[p]):
            p = j
    record[n], record[n + 1], record[n + 2] = 0.0, p, 1.0
    if total == 0.0:
        return
    norm = np.sqrt(total)
    sign = 1.0 if record[p] >= 0.0 else -1.0
    short = 1.0 / np.sqrt(1.0 + w * total)
    head = record[p] + sign * norm
    tau = 1.0 / (norm * abs(head))
    for i in range(n):
        along = 0.0
        for j in range(n):
            along += X[i, j] * record[j]
        dot = (along + X[i, p] * sign * norm) * tau
        for j in range(n):
            X[i, j] -= dot * record[j]
        X[i, p] = -sign * along / norm * short
    record[p], record[n], record[n + 2] = head, tau, short


@njit(**PART)
def charge(V, X):
    """|V X|^2 for V (p, n)."""
    n, total = X.shape[0], 0.0
    for a in range(V.shape[0]):
        for j in range(n):
            y = 0.0
            for i in range(n):
                y += V[a, i] * X[i, j]
            total += y * y
    return total


@njit(**OPTIONS)
def forward(
    k0, k1, X, F, root, index, rows, row_set, offsets, steps, v, V, running_set, charges, after, before, Z, records,
    M, work, E, tau, order, pivot,
):
    """Intervals k0..k1-1 in place on X; returns the running charge, sum of a |V X-|^2 + b |V X+|^2 with a, b = charges.

    after, before, Z (K, n, n) and records (K, r, n+3), K >= k1 - k0, receive X+, X-, Z_1 and the reflections.
    M, work, E (n, 2 n), tau (n,), order (2 n,) and pivot (n,) are work space.
    """
    running, total = V.shape[0] > 0, 0.0
    for k in range(k0, k1):
        u, here = index[k], k - k0
        predict(X, F[u], root[u], M, work, E, tau, order, pivot, Z[here])
        if running:
            copy_matrix(X, before[here])
            total += charges[k, 0] * charge(V[running_set[k]], X)
        for j in range(offsets.shape[0] - 1):
            w = steps[k] * v[k, j]
            if w > 0.0:
                for r in range(offsets[j], offsets[j + 1]):
                    update(X, rows[row_set[k], r], w, records[here, r])
        copy_matrix(X, after[here])
        if running:
            total += charges[k, 1] * charge(V[running_set[k]], X)
    return total


@njit(**OPTIONS)
def _charged(g, X, V, factor, M, work, tau, order, pivot):
    """g <- a root of g g' + factor X' V' V X, (n, n); V (n, n)."""
    n = g.shape[0]
    for i in range(n):
        for j in range(n):
            M[i, j] = g[i, j]
    for a in range(n):
        for i in range(n):
            y = 0.0
            for m in range(n):
                y += X[m, i] * V[a, m]
            M[i, n + a] = factor * y
    triangle(M, work, tau, order, pivot, g)


@njit(**OPTIONS)
def backward(
    k0, k1, g, rows, row_set, offsets, steps, v, V, running_set, charges, after, before, Z, records, gain,
    M, work, x, tau, order, pivot, t,
):
    """gain (N, M) <- h tr(L_j S+ P+ S+) for the intervals k1-1..k0; g (n, p) is changed in place (p = n with V).

    M, work (n, 2 n), x (n,), tau (n,), order (2 n,), pivot (n,) and t (n, p) are work space.
    """
    n, p = g.shape
    running = V.shape[0] > 0
    for k in range(k1 - 1, k0 - 1, -1):
        here, h = k - k0, steps[k]
        if running and charges[k, 1] > 0.0:
            _charged(g, after[here], V[running_set[k]], np.sqrt(charges[k, 1]), M, work, tau, order, pivot)
        for j in range(offsets.shape[0] - 1):
            total = 0.0
            for r in range(offsets[j], offsets[j + 1]):
                for i in range(n):
                    x[i] = 0.0
                for m in range(n):
                    c = rows[row_set[k], r, m]
                    if c != 0.0:
                        for i in range(n):
                            x[i] += c * after[here, m, i]
                for a in range(p):
                    y = 0.0
                    for i in range(n):
                        y += x[i] * g[i, a]
                    total += y * y
            gain[k, j] = h * total
        for j in range(offsets.shape[0] - 2, -1, -1):
            if h * v[k, j] > 0.0:
                for r in range(offsets[j + 1] - 1, offsets[j] - 1, -1):
                    record = records[here, r]
                    factor, pole = record[n], np.int64(record[n + 1])
                    if factor != 0.0:
                        for a in range(p):
                            g[pole, a] *= record[n + 2]
                            dot = 0.0
                            for i in range(n):
                                dot += record[i] * g[i, a]
                            dot *= factor
                            for i in range(n):
                                g[i, a] -= dot * record[i]
        if running and charges[k, 0] > 0.0:
            _charged(g, before[here], V[running_set[k]], np.sqrt(charges[k, 0]), M, work, tau, order, pivot)
        for i in range(n):
            for a in range(p):
                t[i, a] = 0.0
            for m in range(n):
                o = Z[here, i, m]
                for a in range(p):
                    t[i, a] += o * g[m, a]
        copy_matrix(t, g)

"""Compiled loops of the forward and backward sweep for few states; arrays in, arrays out, nothing allocated inside.

Unknowns of one interval k, in the order of time:
    S-  = F S F' + Q                     predict k       S: covariance after update k-1
    S+  = (S-^-1 + sum_r w_r c_r c_r')^-1   update k      c_r: scaled sensor rows, w_r = h v_j
backwards, with P = dJ/dS+ and K = I - S+ sum_r w_r c_r c_r':
    dJ/dv_j = cost_j - h sum_{r in j} c_r' S+ P S+ c_r,     P- = K' P K,     P <- F' P- F
Without a running weight P = V'V with few rows V (p, n), and V- = V K needs no n x n product at all.
Rows of all matrices are padded with zeros to `width(n)` doubles (scheduling/vectors.py); scheduling/kernels_blas.py is
the same for many states. An update whose normalised innovation exceeds CANCEL is done in Joseph's form, which keeps the
digits that S - b b' would cancel (S0 = 1e6, Theta = 1e-3).
"""

from __future__ import annotations

from numba import njit

from occontrol.scheduling.vectors import (
    LOWER,
    OPTIONS,
    START,
    WHOLE,
    WIDTH,
    axpy,
    copy,
    load,
    mirror,
    product,
    scalar,
    store,
    summed,
    times,
    zero,
)  # fmt: skip

CANCEL = 100.0


@njit(**OPTIONS)
def trace_product(a, b, n):
    """tr(a'b) of the leading n x n blocks."""
    total = 0.0
    for i in range(n):
        for j in range(n):
            total += a[i, j] * b[i, j]
    return total


@njit(**OPTIONS, inline="always")
def _update_row(X, at, c, row, w, b, n, width):
    """One scalar measurement with row c[row:] and information w, in place on the matrix at X[at:]; b is work space."""
    dot = zero()
    for j in range(0, width, WIDTH):
        total, other = zero(), zero()  # two chains: the loop waits for their latency
        for m in range(0, n - 1, 2):
            total = axpy(scalar(c, row + m), load(X, at + m * width + j), total)
            other = axpy(scalar(c, row + m + 1), load(X, at + (m + 1) * width + j), other)
        if n % 2:
            total = axpy(scalar(c, row + n - 1), load(X, at + (n - 1) * width + j), total)
        total = axpy(1.0, other, total)
        store(b, j, total)
        dot = times(load(c, row + j), total, dot)
    innovation = w * summed(dot)
    gain = w / (1.0 + innovation)
    for i in range(n):
        x = -gain * scalar(b, i)
        p = at + i * width
        for j in range(0, width, WIDTH):
            store(X, p + j, axpy(x, load(b, j), load(X, p + j)))
    if innovation < CANCEL:
        return
    # second factor of (I - kc')S(I - kc')' + kk'/w, with k = gain b
    for i in range(n):
        p = at + i * width
        x = 0.0
        for j in range(n):
            x += X[p + j] * c[row + j]
        for j in range(n):
            X[p + j] += gain * b[j] * (gain * b[i] / w - x)
    _symmetrise(X, at, n, width)


@njit(**OPTIONS, inline="always")
def _symmetrise(X, at, n, width):
    """The matrix at X[at:] <- the mean of it and its transpose."""
    for i in range(n):
        for j in range(i):
            low, high = at + i * width + j, at + j * width + i
            X[low] = X[high] = 0.5 * (X[low] + X[high])


@njit(**OPTIONS)
def forward_small(
    k0, k1, S, T, F, FT, Q, predict, rows, row_set, offsets, steps, v, R, running_set, charges, kept, b
):
    """Predicts and updates k0..k1-1 in place on S; returns the running cost. kept[k-k0] = S+ unless it is empty.

    S, T (n, width); F, FT, Q (U, n, width); rows (S, r, width); charges (K, 2); kept (K, n, width); b (width,)
    """
    n, width = S.shape
    size = n * width
    M = offsets.shape[0] - 1
    keep = kept.shape[0] > 0
    running = R.shape[0] > 0
    last, X, t = S.reshape(-1), S.reshape(-1), T.reshape(-1)
    f, ft, q = F.reshape(-1), FT.reshape(-1), Q.reshape(-1)
    per_set, c = rows.shape[1] * width, rows.reshape(-1)
    if keep:
        X = kept.reshape(-1)
    before = at = START  # not the literal 0, with which `product` would be compiled once more
    total = 0.0
    for k in range(k0, k1):
        u = predict[k] * size
        product(f, u, width, last, before, width, t, START, width, t[:0], START, n, n, width, WHOLE)
        if keep:
            at = (k - k0) * size
        product(t, START, width, ft, u, width, X, at, width, q, u, n, n, width, LOWER)
        mirror(X, at, n, width)
        h = steps[k]
        if running:
            total += charges[k, 0] * trace_product(R[running_set[k]], X[at : at + size].reshape(n, width), n)
        first = row_set[k] * per_set
        for j in range(M):
            w = h * v[k, j]
            if w > 0.0:
                for r in range(offsets[j], offsets[j + 1]):
                    _update_row(X, at, c, first + r * width, w, b, n, width)
        if running:
            total += charges[k, 1] * trace_product(R[running_set[k]], X[at : at + size].reshape(n, width), n)
        last, before = X, at
    if keep and k1 > k0:
        copy(X, at, S.reshape(-1), START, size)
    return total


@njit(**OPTIONS)
def backward_small(
    k0, k1, V, U, F, predict, rows, columns, row_set, offsets, steps, v, upper, cost, kept, gradient, T, D, G
):
    """Rows k1-1..k0 of the gradient without a running weight; V (p, width) with P = V'V is changed in place.

    columns (S, n, width(r)) are the rows transposed; U, T (p, width) and D (p, width(r)) are work space.
    G (N, r, p), unless empty, receives c_r'x with x = S+ V' (what scheduling/exchange.py starts from).
    """
    remember = G.shape[0] > 0
    p, width = V.shape
    n, wide = columns.shape[1:]
    M, R, size = offsets.shape[0] - 1, offsets[-1], n * width
    x, u, t, d = V.reshape(-1), U.reshape(-1), T.reshape(-1), D.reshape(-1)
    f, c, ct, plus = F.reshape(-1), rows.reshape(-1), columns.reshape(-1), kept.reshape(-1)
    none = x[:0]
    for k in range(k1 - 1, k0 - 1, -1):
        product(x, START, width, plus, (k - k0) * size, width, u, START, width, none, START, p, n, width, WHOLE)
        product(u, START, width, ct, row_set[k] * n * wide, wide, d, START, wide, none, START, p, n, wide, WHOLE)
        if remember:
            for r in range(R):
                for a in range(p):
                    G[k, r, a] = D[a, r]
        h = steps[k]
        first = row_set[k] * rows.shape[1] * width
        for j in range(M):
            w = h * v[k, j]
            total = 0.0
            for r in range(offsets[j], offsets[j + 1]):
                for a in range(p):
                    y = d[a * wide + r]
                    total += y * y
                if w > 0.0:
                    at = first + r * width
                    for a in range(p):
                        y = -w * d[a * wide + r]
                        for i in range(0, width, WIDTH):
                            store(x, a * width + i, axpy(y, load(c, at + i), load(x, a * width + i)))
            gradient[k, j] = cost[k, j] - (h * total if upper[k, j] > 0.0 else 0.0)
        product(x, START, width, f, predict[k] * size, width, t, START, width, none, START, p, n, width, WHOLE)
        copy(t, START, x, START, p * width)


@njit(**OPTIONS)
def backward_small_dense(
    k0, k1, P, T, F, FT, predict, rows, row_set, offsets, steps, v, upper, cost, R, running_set, charges, kept,
    gradient, y, z,
):
    """As backward_small, with a full costate P (n, width) and a running weight."""
    n, width = P.shape
    x, t = P.reshape(-1), T.reshape(-1)
    none = x[:0]
    M = offsets.shape[0] - 1
    for k in range(k1 - 1, k0 - 1, -1):
        S = kept[k - k0]
        c = rows[row_set[k]]
        h = steps[k]
        weight = R[running_set[k]]
        for i in range(n):
            for j in range(n):
                P[i, j] += charges[k, 1] * weight[i, j]
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
                            s = w * z[i]
                            for m in range(n):
                                T[i, m] -= s * c[r, m]
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
                        s = y[i]
                        for m in range(n):
                            z[m] += s * T[i, m]
                    for i in range(n):
                        s = w * c[r, i]
                        for m in range(n):
                            P[i, m] -= s * z[m]
        for i in range(n):
            for m in range(n):
                P[i, m] += charges[k, 0] * weight[i, m]
        u = predict[k] * n * width
        product(FT.reshape(-1), u, width, x, START, width, t, START, width, none, START, n, n, width, WHOLE)
        product(t, START, width, F.reshape(-1), u, width, x, START, width, none, START, n, n, width, LOWER)
        mirror(x, 0, n, width)

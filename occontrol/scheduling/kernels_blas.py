"""The sweeps of scheduling/kernels.py for many states: products by BLAS, active rows in blocks; nothing padded.

F S F' + Q is symmetric: it is formed by panels of columns, (S F')_j and then F (S F')_j from the diagonal down.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from occontrol.scheduling.kernels import CANCEL, trace_product
from occontrol.scheduling.vectors import OPTIONS

BLOCK = 32
TILE = 8
SMALL_PRODUCT = 730_000
WIDE = 128


@njit(**OPTIONS)
def symmetrise(S, n):
    """S <- the mean of S and its transpose."""
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
    """S <- S - D'D for the first `count` rows of D, four or two at a time."""
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
        elif r + 2 <= count:
            d1 = D[r + 1]
            for i in range(n):
                x0, x1 = d0[i], d1[i]
                for j in range(n):
                    S[i, j] -= x0 * d0[j] + x1 * d1[j]
            r += 2
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
    symmetrise(S, n)


def panel_width(n: int) -> int:
    """Columns of a panel of the predict: the widest of 32, 16, 8 whose products BLAS takes as small ones.

    OpenBLAS multiplies without copying its arguments first up to m n k = 10^6, if neither is transposed; wide panels
    beyond. scripts/bench.py shows the rate.

    Parameters
    ----------
    n : states
    """
    return next((w for w in (32, 16, 8) if n * n * w <= SMALL_PRODUCT), WIDE)


@njit(**OPTIONS)
def _pack(f, width, packed):
    """packed (n n,) <- f', one panel of columns after the other, each contiguous."""
    n = f.shape[0]
    at = 0
    for j0 in range(0, n, width):
        j1 = min(j0 + width, n)
        for i in range(n):
            for j in range(j0, j1):
                packed[at] = f[j, i]
                at += 1


@njit(**OPTIONS)
def _predict(X, f, packed, q, width, left, part, S):
    """S <- F X F' + Q panel by panel of columns, each from the diagonal down; X symmetric, S another matrix.

    packed : f' by `_pack`; left, part (n width,) work space
    """
    n = X.shape[0]
    at = 0
    for j0 in range(0, n, width):
        d = min(width, n - j0)
        t = left[: n * d].reshape(n, d)
        np.dot(X, packed[at : at + n * d].reshape(n, d), t)
        at += n * d
        out = part[: (n - j0) * d].reshape(n - j0, d)
        np.dot(f[j0:], t, out)
        for i in range(d):
            for j in range(i + 1):
                x = out[i, j] + q[j0 + i, j0 + j]
                S[j0 + i, j0 + j] = x
                S[j0 + j, j0 + i] = x
        for i0 in range(d, n - j0, TILE):
            i1 = min(i0 + TILE, n - j0)
            for i in range(i0, i1):
                for j in range(d):
                    S[j0 + i, j0 + j] = out[i, j] + q[j0 + i, j0 + j]
            # mirrored while the tile is in the first cache
            for j in range(d):
                for i in range(i0, i1):
                    S[j0 + j, j0 + i] = S[j0 + i, j0 + j]


@njit(**OPTIONS)
def forward_large(
    k0, k1, S, T, F, Q, predict, rows, row_set, offsets, steps, v, R, running_set, charges, kept,
    width, packed, left, part, other, C, B, D
):  # fmt: skip
    """forward_small for many states.

    S, T, other (n, n), kept (K, n, n), packed (n n,), left, part (n width,), C, B, D (BLOCK, n)
    """
    M = offsets.shape[0] - 1
    n = S.shape[0]
    keep = kept.shape[0] > 0
    running = R.shape[0] > 0
    total = 0.0
    last, now = S, other
    held = -1
    for k in range(k0, k1):
        if keep:
            now = kept[k - k0]
        f = F[predict[k]]
        if predict[k] != held:
            _pack(f, width, packed)
            held = predict[k]
        _predict(last, f, packed, Q[predict[k]], width, left, part, now)
        h = steps[k]
        if running:
            total += charges[k, 0] * trace_product(R[running_set[k]], now, n)
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
                        _update_block(now, C, B, D, T, count, n)
                        count = 0
        if count > 0:
            _update_block(now, C, B, D, T, count, n)
        if running:
            total += charges[k, 1] * trace_product(R[running_set[k]], now, n)
        last, now = now, last
    if k1 > k0 and (keep or (k1 - k0) % 2 == 1):
        S[:, :] = last
    return total

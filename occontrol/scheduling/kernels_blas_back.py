"""The way back of scheduling/kernels.py for many states: products by BLAS, nothing padded (see kernels_blas.py)."""

from __future__ import annotations

import numpy as np
from numba import njit

from occontrol.scheduling.kernels_blas import symmetrise
from occontrol.scheduling.vectors import OPTIONS

WAITING = 96  # rows of V S+ that wait for their product with all sensor rows


@njit(**OPTIONS)
def _squares(first, last, U, c, listed, wanted, sums, products, offsets, steps, upper, gradient, G):
    """gradient -= h |c_r V S+|^2 of the available rows of intervals first .. last; U holds their V S+, last first."""
    p = G.shape[2]
    M = offsets.shape[0] - 1
    wanted[:] = False
    for k in range(first, last + 1):
        for j in range(M):
            wanted[j] |= upper[k, j] > 0.0
    count = 0
    for j in range(M):
        if wanted[j]:
            for r in range(offsets[j], offsets[j + 1]):
                listed[count] = r
                count += 1
    if count == 0:
        return
    rows = c
    if count < len(c):
        rows = c[listed[:count]]
    block = (last - first + 1) * p
    out = products[: block * count].reshape(block, count)
    np.dot(U[:block], rows.T, out)
    for k in range(first, last + 1):
        top = (last - k) * p
        for r in range(count):
            sums[r] = out[top, r] * out[top, r]
        for a in range(1, p):
            for r in range(count):
                sums[r] += out[top + a, r] * out[top + a, r]
        at = 0
        for j in range(M):
            if wanted[j]:
                size = offsets[j + 1] - offsets[j]
                if upper[k, j] > 0.0:
                    for r in range(at, at + size):
                        gradient[k, j] -= steps[k] * sums[r]
                at += size
        if G.shape[0] > 0:
            for r in range(count):
                for a in range(p):
                    G[k, listed[r], a] = out[top + a, r]


@njit(**OPTIONS)
def backward_large(
    k0, k1, V, U, F, predict, rows, row_set, offsets, steps, v, upper, cost, kept, gradient,
    c, step, shares, listed, wanted, products, G
):  # fmt: skip
    """backward_small for many states; the derivatives wait until U (B p, n) holds V S+ of B intervals or rows change.

    c (r, n), step (p, n), shares (p r,), listed (r,), wanted (M,) and products (B p r,) are work space
    """
    p, n = V.shape
    M = offsets.shape[0] - 1
    room = U.shape[0] // p
    newest = k1 - 1  # the first interval whose V S+ waits
    tail = (listed, wanted, shares, products, offsets, steps, upper, gradient, G)
    for k in range(k1 - 1, k0 - 1, -1):
        if newest - k == room or row_set[newest] != row_set[k]:
            _squares(k + 1, newest, U, rows[row_set[newest]], *tail)
            newest = k
        here = U[(newest - k) * p : (newest - k + 1) * p]
        np.dot(V, kept[k - k0], here)
        count = 0
        for j in range(M):
            gradient[k, j] = cost[k, j]
            if upper[k, j] > 0.0 and v[k, j] > 0.0:
                for r in range(offsets[j], offsets[j + 1]):
                    c[count, :] = rows[row_set[k], r]
                    listed[count] = j
                    count += 1
        if count > 0:
            share = shares[: p * count].reshape(p, count)
            np.dot(here, c[:count].T, share)
            for a in range(p):
                for r in range(count):
                    share[a, r] *= steps[k] * v[k, listed[r]]
            np.dot(share, c[:count], step)
            for a in range(p):
                for i in range(n):
                    V[a, i] -= step[a, i]
        np.dot(V, F[predict[k]], step)
        V[:, :] = step
    if k1 > k0:
        _squares(k0, newest, U, rows[row_set[newest]], *tail)


@njit(**OPTIONS)
def backward_large_dense(
    k0, k1, P, T, F, predict, rows, row_set, offsets, steps, v, upper, cost, R, running_set, charges, kept, gradient,
    Y, Z,
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
                P[i, j] += charges[k, 1] * weight[i, j]
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
                P[i, m] += charges[k, 0] * weight[i, m]
        f = F[predict[k]]
        np.dot(P, f, T)
        np.dot(f.T, T, P)
        symmetrise(P, n)

"""The costate back along a policy, compiled: P_k = G_k' P_{k+1} G_k + R_k."""

from __future__ import annotations

from numba import njit

from occontrol.scheduling.kernels import OPTIONS


@njit(**OPTIONS)
def costate_back(closed, charged, costate, work):
    """Fill costate (K+1, n, n), the last given, by `closed` (K, n, n) and `charged` (K or 1, n, n); work (n, n)."""
    K, n = closed.shape[0], closed.shape[1]
    for k in range(K - 1, -1, -1):
        G, P, out = closed[k], costate[k + 1], costate[k]
        R = charged[k if charged.shape[0] > 1 else 0]
        for i in range(n):
            for j in range(n):
                work[i, j] = 0.0
            for m in range(n):
                p = P[i, m]
                for j in range(n):
                    work[i, j] += p * G[m, j]
        for i in range(n):
            for j in range(n):
                out[i, j] = R[i, j]
        for m in range(n):
            for i in range(n):
                g = G[m, i]
                for j in range(n):
                    out[i, j] += g * work[m, j]

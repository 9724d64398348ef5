"""Exact Hessian products of J(v) at O(n^2 p) an interval, p the rank of the terminal weight.

With W = V_T' V_T and no running weight, each row V of the costate's factor and x = S+ V obey the linear two-point system
    x_k = F_k x_{k-1} + Q_k V-_k,   V-_k = V_k - h L(v_k) x_k,   V_{k-1} = F_k' V-_k,   x_{-1} = S_0 V_{-1}
whose Riccati solution is the covariance itself. The system linearised in v is therefore solved by one forward and one
backward pass of vectors:
    forward    m <- F m,  w = -h L(dv) x - h L(v) m,   m+ = m + S+ w
    backward   dx = S+ dV + m+,  dg_j = -2h sum_r (c_r'x)(c_r'dx),  dV <- F'(dV - h L(v) dx - h L(dv) x)
Arrays: G (N, r, p) holds c_r'x of every row, `store` (N, n, n) the S+.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from occontrol.numerics.kernels import _OPTIONS


@njit(**_OPTIONS)
def hessian_small(F, predict, rows, row_set, offsets, steps, v, dv, upper, store, G, m_store, m, w, result):
    """result (N, M) = H dv; m, w (p, n) work space, m_store (N, p, n)."""
    N, n = m_store.shape[0], m_store.shape[2]
    p, M = m.shape[0], offsets.shape[0] - 1
    for a in range(p):
        for i in range(n):
            m[a, i] = 0.0
    for k in range(N):
        f, S, c, h = F[predict[k]], store[k], rows[row_set[k]], steps[k]
        for a in range(p):
            for i in range(n):
                s = 0.0
                for j in range(n):
                    s += f[i, j] * m[a, j]
                w[a, i] = s
            for i in range(n):
                m[a, i] = w[a, i]
                w[a, i] = 0.0
        for j in range(M):
            x, y = h * dv[k, j], h * v[k, j]
            if x != 0.0 or y > 0.0:
                for r in range(offsets[j], offsets[j + 1]):
                    for a in range(p):
                        s = 0.0
                        for i in range(n):
                            s += c[r, i] * m[a, i]
                        s = x * G[k, r, a] + y * s
                        for i in range(n):
                            w[a, i] -= s * c[r, i]
        for a in range(p):
            for i in range(n):
                x = w[a, i]
                for j in range(n):
                    m[a, j] += x * S[i, j]
            for i in range(n):
                m_store[k, a, i] = m[a, i]
    # m is the tangent of V from here on, w that of x
    for a in range(p):
        for i in range(n):
            m[a, i] = 0.0
    for k in range(N - 1, -1, -1):
        f, S, c, h = F[predict[k]], store[k], rows[row_set[k]], steps[k]
        for a in range(p):
            for i in range(n):
                w[a, i] = m_store[k, a, i]
            for i in range(n):
                x = m[a, i]
                for j in range(n):
                    w[a, j] += x * S[i, j]
        for j in range(M):
            total = 0.0
            if upper[k, j] > 0.0:
                x, y = h * dv[k, j], h * v[k, j]
                for r in range(offsets[j], offsets[j + 1]):
                    for a in range(p):
                        s = 0.0
                        for i in range(n):
                            s += c[r, i] * w[a, i]
                        total += G[k, r, a] * s
                        s = y * s + x * G[k, r, a]
                        if s != 0.0:
                            for i in range(n):
                                m[a, i] -= s * c[r, i]
            result[k, j] = -2.0 * h * total
        for a in range(p):
            for j in range(n):
                w[a, j] = 0.0
            for i in range(n):
                x = m[a, i]
                for j in range(n):
                    w[a, j] += x * f[i, j]
            for j in range(n):
                m[a, j] = w[a, j]


@njit(**_OPTIONS)
def hessian_large(F, predict, rows, row_set, offsets, steps, v, dv, upper, store, G, m_store, m, w, result, D, E):
    """hessian_small for large n; D, E (r, p) hold products of the rows with vectors."""
    N, n = m_store.shape[0], m_store.shape[2]
    p, M = m.shape[0], offsets.shape[0] - 1
    m[:, :] = 0.0
    for k in range(N):
        c, h = rows[row_set[k]], steps[k]
        np.dot(m, F[predict[k]].T, w)
        m[:, :] = w
        np.dot(c, m.T, D)
        for j in range(M):
            x, y = h * dv[k, j], h * v[k, j]
            for r in range(offsets[j], offsets[j + 1]):
                for a in range(p):
                    E[r, a] = -(x * G[k, r, a] + y * D[r, a])
        np.dot(E.T, c, w)
        np.dot(w, store[k], m_store[k])
        for a in range(p):
            for i in range(n):
                m[a, i] += m_store[k, a, i]
                m_store[k, a, i] = m[a, i]
    m[:, :] = 0.0
    for k in range(N - 1, -1, -1):
        c, h = rows[row_set[k]], steps[k]
        np.dot(m, store[k], w)
        for a in range(p):
            for i in range(n):
                w[a, i] += m_store[k, a, i]
        np.dot(c, w.T, D)
        for j in range(M):
            total = 0.0
            x, y = h * dv[k, j], h * v[k, j]
            for r in range(offsets[j], offsets[j + 1]):
                for a in range(p):
                    total += G[k, r, a] * D[r, a]
                    E[r, a] = -(y * D[r, a] + x * G[k, r, a])
            result[k, j] = -2.0 * h * total if upper[k, j] > 0.0 else 0.0
        np.dot(E.T, c, w)
        for a in range(p):
            for i in range(n):
                w[a, i] += m[a, i]
        np.dot(w, F[predict[k]], m)

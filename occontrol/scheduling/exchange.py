"""The exact change of J for every single exchange 'use l instead of j on interval k', at the price of one dense sweep.

Let S be the smoothed covariance at interval k (all information, before and after), x = S+ V' and G = C x as in the
gradient. Exchanging information h L_j for h L_l changes J by
    alpha h (q_l - q_j) - tr[ G' (D^-1 + C S C')^-1 G ],   C = [C_j; C_l],  G = [G_j; G_l],  D = h diag(-I, I)
(the matrix inversion lemma on S^-1 - h L_j + h L_l). The smoothed covariance comes from the adjoint recursion
    Lam- = K' Lam K + C~'(I + C~ S- C~')^-1 C~,   Lam <- F' Lam- F,   S = S+ - S+ Lam S+        (Bryson & Frazier 1963)
With a running weight J looks at the covariance at every time, and no one S will do. With S+ in its place the formula is
tr(P dS+), which is never below the change: a later covariance is a concave function of an earlier one. Where the plant
falls into blocks every promising exchange is swept on by itself, and exact (blocks/exchanges.py).
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numba import njit

from occontrol.numerics.loops import multiply
from occontrol.scheduling.feasible_set import FeasibleSet
from occontrol.scheduling.sweep import Sweep
from occontrol.scheduling.vectors import OPTIONS, START, copy


@njit(**OPTIONS, inline="always")
def _solve_quadratic(A, B, size, p):
    """tr(B' A^-1 B) by Gaussian elimination with pivoting; A (size, size) and B (size, p) are destroyed."""
    for i in range(size):
        pivot = i
        for r in range(i + 1, size):
            if abs(A[r, i]) > abs(A[pivot, i]):
                pivot = r
        # symmetric: swap row and column, so that A stays symmetric and tr(B'A^-1B) is unchanged
        if pivot != i and abs(A[pivot, pivot]) > 0.0:
            for c in range(size):
                A[i, c], A[pivot, c] = A[pivot, c], A[i, c]
            for c in range(size):
                A[c, i], A[c, pivot] = A[c, pivot], A[c, i]
            for c in range(p):
                B[i, c], B[pivot, c] = B[pivot, c], B[i, c]
        for r in range(i + 1, size):
            x = A[r, i] / A[i, i]
            for c in range(i, size):
                A[r, c] -= x * A[i, c]
            for c in range(p):
                B[r, c] -= x * B[i, c]
    # A is now D L' of L D L', B is L^-1 B
    total = 0.0
    for i in range(size):
        for c in range(p):
            total += B[i, c] * B[i, c] / A[i, i]
    return total


@njit(**OPTIONS)
def _best_exchanges(
    F, predict, rows, row_set, offsets, steps, leaves, enters, v, cost, store, G, gain, leaving, entering,
    adjoint, T, S, plus, A, B, Y, u,
):
    N, M = v.shape
    n, p = store.shape[1], G.shape[2]
    for i in range(n):
        for m in range(n):
            adjoint[i, m] = 0.0
    for k in range(N - 1, -1, -1):
        c, h = rows[row_set[k]], steps[k]
        for i in range(n):
            for m in range(n):
                plus[i, m] = store[k, i, m]
        multiply(plus, adjoint, T)
        multiply(T, plus, S)
        for i in range(n):
            for m in range(n):
                S[i, m] = plus[i, m] - S[i, m]
        multiply(c, S, Y)
        gain[k], leaving[k], entering[k] = 0.0, -1, -1
        for j in range(M):
            if not leaves[k, j]:
                continue
            for e in range(M):
                if e == j or not enters[k, e]:
                    continue
                mj, me = offsets[j + 1] - offsets[j], offsets[e + 1] - offsets[e]
                size = mj + me
                for a in range(size):
                    ra = offsets[j] + a if a < mj else offsets[e] + a - mj
                    for b in range(size):
                        rb = offsets[j] + b if b < mj else offsets[e] + b - mj
                        s = 0.0
                        for i in range(n):
                            s += Y[ra, i] * c[rb, i]
                        A[a, b] = s
                    A[a, a] += -1.0 / h if a < mj else 1.0 / h
                    for b in range(p):
                        B[a, b] = G[k, ra, b]
                change = cost[k, e] - cost[k, j] - _solve_quadratic(A, B, size, p)
                if change < gain[k]:
                    gain[k], leaving[k], entering[k] = change, j, e
        # the adjoint of the update, then of predict k
        for j in range(M):
            if v[k, j] > 0.0:
                for r in range(offsets[j], offsets[j + 1]):
                    for i in range(n):
                        s = 0.0
                        for m in range(n):
                            s += plus[i, m] * c[r, m]
                        Y[r, i] = s
        # T = Lam K, then K'T + C~' (I - C~ S+ C~') C~, which equals the innovation term
        copy(adjoint.reshape(-1), START, T.reshape(-1), START, n * n)
        for j in range(M):
            w = h * v[k, j]
            if w > 0.0:
                for r in range(offsets[j], offsets[j + 1]):
                    for i in range(n):
                        s = 0.0
                        for m in range(n):
                            s += adjoint[i, m] * Y[r, m]
                        for m in range(n):
                            T[i, m] -= w * s * c[r, m]
        copy(T.reshape(-1), START, adjoint.reshape(-1), START, n * n)
        for j in range(M):
            w = h * v[k, j]
            if w > 0.0:
                for r in range(offsets[j], offsets[j + 1]):
                    for m in range(n):
                        u[m] = c[r, m]
                    for i in range(n):
                        s = Y[r, i]
                        for m in range(n):
                            u[m] -= s * T[i, m]
                    for e in range(M):
                        x = h * v[k, e]
                        if x > 0.0:
                            for q in range(offsets[e], offsets[e + 1]):
                                s = 0.0
                                for i in range(n):
                                    s += Y[r, i] * c[q, i]
                                for m in range(n):
                                    u[m] -= x * s * c[q, m]
                    for i in range(n):
                        for m in range(n):
                            adjoint[i, m] += w * c[r, i] * u[m]
        f = F[predict[k]]
        multiply(adjoint, f, T)
        for i in range(n):
            for m in range(n):
                adjoint[i, m] = 0.0
            for a in range(n):
                x = f[a, i]
                for m in range(n):
                    adjoint[i, m] += x * T[a, m]


def _surely_good_exchanges(
    sweep: Sweep, weights: np.ndarray, leaves: np.ndarray, enters: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    r, N, n = sweep.recursion, sweep.recursion.intervals, sweep.recursion.states
    gain, leaving, entering = np.zeros(N), np.full(N, -1), np.full(N, -1)
    per_row = np.repeat(np.arange(r.sensors), np.diff(r.offsets))
    inner, outer = np.empty((2, N, len(per_row), len(per_row)))
    P, store = sweep.terminal, sweep.kept[0]
    for k in range(N - 1, -1, -1):
        c, plus = r.rows[r.row_set[k]], store[k, :, :n]
        P = P + r.charges[k, 1] * r.running[r.running_set[k]]
        Y = c @ plus
        inner[k], outer[k] = Y @ c.T, Y @ P @ Y.T
        K = np.eye(n) - Y.T @ ((r.steps[k] * weights[k, per_row])[:, None] * c)
        P = K.T @ P @ K + r.charges[k, 0] * r.running[r.running_set[k]]
        F = r.transition[r.predict[k]]
        P = F.T @ P @ F
        P = 0.5 * (P + P.T)
    rows = [np.arange(a, b) for a, b in pairwise(r.offsets)]
    for j in range(r.sensors):
        for e in range(r.sensors):
            at = np.flatnonzero(leaves[:, j] & enters[:, e])
            if e == j or not len(at):
                continue
            both = np.concatenate([rows[j], rows[e]])
            block = np.ix_(at, both, both)
            signs = np.repeat([-1.0, 1.0], [len(rows[j]), len(rows[e])])
            change = r.cost[at, e] - r.cost[at, j]
            if len(both):
                A = inner[block] + np.eye(len(both)) * (signs / r.steps[at, None])[:, None]
                change -= np.trace(np.linalg.solve(A, outer[block]), axis1=1, axis2=2)
            better = change < gain[at]
            gain[at[better]], leaving[at[better]], entering[at[better]] = change[better], j, e
    return gain, leaving, entering


def best_exchanges(
    sweep: Sweep, feasible_set: FeasibleSet, weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The best single exchange of every interval and its effect on J: exact, or at least that with a running weight.

    Parameters
    ----------
    sweep : Sweep that `foresees_exchanges`, with `remember_products` done, whose last `cost_and_gradient` was at
        `weights`
    feasible_set : FeasibleSet, which says what may be exchanged
    weights : (N, M) integral policy

    Returns gain (N,) <= 0 (0 where no exchange surely helps), leaving (N,) and entering (N,) sensor indices or -1.
    """
    leaves, enters = feasible_set.exchange_masks(weights)
    if sweep.blocks is not None:
        return sweep.blocks.exchanges.best(weights, sweep.gradient, leaves, enters)
    if sweep.dense:
        return _surely_good_exchanges(sweep, weights, leaves, enters)
    r, N = sweep.recursion, sweep.recursion.intervals
    found = np.zeros(N), np.full(N, -1), np.full(N, -1)
    n, p, pair = r.states, sweep.kept[1].shape[2], 2 * int(np.max(np.diff(r.offsets)))
    space = (*np.empty((4, n, n)), np.empty((pair, pair)), np.empty((pair, p)))
    space += (np.empty((r.offsets[-1], n)), np.empty(n))
    _best_exchanges(
        r.transition, r.predict, r.rows, r.row_set, r.offsets, r.steps, leaves, enters, weights, r.cost,
        *sweep.kept, *found, *space,
    )  # fmt: skip
    return found

"""Compiled loops over the intervals of one target: its covariances with a visit and without, and what they cost.

The covariances of all blocks of a target stand one behind the other, n n numbers each. An interval begins with a
predict and the first charge; then come the look, if there is one, the second charge, and further steps. Without a look
everything is linear in the covariance at the start, so that a gap costs tr(M S) + m.
"""

from __future__ import annotations

import numpy as np
from numba import njit

OPTIONS = {"cache": True, "nogil": True, "error_model": "numpy"}
DEFLATED = 1.0 - 1e-10  # of a covariance that is to lie below others in spite of rounding


@njit(**OPTIONS)
def space(data):
    """Work space for the largest block, and how many numbers the covariances of all blocks are."""
    sizes = data[0]
    n, total = 1, 0
    for b in range(len(sizes)):
        n = max(n, sizes[b, 0])
        total += sizes[b, 0] ** 2
    return np.empty(n * n), np.empty(n), total


@njit(**OPTIONS)
def start(data, S):
    """S <- the covariances at the start."""
    sizes, matrices = data[0], data[1]
    o = 0
    for b in range(len(sizes)):
        nn = sizes[b, 0] ** 2
        for i in range(nn):
            S[o + i] = matrices[sizes[b, 2] + i]
        o += nn


@njit(**OPTIONS)
def predict(data, k, S, t):
    """S <- F S F' + Q of predict number k, block by block."""
    sizes, flows, predicts = data[0], data[2], data[3]
    o = 0
    for b in range(len(sizes)):
        n = sizes[b, 0]
        u = predicts[sizes[b, 4], k] * n * n
        f, q = sizes[b, 3] + u, sizes[b, 5] + u
        for i in range(n):
            for j in range(n):
                s = 0.0
                for p in range(n):
                    s += flows[f + i * n + p] * S[o + p * n + j]
                t[i * n + j] = s
        for i in range(n):
            for j in range(i + 1):
                s = flows[q + i * n + j]
                for p in range(n):
                    s += t[i * n + p] * flows[f + j * n + p]
                S[o + i * n + j] = s
                S[o + j * n + i] = s
        o += n * n


@njit(**OPTIONS)
def trace(data, which, S):
    """sum over blocks of tr(X S); X the weight W (which 1) or R (which 2)."""
    sizes, matrices = data[0], data[1]
    o, total = 0, 0.0
    for b in range(len(sizes)):
        nn = sizes[b, 0] ** 2
        x = sizes[b, 2] + which * nn
        for i in range(nn):
            total += matrices[x + i] * S[o + i]
        o += nn
    return total


@njit(**OPTIONS)
def look(data, k, S, taken, y):
    """S <- after the looks at step k whose `taken` (e,) is positive."""
    sizes, first, entry, row, rows, steps = data[0], data[4], data[5], data[6], data[7], data[9]
    o = 0
    for b in range(len(sizes)):
        n, per = sizes[b, 0], sizes[b, 1]
        for a in range(first[b, k], first[b, k + 1]):
            w = steps[k] * taken[entry[a]]
            if w <= 0.0:
                continue
            for r in range(per):
                c = row[a] + r * n
                d = 0.0
                for i in range(n):
                    s = 0.0
                    for j in range(n):
                        s += S[o + i * n + j] * rows[c + j]
                    y[i] = s
                    d += s * rows[c + i]
                gain = w / (1.0 + w * d)
                for i in range(n):
                    for j in range(n):
                        S[o + i * n + j] -= gain * y[i] * y[j]
        o += n * n


@njit(**OPTIONS)
def begin(data, s, k, S, t):
    """The first predict of interval k and the charge before its look, in place; what it costs."""
    predict(data, k * s, S, t)
    return data[10][k * s, 0] * trace(data, 2, S)


@njit(**OPTIONS)
def finish(data, s, k, S, looked, taken, t, y):
    """The rest of interval k after `begin`, with the looks that are `taken` or without, in place; what it costs."""
    charges = data[10]
    at = k * s
    if looked:
        look(data, at, S, taken, y)
    cost = charges[at, 1] * trace(data, 2, S)
    for q in range(at + 1, at + s):
        predict(data, q, S, t)
        cost += charges[q, 0] * trace(data, 2, S)
        if looked:
            look(data, q, S, taken, y)
        cost += charges[q, 1] * trace(data, 2, S)
    return cost


@njit(**OPTIONS)
def ending(data, S, t):
    """The last predict, in place; what the covariances at the end cost."""
    predict(data, len(data[9]), S, t)
    return trace(data, 1, S)


@njit(**OPTIONS)
def take(member, look, v, taken, value):
    """taken <- value for the looks of visit v."""
    for a in range(member[v], member[v + 1]):
        taken[look[a]] = value


@njit(**OPTIONS)
def pack(data, S, factor, packed):
    """packed (D,) <- factor times the lower triangles of all blocks."""
    sizes = data[0]
    o, at = 0, 0
    for b in range(len(sizes)):
        n = sizes[b, 0]
        for i in range(n):
            for j in range(i + 1):
                packed[at] = factor * S[o + i * n + j]
                at += 1
        o += n * n


@njit(**OPTIONS)
def unpack(data, packed, S):
    """S <- the covariances whose lower triangles are packed (D,)."""
    sizes = data[0]
    o, at = 0, 0
    for b in range(len(sizes)):
        n = sizes[b, 0]
        for i in range(n):
            for j in range(i + 1):
                S[o + i * n + j] = S[o + j * n + i] = packed[at]
                at += 1
        o += n * n


@njit(**OPTIONS)
def _move(data, k, Phi, t):
    """Phi <- F Phi of predict number k, block by block."""
    sizes, flows, predicts = data[0], data[2], data[3]
    o = 0
    for b in range(len(sizes)):
        n = sizes[b, 0]
        f = sizes[b, 3] + predicts[sizes[b, 4], k] * n * n
        for i in range(n):
            for j in range(n):
                s = 0.0
                for p in range(n):
                    s += flows[f + i * n + p] * Phi[o + p * n + j]
                t[i * n + j] = s
        for i in range(n * n):
            Phi[o + i] = t[i]
        o += n * n


@njit(**OPTIONS)
def _charge(data, which, factor, Phi, t, M):
    """M (D,) += factor Phi' X Phi, packed, off-diagonal entries twice; X the weight W (which 1) or R (which 2)."""
    sizes, matrices = data[0], data[1]
    o, at = 0, 0
    for b in range(len(sizes)):
        n = sizes[b, 0]
        x = sizes[b, 2] + which * n * n
        for i in range(n):
            for j in range(n):
                s = 0.0
                for p in range(n):
                    s += matrices[x + i * n + p] * Phi[o + p * n + j]
                t[i * n + j] = s
        for i in range(n):
            for j in range(i + 1):
                s = 0.0
                for p in range(n):
                    s += Phi[o + p * n + i] * t[p * n + j]
                M[at] += factor * (s if i == j else 2.0 * s)
                at += 1
        o += n * n


@njit(**OPTIONS)
def gaps(data, s, intervals, interval, M):
    """What gaps cost, as linear functions of the covariances after a visit.

    M (P, D + 1, P + 1): [p, :, q] from the end of interval p to the first charge of interval q > p; [p, :, P] to the
    end of time. Number D is the constant.
    """
    t, _, total = space(data)
    Phi, Y = np.empty(total), np.empty(total)
    P = len(interval)
    D = M.shape[1] - 1
    sizes, charges = data[0], data[10]
    line = np.empty(D)
    for p in range(P):
        o = 0
        for b in range(len(sizes)):
            n = sizes[b, 0]
            for i in range(n * n):
                Phi[o + i] = 0.0
                Y[o + i] = 0.0
            for i in range(n):
                Phi[o + i * n + i] = 1.0
            o += n * n
        line[:] = 0.0
        constant = 0.0
        q = p + 1
        for k in range(interval[p] + 1, intervals):
            for step in range(k * s, k * s + s):
                _move(data, step, Phi, t)
                predict(data, step, Y, t)
                now = trace(data, 2, Y)
                if step == k * s and q < P and interval[q] == k:
                    _charge(data, 2, charges[step, 0], Phi, t, line)
                    constant += charges[step, 0] * now
                    M[p, :D, q] = line
                    M[p, D, q] = constant
                    _charge(data, 2, charges[step, 1], Phi, t, line)
                    constant += charges[step, 1] * now
                    q += 1
                else:
                    factor = charges[step, 0] + charges[step, 1]
                    _charge(data, 2, factor, Phi, t, line)
                    constant += factor * now
        _move(data, len(data[9]), Phi, t)
        predict(data, len(data[9]), Y, t)
        _charge(data, 1, 1.0, Phi, t, line)
        constant += trace(data, 1, Y)
        M[p, :D, P] = line
        M[p, D, P] = constant

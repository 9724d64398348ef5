"""Compiled: the covariance of a cycle that is repeated for ever, and what the cycle costs a step.

The map of a word is S -> Q + F (S^-1 + L)^-1 F'. Maps of this form follow each other in closed form, so that a cycle is
one of them, and doubling it again and again forgets where it began.
Source: Anderson (1978), the doubling algorithm for Riccati equations.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from occontrol.scheduling.periodic.kernels import HUGE, charge_of, predict, update
from occontrol.scheduling.periodic.matrices import OPTIONS, even, left, plus_identity, product, right, solve, trace

DOUBLINGS = 60


@njit(**OPTIONS)
def follow(F1, Q1, L1, F2, Q2, L2):
    """The map (F, Q, L), each (n, n), of two maps one after the other."""
    n = F1.shape[0]
    both = np.empty((n, 2 * n))
    both[:, :n], both[:, n:] = F1, Q1
    both = solve(plus_identity(product(Q1, L2)), both)
    E, N = both[:, :n].copy(), both[:, n:].copy()
    F = product(F2, E)
    Q = Q2 + right(product(F2, N), F2)
    L = L1 + left(F1, product(L2, E))
    return F, even(Q), even(L)


@njit(**OPTIONS)
def settle(F, Q, L, word, start):
    """The prior covariance (n, n) at the start of a cycle that is repeated for ever, and whether there is one."""
    a = word[0]
    f, q, m = F[a].copy(), Q[a].copy(), L[a].copy()
    for k in range(1, word.shape[0]):
        a = word[k]
        f, q, m = follow(f, q, m, F[a], Q[a], L[a])
    S = start.copy()
    for _ in range(DOUBLINGS):
        X = predict(f, q, update(start, m))
        if not trace(X) < HUGE:
            return S, False
        change = np.max(np.abs(X - S))
        S = X
        if change <= 1e-13 * trace(S):
            return S, True
        f, q, m = follow(f, q, m, f, q, m)
        if not (np.isfinite(np.sum(f)) and np.isfinite(np.sum(q)) and np.isfinite(np.sum(m))):
            return S, False
    return S, False


@njit(**OPTIONS)
def cycle_cost(F, Q, L, seen, weight, constant, word, start, priors):
    """Mean charge a step of a cycle for ever, inf where its covariance has no limit; fills priors (p+1, n, n)."""
    S, settled = settle(F, Q, L, word, start)
    if not settled:
        return np.inf
    total = 0.0
    priors[0] = S
    for k in range(word.shape[0]):
        a = word[k]
        total += charge_of(S, seen[a], weight[a], constant[a])
        S = predict(F[a], Q[a], update(S, L[a]))
        priors[k + 1] = S
    if not np.max(np.abs(priors[-1] - priors[0])) <= 1e-8 * trace(S):
        return np.inf
    return total / word.shape[0]

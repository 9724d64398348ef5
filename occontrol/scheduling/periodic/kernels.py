"""Compiled: the value of a word from a prior information, with its gradient, and its minimum from below."""

from __future__ import annotations

import numpy as np
from numba import njit

from occontrol.scheduling.periodic.matrices import (
    OPTIONS,
    eigen,
    even,
    inner,
    left,
    plus_identity,
    product,
    right,
    solve,
    trace,
)

HUGE = 1e13  # a covariance beyond this, in units of the smallest one, is taken for lost
LOWEST = 1e-9  # smallest eigenvalue of a prior information that is looked at
BEYOND = 1.0 + 1e-12  # the domain is taken a little larger than it is
ROUNDING = 1e-15  # of what is added up, for every state: what a bound is lowered by


@njit(**OPTIONS)
def is_zero(A):
    """Whether every entry of A (n, n) is 0."""
    for x in A.flat:
        if x != 0.0:
            return False
    return True


@njit(**OPTIONS)
def update(S, L):
    """(S^-1 + L)^-1, symmetric (n, n)."""
    if is_zero(L):
        return S.copy()
    return even(solve(plus_identity(product(S, L)), S))


@njit(**OPTIONS)
def predict(F, Q, S):
    """Q + F S F' (n, n)."""
    X = right(product(F, S), F)
    for i in range(X.shape[0]):
        for j in range(X.shape[1]):
            X[i, j] += Q[i, j]
    return even(X)


@njit(**OPTIONS)
def charge_of(S, seen, weight, constant):
    """constant + sum_i tr(M_i (S^-1 + O_i)^-1) from S (n, n), seen and weight (C, n, n)."""
    total = constant
    for i in range(seen.shape[0]):
        total += inner(weight[i], update(S, seen[i]))
    return total


@njit(**OPTIONS)
def gain_of(after, L):
    """K = I - (S^-1 + L)^-1 L: what is left of an error, from (S^-1 + L)^-1 and L (n, n)."""
    K = product(after, L)
    for i in range(K.shape[0]):
        for j in range(K.shape[1]):
            K[i, j] = -K[i, j]
    return plus_identity(K)


@njit(**OPTIONS)
def costate(F, L, seen, weight, S, P):
    """The derivative by S of a step's charge and of tr(P S'), all (n, n): one letter, from prior S and next P."""
    D = product(F, gain_of(update(S, L), L))
    X = left(D, product(P, D))
    for i in range(seen.shape[0]):
        if is_zero(seen[i]):
            X += weight[i]
        else:
            K = gain_of(update(S, seen[i]), seen[i])
            X += left(K, product(weight[i], K))
    return even(X)


@njit(**OPTIONS)
def evaluate(F, Q, L, seen, weight, constant, word, before, after, U, G):
    """Value of a word, the sum of what it adds up, and the largest trace; fills G (n, n) with the gradient by U (n, n).

    value(U) = charges of the word + tr(before U) - tr(after Phi(U)); letters as in `Letters`, before and after (n, n).
    An overflow returns a value of inf.
    """
    n, T = U.shape[0], word.shape[0]
    eye = plus_identity(np.zeros((n, n)))
    priors = np.empty((T + 1, n, n))
    S = even(solve(U.copy(), eye))
    priors[0] = S
    value = inner(before, U)
    size, largest = abs(value), trace(S)
    for k in range(T):
        a = word[k]
        charge = charge_of(S, seen[a], weight[a], constant[a])
        value += charge
        size += abs(charge)
        S = predict(F[a], Q[a], update(S, L[a]))
        priors[k + 1] = S
        largest = max(largest, trace(S))
        if not largest < HUGE:
            return np.inf, np.inf, np.inf
    Y = even(solve(S.copy(), eye))
    last = inner(after, Y)
    value -= last
    size += abs(last)
    P = product(Y, product(after, Y))
    for k in range(T - 1, -1, -1):
        a = word[k]
        P = costate(F[a], L[a], seen[a], weight[a], priors[k], P)
    P = product(priors[0], product(P, priors[0]))
    for i in range(n):
        for j in range(n):
            G[i, j] = before[i, j] - P[i, j]
    even(G)
    return value, size, largest


@njit(**OPTIONS)
def clipped(X):
    """The symmetric X (n, n) with eigenvalues moved into [LOWEST, 1]."""
    V = np.empty_like(X)
    values = eigen(X, V)
    W = V.copy()
    for j in range(len(values)):
        x = min(max(values[j], LOWEST), 1.0)
        for i in range(len(values)):
            W[i, j] *= x
    return even(right(W, V))


@njit(**OPTIONS)
def below(value, U, G):
    """The least that a convex function with this value and gradient (n, n) at U (n, n) can be on 0 <= U <= 1."""
    least = value - inner(G, U)
    for x in eigen(G, np.empty_like(G)):
        least += min(x, 0.0) * BEYOND
    return least


@njit(**OPTIONS)
def minimise(F, Q, L, seen, weight, constant, word, before, after, start, enough, most, fine):
    """A proven lower bound of a word's value on 0 <= U <= 1: (bound, value, allowance, U) by projected gradients.

    Ends when the bound is at least `enough`, when bound and value are within `fine`, or after `most` evaluations. The
    allowance is what rounding may have done to the bound.
    """
    n = start.shape[0]
    U, G, H = start.copy(), np.empty((n, n)), np.empty((n, n))
    value, size, largest = evaluate(F, Q, L, seen, weight, constant, word, before, after, U, G)
    best, where, allowance, lowest = -np.inf, U.copy(), 0.0, value
    if not np.isfinite(value):
        return best, value, allowance, where
    strongest = 0.0
    for k in range(word.shape[0]):
        strongest = max(strongest, trace(L[word[k]]))
    recent = np.full(5, value)
    length = np.sqrt(inner(G, G))
    step = 0.1 / length if length > 0 else 1.0
    for count in range(most):
        bound = below(value, U, G)
        slack = ROUNDING * n * (1 + strongest) * (1 + largest) * (size + np.sum(np.abs(G)))
        if bound - slack > best - allowance:
            best, where, allowance = bound, U.copy(), slack
        lowest = min(lowest, value)
        if best - allowance >= enough or lowest - best <= fine:
            break
        D = clipped(U - step * G) - U
        slope = inner(G, D)
        if slope > -ROUNDING * size:
            break
        share, reference, moved = 1.0, np.max(recent), False
        V, new, new_size, new_largest = U, value, size, largest
        for _ in range(25):
            V = U + share * D
            new, new_size, new_largest = evaluate(F, Q, L, seen, weight, constant, word, before, after, V, H)
            if np.isfinite(new) and new <= reference + 1e-4 * share * slope:
                moved = True
                break
            share *= 0.4
        if not moved:
            break
        change = V - U
        bent = inner(change, H - G)
        step = min(max(inner(change, change) / bent if bent > 0 else step * 4, 1e-12), 1e6)
        U, value, size, largest = V, new, new_size, new_largest
        G[:] = H
        recent[count % 5] = value
    return best, lowest, allowance, where

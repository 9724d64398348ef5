"""The covariance recursion of one epoch in compiled code, for searches that walk it a million times.

Unknown: a square root S of the covariance, P = S S', so that nothing can turn indefinite. Whitened measurement rows
enter one at a time by Potter's update; the time update triangularises [F S, Gamma]' by Householder reflections.
Shares no code with the V-Lambda filter, whose covariance it must reproduce.
"""

from __future__ import annotations

import numpy as np
from numba import njit

TRACE, LARGEST_EIGENVALUE = 0, 1


@njit(cache=True)
def _measure(root: np.ndarray, rows: np.ndarray, carried: np.ndarray) -> None:
    """S <- S - gamma S phi phi', phi = S'c, for every row c of unit noise (Potter; rows of zeros are padding)."""
    n = root.shape[0]
    for i in range(rows.shape[0]):
        total = 1.0
        for j in range(n):
            value = 0.0
            for l in range(n):  # noqa: E741
                value += root[l, j] * rows[i, l]
            carried[j] = value
            total += value * value
        if total == 1.0:
            continue
        weight = 1.0 / (total + np.sqrt(total))
        for l in range(n):  # noqa: E741
            value = 0.0
            for j in range(n):
                value += root[l, j] * carried[j]
            value *= weight
            for j in range(n):
                root[l, j] -= value * carried[j]


@njit(cache=True)
def _propagate(root: np.ndarray, transition: np.ndarray, noise_root: np.ndarray, array: np.ndarray) -> None:
    """S <- lower triangle of [F S, Gamma], by Householder reflections of its transpose in `array` (n+p, n)."""
    n, p = noise_root.shape
    for i in range(n):
        for j in range(n):
            value = 0.0
            for l in range(n):  # noqa: E741
                value += transition[i, l] * root[l, j]
            array[j, i] = value
        for j in range(p):
            array[n + j, i] = noise_root[i, j]
    for c in range(n):
        norm = 0.0
        for i in range(c, n + p):
            norm += array[i, c] * array[i, c]
        norm = np.sqrt(norm)
        if norm > 0.0:
            alpha = -norm if array[c, c] > 0.0 else norm
            head = array[c, c] - alpha
            if head != 0.0:
                scale = -head * alpha
                for d in range(c + 1, n):
                    value = head * array[c, d]
                    for i in range(c + 1, n + p):
                        value += array[i, c] * array[i, d]
                    value /= scale
                    array[c, d] -= value * head
                    for i in range(c + 1, n + p):
                        array[i, d] -= value * array[i, c]
            array[c, c] = alpha
        for i in range(n):
            root[i, c] = array[c, i] if i >= c else 0.0


@njit(cache=True)
def _measure_of(root: np.ndarray, kind: int) -> float:
    if kind == TRACE:
        return np.sum(root * root)
    if root.shape[0] == 1:
        return root[0, 0] ** 2
    return np.linalg.eigvalsh(root @ root.T)[-1]


@njit(cache=True)
def advance(root: np.ndarray, transition: np.ndarray, noise_root: np.ndarray, rows: np.ndarray, kind: int) -> float:
    """Walk one epoch in place and return the sum of the criterion over its posterior covariances.

    Parameters
    ----------
    root : (n, n) C-ordered, root of P(k|k-1) at the start; overwritten by that of the next epoch's start
    transition : (N, n, n), noise_root : (N, n, p), rows : (N, m, n) whitened measurement rows, zero rows allowed
    kind : TRACE or LARGEST_EIGENVALUE
    """
    n, p = root.shape[0], noise_root.shape[2]
    array, carried = np.empty((n + p, n)), np.empty(n)
    cost = 0.0
    for k in range(len(transition)):
        _measure(root, rows[k], carried)
        cost += _measure_of(root, kind)
        _propagate(root, transition[k], noise_root[k], array)
    return cost


@njit(cache=True)
def expand(
    roots: np.ndarray, transition: np.ndarray, noise_root: np.ndarray, rows: np.ndarray, kind: int
) -> tuple[np.ndarray, np.ndarray]:
    """Walk one epoch from B nodes with each of C candidates.

    Parameters
    ----------
    roots : (B, n, n)
    transition, noise_root : (N, n, n), (N, n, p)
    rows : (C, N, m, n)
    kind : as in `advance`

    Returns
    -------
    (B, C, n, n) roots at the next epoch's start, (B, C) costs of this epoch.
    """
    count, n = roots.shape[0], roots.shape[1]
    choices = rows.shape[0]
    after, costs = np.empty((count, choices, n, n)), np.empty((count, choices))
    for b in range(count):
        for c in range(choices):
            after[b, c] = roots[b]
            costs[b, c] = advance(after[b, c], transition, noise_root, rows[c], kind)
    return after, costs


@njit(cache=True)
def _dominates(small: np.ndarray, large: np.ndarray, factor: float, work: np.ndarray) -> bool:
    """Whether factor * large - small is positive semidefinite, by Cholesky with slack at rounding level."""
    n = small.shape[0]
    for i in range(n):
        if factor * large[i, i] < small[i, i]:
            return False
    slack = 0.0
    for i in range(n):
        slack = max(slack, small[i, i])
    slack *= 1e-14
    for j in range(n):
        pivot = factor * large[j, j] - small[j, j] + slack
        for l in range(j):  # noqa: E741
            pivot -= work[j, l] * work[j, l]
        if pivot <= 0.0:
            return False
        work[j, j] = np.sqrt(pivot)
        for i in range(j + 1, n):
            value = factor * large[i, j] - small[i, j]
            for l in range(j):  # noqa: E741
                value -= work[i, l] * work[j, l]
            work[i, j] = value / work[j, j]
    return True


@njit(cache=True)
def undominated(covariances: np.ndarray, costs: np.ndarray, upper: float) -> np.ndarray:
    """Which of N nodes no cheaper node makes superfluous.

    Node a makes node b superfluous when P_a <= (1 + e) P_b with e (upper - cost_b) <= cost_b - cost_a. For then, with V
    the least cost to go, V(P_a) <= (1 + e) V(P_b) (the recursion and the criterion are monotone and subhomogeneous), so
    either b cannot beat `upper` or a's best completion costs no more than b's.

    Parameters
    ----------
    covariances : (N, n, n), costs : (N,) ascending, upper : cost of a known sequence

    Returns
    -------
    (N,) bool
    """
    count, n = len(costs), covariances.shape[1]
    keep = np.ones(count, dtype=np.bool_)
    kept = np.empty(count, dtype=np.int64)
    size = 0
    work = np.zeros((n, n))
    for b in range(count):
        room = upper - costs[b]
        for i in range(size):
            a = kept[i]
            factor = 1.0 + (costs[b] - costs[a]) / room if room > 0.0 else np.inf
            if factor == np.inf or _dominates(covariances[a], covariances[b], factor, work):
                keep[b] = False
                break
        if keep[b]:
            kept[size] = b
            size += 1
    return keep

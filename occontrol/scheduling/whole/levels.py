"""Levels of what a target knew before: covariances after a visit, that a bound may go on from instead of the true one.

Level b of open interval p is the covariance G_b(p) after visits to every e_b-th open interval back from p, e_0 = 1: the
floor, below all that can be. What a plan costs from p on is concave in the covariance S after p and grows with it, and
so is the least of all plans, V. Hence

    S >= (1 - x) G_b + x G_(b+1)    gives    V(S) >= (1 - x) V(G_b) + x V(G_(b+1)).

Without levels S is put down to the floor, as if all had been looked at until then.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from occontrol.scheduling.whole.courses import Course
from occontrol.scheduling.whole.kernels import DEFLATED, OPTIONS, begin, finish, pack, space, start, take

NEAR = 1.0 - 1e-6  # of the way from the floor to a level: what comes back to the same level lies above it then
HALVINGS = 7


@njit(**OPTIONS)
def _sequence(data, s, intervals, interval, visit, member, looks, every, after):
    """after (P, n) <- covariances after visits to open intervals p, p - every, ..; all looks of an interval at once."""
    t, y, total = space(data)
    taken = np.zeros(len(looks) + 1)
    S = np.empty(total)
    P = len(interval)
    for phase in range(min(every, P)):
        start(data, S)
        p = 0
        for k in range(intervals):
            begin(data, s, k, S, t)
            open_ = p < P and interval[p] == k
            here = open_ and p % every == phase
            if here:
                for v in range(visit[p], visit[p + 1]):
                    take(member, looks, v, taken, 1.0)
            finish(data, s, k, S, here, taken, t, y)
            if here:
                for v in range(visit[p], visit[p + 1]):
                    take(member, looks, v, taken, 0.0)
                after[p] = S
            p += open_


@njit(**OPTIONS)
def _positive(at, n, X, E):
    """Whether the block that begins at X[at], packed, is positive semidefinite; E (n, n) work space."""
    i = at
    for r in range(n):
        for c in range(r + 1):
            E[r, c] = X[i]
            i += 1
    for k in range(n):
        if E[k, k] < 0.0:
            return False
        for r in range(k + 1, n):
            if E[k, k] == 0.0:
                if E[r, k] != 0.0:
                    return False
                continue
            f = E[r, k] / E[k, k]
            for c in range(k + 1, r + 1):
                E[r, c] -= f * E[c, k]
    return True


@njit(**OPTIONS)
def _covers(sizes, S, A, B, x, X, E):
    """Whether S >= (1 - x) A + x B with room for rounding; packed (D,), X (D,) and E (n, n) work space."""
    for i in range(len(S)):
        X[i] = DEFLATED * S[i] - (1.0 - x) * A[i] - x * B[i]
    at = 0
    for b in range(len(sizes)):
        n = sizes[b, 0]
        if not _positive(at, n, X, E):
            return False
        at += n * (n + 1) // 2
    return True


@njit(**OPTIONS)
def part_of_the_way(sizes, S, A, B, X, E):
    """The largest x in [0, 1], nearly, with S >= (1 - x) A + x B; 0 if none is seen: S >= A is taken for granted."""
    if _covers(sizes, S, A, B, 1.0, X, E):
        return 1.0
    x, step = 0.0, 0.5
    for _ in range(HALVINGS):
        if _covers(sizes, S, A, B, x + step, X, E):
            x += step
        step *= 0.5
    return x


@njit(**OPTIONS)
def place(sizes, S, levels, X, E):
    """The level b and the part x of the way to the next that S (D,) lies above; levels (B, D)."""
    for b in range(len(levels) - 1, 0, -1):
        if _covers(sizes, S, levels[b], levels[b], 0.0, X, E):
            if b == len(levels) - 1:
                return b, 0.0
            return b, part_of_the_way(sizes, S, levels[b], levels[b + 1], X, E)
    if len(levels) == 1:
        return 0, 0.0
    return 0, part_of_the_way(sizes, S, levels[0], levels[1], X, E)


@njit(**OPTIONS)
def lies(sizes, S, A, B, floor, X, E):
    """Where S lies: x >= 0 if S >= (1 - x) A + x B, x < 0 if only S >= (1 + x) A - x floor; see `mixed`."""
    if not _covers(sizes, S, A, A, 0.0, X, E):
        return part_of_the_way(sizes, S, floor, A, X, E) - 1.0
    return part_of_the_way(sizes, S, A, B, X, E)


@njit(**OPTIONS)
def mixed(values, v, c, b, x):
    """What is proven of a concave function that grows, from its values (V, C, B): x of the way from lump c to the next.

    Where x < 0, -x of the way from level b to the floor.
    """
    if x > 0.0:
        return (1.0 - x) * values[v, c, b] + x * values[v, c + 1, b]
    if x < 0.0:
        return (1.0 + x) * values[v, c, b] - x * values[v, c, 0]
    return values[v, c, b]


def levels(course: Course, every: tuple[int, ...]) -> np.ndarray:
    """(P, B, D) packed covariances of every level after every open interval.

    Parameters
    ----------
    course : Course
    every : (B,) open intervals from visit to visit, 1 first and ascending
    """
    P, D = len(course.interval), course.size
    found = np.zeros((P, len(every), D))
    after = np.zeros((P, int(np.sum(course.data[0][:, 0] ** 2))))
    where = course.data, course.substeps, course.intervals, course.interval
    for b, e in enumerate(every):
        _sequence(*where, course.visit, course.member, course.look, e, after)
        for p in range(P):
            pack(course.data, after[p], 1.0, found[p, b])
    found[:, 1:] += (1.0 - NEAR) * (found[:, :1] - found[:, 1:])
    return found


@njit(**OPTIONS)
def places(sizes, where, T, level, low, share):
    """low, share (V, C, B) <- the place of every T (V, C, B, D) among the levels (P, B, D) of its interval."""
    V, C, B, D = T.shape
    n = 1
    for b in range(len(sizes)):
        n = max(n, sizes[b, 0])
    X, E = np.empty(D), np.empty((n, n))
    for v in range(V):
        for c in range(C):
            for b in range(B if c < C - 1 else 1):
                low[v, c, b], share[v, c, b] = place(sizes, T[v, c, b], level[where[v]], X, E)

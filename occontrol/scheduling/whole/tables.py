"""Covariances after a visit from below, and what gaps cost: what the forgetful programme needs beside prices."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numba import njit

from occontrol.scheduling.whole.courses import Course
from occontrol.scheduling.whole.kernels import (
    DEFLATED,
    OPTIONS,
    begin,
    ending,
    finish,
    gaps,
    pack,
    predict,
    space,
    start,
    take,
    unpack,
)  # fmt: skip
from occontrol.scheduling.whole.levels import levels, lies, places

SINGLE = 5  # gaps, in open intervals, that have a lump of their own at least
GROWTH = 1.2


@dataclass(frozen=True, eq=False)
class Tables:
    """What does not depend on prices.

    Parameters
    ----------
    T : (V, C, B, D) covariances after a visit, from below, packed, from every level of the visit before; lump C - 1
        stands for no visit before, exactly, in level 0 alone
    visit : (V, C, B) what the interval of the visit costs after its first charge
    gap : (P, D+1, P+1) linear functions, see kernels.gaps
    first : (V,) what comes before the first visit
    never : what is charged without any
    lump : (P,) of a gap of so many open intervals; T and `visit` are those of the shortest gap of a lump
    between : (P, P, B) [p, q]: where the covariance before a visit at q lies after a gap from p on, see levels.mixed
    level : (P, B, D) covariances after visits, see levels.py
    low, share : (V, C, B) the place of T among the levels: T >= (1 - share) level low + share level low + 1
    """

    T: np.ndarray
    visit: np.ndarray
    gap: np.ndarray
    first: np.ndarray
    never: float
    lump: np.ndarray
    between: np.ndarray
    level: np.ndarray
    low: np.ndarray
    share: np.ndarray
    _arcs: tuple[np.ndarray, np.ndarray] | None = field(default=None, init=False, repr=False)

    def arcs(self, course: Course) -> tuple[np.ndarray, np.ndarray]:
        """What the gap from a visit to each later open interval, and to the end, costs; and where v begins (V+1,).

        From at[v] on: (C, B, P - p) of visit v on open interval p.
        """
        if self._arcs is None:
            V, C, B, D = self.T.shape
            where, P = course.where, len(course.interval)
            at = np.concatenate([[0], np.cumsum(C * B * (P - where))]).astype(np.int64)
            found = np.empty(int(at[-1]))
            for v in range(V):
                p = where[v]
                part = self.gap[p, :, p + 1 :]
                out = found[at[v] : at[v + 1]].reshape(C * B, P - p)
                np.matmul(self.T[v].reshape(C * B, D), part[:D], out=out)
                out += part[D]
            object.__setattr__(self, "_arcs", (found, at))
        return self._arcs  # type: ignore[return-value]


def lumps(open_: int, single: int = SINGLE) -> np.ndarray:
    """(P,) the lump of a gap of 0 .. P - 1 open intervals; a gap of 0 has none.

    Parameters
    ----------
    open_ : P
    single : gaps that have a lump of their own
    """
    found, d, number = np.zeros(max(open_, 1), dtype=np.int64), 1, 0
    while d < open_:
        width = 1 if d <= single else int(np.ceil((GROWTH - 1) * d))
        found[d : d + width] = number
        d, number = d + width, number + 1
    return found


@njit(**OPTIONS)
def _before(data, s, intervals, interval, visit, member, looks, T, rest, first):
    """Lump C - 1: no visit before; returns what is charged without any visit."""
    t, y, total = space(data)
    P, C = len(interval), T.shape[1]
    taken = np.zeros(len(looks) + 1)
    S, other = np.empty(total), np.empty(total)
    start(data, S)
    p, cost = 0, 0.0
    for k in range(intervals):
        cost += begin(data, s, k, S, t)
        if p < P and interval[p] == k:
            for v in range(visit[p], visit[p + 1]):
                first[v] = cost
                other[:] = S
                take(member, looks, v, taken, 1.0)
                rest[v, C - 1, 0] = finish(data, s, k, other, True, taken, t, y)
                take(member, looks, v, taken, 0.0)
                pack(data, other, 1.0, T[v, C - 1, 0])
            p += 1
        cost += finish(data, s, k, S, False, taken, t, y)
    return cost + ending(data, S, t)


@njit(**OPTIONS)
def _fill(data, s, interval, visit, member, looks, lump, level, prior, T, rest):
    """All other lumps, from every level of the visit before: prior (P, P, B, D) before the visit at q, T after it."""
    t, y, total = space(data)
    P, B = len(interval), T.shape[2]
    taken = np.zeros(len(looks) + 1)
    S, other = np.empty(total), np.empty(total)
    for p in range(P):
        for b in range(B):
            unpack(data, level[p, b], S)
            q = p + 1
            for k in range(interval[p] + 1, interval[P - 1] + 1):
                predict(data, k * s, S, t)
                if interval[q] == k:
                    pack(data, S, 1.0, prior[p, q, b])
                    c = lump[q - p]
                    if q - p == 1 or lump[q - p - 1] != c:
                        for v in range(visit[q], visit[q + 1]):
                            other[:] = S
                            take(member, looks, v, taken, 1.0)
                            rest[v, c, b] = finish(data, s, k, other, True, taken, t, y)
                            take(member, looks, v, taken, 0.0)
                            pack(data, other, DEFLATED, T[v, c, b])
                    q += 1
                for step in range(k * s + 1, k * s + s):
                    predict(data, step, S, t)


@njit(**OPTIONS)
def _interpolate(sizes, lump, prior, between):
    """between <- for gaps that are not the shortest of their lump."""
    P, _, B, D = prior.shape
    n = 1
    for b in range(len(sizes)):
        n = max(n, sizes[b, 0])
    X, E = np.empty(D), np.empty((n, n))
    shortest = np.full(P + 1, P + 1)
    for d in range(P - 1, 0, -1):
        shortest[lump[d]] = d
    for p in range(P):
        for q in range(p + 1, P):
            here = shortest[lump[q - p]]
            there = shortest[lump[q - p] + 1]
            if here == q - p:
                continue
            for b in range(B):
                A = prior[q - here, q, b]
                upper = A if there > q else prior[q - there, q, b]
                x = lies(sizes, prior[p, q, b], A, upper, prior[q - here, q, 0], X, E)
                between[p, q, b] = min(x, 0.0) if there > q else x


def tables(course: Course, every: tuple[int, ...] = (1,)) -> Tables:
    """The tables of a target.

    Parameters
    ----------
    course : Course
    every : (B,) of the levels, see levels.py
    """
    P, V, D, B = len(course.interval), len(course.member) - 1, course.size, len(every)
    lump = lumps(P, max(SINGLE, every[-1]))
    C = int(np.max(lump, initial=0)) + 2
    T, rest = np.zeros((V, C, B, D)), np.zeros((V, C, B))
    first, low, share = np.zeros(V), np.zeros((V, C, B), dtype=np.int64), np.zeros((V, C, B))
    where = course.data, course.substeps, course.intervals, course.interval
    looks = course.visit, course.member, course.look
    level = levels(course, every)
    never = _before(*where, *looks, T, rest, first)
    prior, between = np.empty((P, P, B, D)), np.zeros((P, P, B))
    _fill(course.data, course.substeps, course.interval, *looks, lump, level, prior, T, rest)
    _interpolate(course.data[0], lump, prior, between)
    if B > 1:
        places(course.data[0], course.where, T, level, low, share)
    gap = np.zeros((P, D + 1, P + 1))
    gaps(*where, gap)
    return Tables(T, rest, gap, first, float(never), lump, between, level, low, share)

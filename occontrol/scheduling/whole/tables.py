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
    space,
    start,
    take,
)  # fmt: skip

SINGLE = 5  # gaps, in open intervals, that have a lump of their own
GROWTH = 1.4


@dataclass(frozen=True, eq=False)
class Tables:
    """What does not depend on prices.

    Parameters
    ----------
    T : (V, C, D) covariances after a visit, from below, packed; lump C - 1 stands for no visit before, exactly
    visit : (V, C) what the interval of the visit costs after its first charge
    gap : (P, D+1, P+1) linear functions, see kernels.gaps
    first : (V,) what comes before the first visit; never : what is charged without any
    lump : (P,) of a gap of so many open intervals
    """

    T: np.ndarray
    visit: np.ndarray
    gap: np.ndarray
    first: np.ndarray
    never: float
    lump: np.ndarray
    _arcs: np.ndarray | None = field(default=None, init=False, repr=False)

    def arcs(self, course: Course) -> np.ndarray:
        """(V, C, P+1) what the gap from a visit to a later interval, or to the end, costs."""
        if self._arcs is None:
            V, C, D = self.T.shape
            where = course.where
            found = np.empty((V, C, self.gap.shape[2]))
            for v in range(V):
                part = self.gap[where[v]]
                np.matmul(self.T[v], part[:D], out=found[v])
                found[v] += part[D]
            object.__setattr__(self, "_arcs", found)
        return self._arcs  # type: ignore[return-value]


def lumps(open_: int) -> np.ndarray:
    """(P,) the lump of a gap of 0 .. P - 1 open intervals; a gap of 0 has none.

    Parameters
    ----------
    open_ : P
    """
    found, d, number = np.zeros(max(open_, 1), dtype=np.int64), 1, 0
    while d < open_:
        width = 1 if d <= SINGLE else int(np.ceil((GROWTH - 1) * d))
        found[d : d + width] = number
        d, number = d + width, number + 1
    return found


@njit(**OPTIONS)
def _fill(data, s, intervals, interval, visit, member, looks, lump, T, rest, first):
    """Tables without gaps; returns what is charged without any visit."""
    t, y, total = space(data)
    P, C = len(interval), T.shape[1]
    taken = np.zeros(len(looks) + 1)
    S, other = np.empty(total), np.empty(total)
    after = np.empty((P, total))
    start(data, S)
    p = 0
    for k in range(intervals):  # visits everywhere, all looks of an interval at once
        begin(data, s, k, S, t)
        here = p < P and interval[p] == k
        if here:
            for v in range(visit[p], visit[p + 1]):
                take(member, looks, v, taken, 1.0)
        finish(data, s, k, S, here, taken, t, y)
        if here:
            for v in range(visit[p], visit[p + 1]):
                take(member, looks, v, taken, 0.0)
            after[p] = S
            p += 1
    start(data, S)
    p, cost = 0, 0.0
    for k in range(intervals):  # no visit before
        cost += begin(data, s, k, S, t)
        if p < P and interval[p] == k:
            for v in range(visit[p], visit[p + 1]):
                first[v] = cost
                other[:] = S
                take(member, looks, v, taken, 1.0)
                rest[v, C - 1] = finish(data, s, k, other, True, taken, t, y)
                take(member, looks, v, taken, 0.0)
                pack(data, other, 1.0, T[v, C - 1])
            p += 1
        cost += finish(data, s, k, S, False, taken, t, y)
    never = cost + ending(data, S, t)
    for p in range(P):
        S[:] = after[p]
        q = p + 1
        for k in range(interval[p] + 1, interval[P - 1] + 1):
            begin(data, s, k, S, t)
            if interval[q] == k:
                c = lump[q - p]
                if q - p == 1 or lump[q - p - 1] != c:
                    for v in range(visit[q], visit[q + 1]):
                        other[:] = S
                        take(member, looks, v, taken, 1.0)
                        rest[v, c] = finish(data, s, k, other, True, taken, t, y)
                        take(member, looks, v, taken, 0.0)
                        pack(data, other, DEFLATED, T[v, c])
                q += 1
            finish(data, s, k, S, False, taken, t, y)
    return never


def tables(course: Course) -> Tables:
    """The tables of a target.

    Parameters
    ----------
    course : Course
    """
    P, V, D = len(course.interval), len(course.member) - 1, course.size
    lump = lumps(P)
    C = int(np.max(lump, initial=0)) + 2
    T, rest = np.zeros((V, C, D)), np.zeros((V, C))
    first = np.zeros(V)
    where = course.data, course.substeps, course.intervals, course.interval
    never = _fill(*where, course.visit, course.member, course.look, lump, T, rest, first)
    gap = np.zeros((P, D + 1, P + 1))
    gaps(*where, gap)
    return Tables(T, rest, gap, first, float(never), lump)

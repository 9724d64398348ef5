"""The least that a target can cost at given prices, from below: a dynamic programme that forgets.

Order is kept: S <= S' before an interval gives S+ <= S+' after it, whatever is done there. So after a visit at v with
the one before on an earlier interval u,

    S >= T(v, u) = what follows on v from f(u) without a look between,

f(u) the covariance after a visit of all kinds on every open interval 0 .. u from the start. The same T serves for all
earlier u that a lump holds, with u its latest interval: a longer gap leaves more. Then

    V(v, c) = min{ end(T), min_w gap(T; v, w) + due_w + visit(w, c') + V(w, c') },   c' the lump of v before w,

m >= min{ never, min_v first(v) + due_v + visit(v, start) + V(v, start) }. A gap costs what is linear in T (kernels.py);
`visit` is what the rest of the interval of a visit costs. Before the first visit everything is exact.
"""

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
FAST = {**OPTIONS, "fastmath": {"contract", "nsz", "nnan", "reassoc"}}


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


@njit(**FAST)
def _least(A, onward, a, z):
    """The least of A + onward from a to z - 1."""
    best = np.inf
    for q in range(a, z):
        best = min(best, A[q] + onward[q])
    return best


@njit(**OPTIONS)
def onward_from(p, last, visit, lump, due, rest, value, onward):
    """onward (P+1,) <- the least that follows from a visit at q > p on, the one before at `last`; 0 for the end."""
    P, C = len(visit) - 1, rest.shape[1]
    for q in range(p + 1, P):
        b = lump[q - last] if last >= 0 else C - 1
        x = np.inf
        for w in range(visit[q], visit[q + 1]):
            x = min(x, due[w] + rest[w, b] + value[w, b])
        onward[q] = x
    onward[P] = 0.0


@njit(**OPTIONS)
def _backward(arcs, rest, first, never, lump, visit, due, value):
    """value (V, C) <- V; returns the least of all."""
    P, C = len(visit) - 1, rest.shape[1]
    onward = np.empty(P + 1)
    for p in range(P - 1, -1, -1):
        onward_from(p, p, visit, lump, due, rest, value, onward)
        for v in range(visit[p], visit[p + 1]):
            for c in range(C - 1 if p == 0 else 0, C):
                value[v, c] = _least(arcs[v, c], onward, p + 1, P + 1)
    best = never
    for v in range(len(first)):
        best = min(best, first[v] + due[v] + rest[v, C - 1] + value[v, C - 1])
    return best


@njit(**OPTIONS)
def _path(arcs, rest, first, never, lump, visit, due, value):
    """The visits behind the least of all, and how many they are."""
    P, C = len(visit) - 1, rest.shape[1]
    found, size = np.empty(P, dtype=np.int64), 0
    best, v = never, -1
    for w in range(len(first)):
        x = first[w] + due[w] + rest[w, C - 1] + value[w, C - 1]
        if x < best:
            best, v = x, w
    p, c = 0, C - 1
    while v >= 0:
        while visit[p + 1] <= v:
            p += 1
        found[size] = v
        size += 1
        best, to, b = arcs[v, c, P], -1, 0
        for q in range(p + 1, P):
            d = lump[q - p]
            for w in range(visit[q], visit[q + 1]):
                x = arcs[v, c, q] + due[w] + rest[w, d] + value[w, d]
                if x < best:
                    best, to, b = x, w, d
        v, c = to, b
    return found[:size]


@dataclass(frozen=True, eq=False)
class Plan:
    """What a target does at given prices.

    Parameters
    ----------
    bound : it costs no less
    visits : that the bound comes from, ascending
    value : (V, C) cost to go after the interval of a visit, from below
    """

    bound: float
    visits: np.ndarray
    value: np.ndarray


def plan(course: Course, table: Tables, due: np.ndarray) -> Plan:
    """The least that a target costs with visits at `due` (V,), from below.

    Parameters
    ----------
    course : Course
    table : Tables of it
    due : (V,) what a visit costs, not negative
    """
    V, C = table.visit.shape
    value, arcs = np.zeros((V, C)), table.arcs(course)
    known = arcs, table.visit, table.first, table.never, table.lump, course.visit, due, value
    bound = _backward(*known)
    return Plan(float(bound), _path(*known), value)


@njit(**OPTIONS)
def _cost(data, s, intervals, interval, visit, member, looks, visits):
    t, y, total = space(data)
    taken = np.zeros(len(looks) + 1)
    S = np.empty(total)
    start(data, S)
    cost, at, p = 0.0, 0, 0
    for k in range(intervals):
        cost += begin(data, s, k, S, t)
        while p < len(interval) - 1 and interval[p] < k:
            p += 1
        here = at < len(visits) and visit[p] <= visits[at] < visit[p + 1] and interval[p] == k
        if here:
            take(member, looks, visits[at], taken, 1.0)
        cost += finish(data, s, k, S, here, taken, t, y)
        if here:
            take(member, looks, visits[at], taken, 0.0)
            at += 1
    return cost + ending(data, S, t)


def cost_of(course: Course, visits: np.ndarray) -> float:
    """What a target costs with these visits, ascending, without what the looks cost.

    Parameters
    ----------
    course : Course
    visits : (n,) numbers of visits
    """
    return float(
        _cost(
            course.data,
            course.substeps,
            course.intervals,
            course.interval,
            course.visit,
            course.member,
            course.look,
            np.asarray(visits, dtype=np.int64),
        )
    )

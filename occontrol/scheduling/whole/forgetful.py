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

from dataclasses import dataclass

import numpy as np
from numba import njit

from occontrol.scheduling.whole.courses import Course
from occontrol.scheduling.whole.kernels import OPTIONS, begin, ending, finish, space, start, take
from occontrol.scheduling.whole.tables import Tables

FAST = {**OPTIONS, "fastmath": {"contract", "nsz", "nnan", "reassoc"}}


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

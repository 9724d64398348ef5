"""The least that a target can cost at given prices, from below: a dynamic programme that forgets.

Order is kept: S <= S' before an interval gives S+ <= S+' after it, whatever is done there. So after a visit at v with
the one before on an earlier interval u,

    S >= T(v, u, G) = what follows on v from G without a look between, where the covariance after u was >= G,

G one of the levels of levels.py. A lump c of gaps stands for its shortest; what is before the look after another gap
lies above a mixture of that of two lumps. T lies above a mixture of the levels of its own interval, the part x of the
way from level b to the next. Then, as costs to go are concave and grow with S,

    V(v, c, a) = min{ end(T), min_w gap(T; v, w) + (1 - x) H_w(b) + x H_w(b + 1) },
    H_w(b) = min over visits w of an interval: due_w + the same mixture of visit(w, c', b) + V(w, c', b) over lumps c',

m >= min{ never, min_v first(v) + due_v + visit(v, start) + V(v, start) }. A gap costs what is linear in T (kernels.py);
`visit` is what the rest of the interval of a visit costs. Before the first visit everything is exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from occontrol.scheduling.whole.courses import Course
from occontrol.scheduling.whole.kernels import OPTIONS, begin, ending, finish, space, start, take
from occontrol.scheduling.whole.levels import mixed
from occontrol.scheduling.whole.tables import Tables

PART = 16  # gaps that are looked at together
FAST = {**OPTIONS, "fastmath": {"contract", "nsz", "nnan", "reassoc"}}


@njit(**FAST)
def _least(A, one, two, x, a):
    """The least of A[q] + (1 - x) one[q + a] + x two[q + a]."""
    best = np.inf
    for q in range(len(A)):
        best = min(best, A[q] + (1.0 - x) * one[q + a] + x * two[q + a])
    return best


@njit(**OPTIONS)
def onward_from(p, last, visit, lump, between, due, total, onward):
    """onward (B, P+1) <- the least that follows from a visit at q > p on, the one before at `last`; 0 for the end.

    `last` is -1 where there was none. Of a level is said what its own values say, or the floor's where that is more.
    """
    P, C, B = len(visit) - 1, total.shape[1], total.shape[2]
    for q in range(p + 1, P):
        onward[:, q] = np.inf
        for v in range(visit[q], visit[q + 1]):
            if last < 0:
                onward[:, q] = np.minimum(onward[:, q], due[v] + total[v, C - 1, 0])
                continue
            c = lump[q - last]
            floor = mixed(total, v, c, 0, between[last, q, 0])
            for b in range(B):
                x = max(floor, mixed(total, v, c, b, between[last, q, b])) + due[v]
                if x < onward[b, q]:
                    onward[b, q] = x
    onward[:, P] = 0.0


@njit(**OPTIONS)
def _best_of(q, last, b, visit, lump, between, due, total):
    """The visit at open interval q behind `onward_from`, the one before at `last`, and the level that says it."""
    c = lump[q - last]
    best, to, level = np.inf, -1, b
    for v in range(visit[q], visit[q + 1]):
        x, at = mixed(total, v, c, b, between[last, q, b]), b
        floor = mixed(total, v, c, 0, between[last, q, 0])
        if floor > x:
            x, at = floor, 0
        if x + due[v] < best:
            best, to, level = x + due[v], v, at
    return to, level


@njit(**OPTIONS)
def _backward(arcs, at, rest, first, never, lump, between, visit, due, low, share, value, total):
    """value (V, C, B) <- V, total <- with what is before in the interval of the visit; returns the least of all."""
    P, C, B = len(visit) - 1, rest.shape[1], rest.shape[2]
    onward = np.empty((B, P + 1))
    for p in range(P - 1, -1, -1):
        onward_from(p, p, visit, lump, between, due, total, onward)
        n = P - p
        for v in range(visit[p], visit[p + 1]):
            for c in range(C - 1 if p == 0 else 0, C):
                for b in range(B if c < C - 1 else 1):
                    o, a = at[v] + (c * B + b) * n, low[v, c, b]
                    two = onward[min(a + 1, B - 1)]
                    value[v, c, b] = _least(arcs[o : o + n], onward[a], two, share[v, c, b], p + 1)
                    total[v, c, b] = rest[v, c, b] + value[v, c, b]
    best = never
    for v in range(len(first)):
        best = min(best, first[v] + due[v] + total[v, C - 1, 0])
    return best


@njit(**OPTIONS)
def _path(arcs, at, rest, first, never, lump, between, visit, due, low, share, value, total, often):
    """One plan behind the least of all, along what has the largest part; often (V,) <- the mixture of all."""
    P, C, B = len(visit) - 1, rest.shape[1], rest.shape[2]
    found, size = np.empty(P, dtype=np.int64), 0
    best, v = never, -1
    for w in range(len(first)):
        x = first[w] + due[w] + total[w, C - 1, 0]
        if x < best:
            best, v = x, w
    if v < 0:
        return found[:0]
    part, onward = np.zeros(rest.shape), np.empty((B, P + 1))
    part[v, C - 1, 0] = 1.0
    on_v, on_c, on_b = v, C - 1, 0
    for p in range(P):
        known, n = False, P - p
        for v in range(visit[p], visit[p + 1]):
            for c in range(C):
                for b in range(B):
                    much = part[v, c, b]
                    if much == 0.0:
                        continue
                    if not known:
                        onward_from(p, p, visit, lump, between, due, total, onward)
                        known = True
                    often[v] += much
                    here = on_v == v and on_c == c and on_b == b
                    if here:
                        found[size] = v
                        size += 1
                    o, a, x = at[v] + (c * B + b) * n, low[v, c, b], share[v, c, b]
                    z = min(a + 1, B - 1)
                    best, q = arcs[o + n - 1], P
                    for r in range(p + 1, P):
                        y = arcs[o + r - p - 1] + (1.0 - x) * onward[a, r] + x * onward[z, r]
                        if y < best:
                            best, q = y, r
                    if q == P:
                        continue
                    d, most = lump[q - p], -1.0
                    for half in range(2):
                        e, m = (a, 1.0 - x) if half == 0 else (z, x)
                        if m == 0.0:
                            continue
                        w, e = _best_of(q, p, e, visit, lump, between, due, total)
                        y = between[p, q, e]
                        part[w, d, e] += much * m * (1.0 - abs(y))
                        to_d, to_e = (d + 1, e) if y > 0.0 else (d, 0)
                        if y != 0.0:
                            part[w, to_d, to_e] += much * m * abs(y)
                        if here and m > most:
                            most, on_v = m, w
                            on_c, on_b = (to_d, to_e) if abs(y) > 0.5 else (d, e)
    return found[:size]


@dataclass(frozen=True, eq=False)
class Plan:
    """What a target does at given prices.

    Parameters
    ----------
    bound : it costs no less
    visits : of one plan behind the bound, ascending
    value, total : (V, C, B) cost to go after the interval of a visit, and from its look on, from below
    often : (V,) how often the plans behind the bound visit, by their parts: bound - due.often + due'.often is at least
        the bound of this programme for any other due'
    """

    bound: float
    visits: np.ndarray
    value: np.ndarray
    total: np.ndarray
    often: np.ndarray


def plan(course: Course, table: Tables, due: np.ndarray) -> Plan:
    """The least that a target costs with visits at `due` (V,), from below.

    Parameters
    ----------
    course : Course
    table : Tables of it
    due : (V,) what a visit costs, not negative
    """
    value, total, often = np.zeros(table.visit.shape), np.zeros(table.visit.shape), np.zeros(len(due))
    arcs, at = table.arcs(course)
    fixed = table.visit, table.first, table.never, table.lump, table.between
    known = arcs, at, *fixed, course.visit, due, table.low, table.share
    bound = _backward(*known, value, total)
    visits = _path(*known, value, total, often)
    return Plan(float(bound), visits, value, total, often)


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

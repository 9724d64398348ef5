"""The least that a target can cost at given prices, nearly exactly: labels that are merged where they are alike.

A label is a beginning that ends with a visit v: what it has cost and the covariance after v. It goes on to every later
visit that the dynamic programme of forgetful.py, which is a lower bound of what follows, does not rule out: what
reaches the cost of a plan that is known is left. Where a visit has too many labels, two that lose little by it are
merged into one with the lesser cost and a covariance below both (meets.py), so that the least of all stays a bound.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from occontrol.scheduling.whole.courses import Course
from occontrol.scheduling.whole.forgetful import Plan, onward_from, plan
from occontrol.scheduling.whole.kernels import DEFLATED, OPTIONS, begin, finish, pack, space, take, unpack
from occontrol.scheduling.whole.meets import above, meet
from occontrol.scheduling.whole.tables import Tables


@njit(**OPTIONS)
def _search(
    data, s, intervals, interval, visit, member, looks, lump, T, rest, value, first, never, gap, due, ceiling, buckets,
    ahead,
):  # fmt: skip
    """The least cost, at most `ceiling`, and its last label with the parents of all."""
    t, y, total = space(data)
    sizes = data[0]
    P, V, C, D = len(interval), len(first), T.shape[1], T.shape[2]
    most = 1
    for b in range(len(sizes)):
        most = max(most, sizes[b, 0])
    E, U, scale = np.empty((most, most)), np.empty((most, most)), np.empty(most)
    X, new = np.empty(D), np.empty(D)
    taken = np.zeros(len(looks) + 1)
    S, other = np.empty(total), np.empty(total)
    B = buckets
    held, cost = np.empty((V * B, D)), np.full(V * B, np.inf)
    worth, parent = np.zeros(V * B), np.full(V * B, -1, dtype=np.int64)
    held_by = np.zeros(V, dtype=np.int64)
    onward, arc = np.empty(P + 1), np.empty(P + 1)
    best, last_label, count = never, -1, 0
    for p in range(P):
        for v in range(visit[p], visit[p + 1]):  # a first visit
            x = first[v] + due[v] + rest[v, C - 1]
            if x + value[v, C - 1] <= ceiling:
                _insert(
                    sizes, v, T[v, C - 1], x, -1, gap[p], min(p + ahead, P), T[v, 0], held_by, B, held, cost, worth,
                    parent, X, E, U, scale,
                )  # fmt: skip
        onward_from(p, p, visit, lump, due, rest, value, onward)
        for label in range(visit[p] * B, visit[p + 1] * B):
            c = cost[label]
            if c == np.inf:
                continue
            count += 1
            for q in range(p + 1, P + 1):
                arc[q] = gap[p, D, q]
            for d in range(D):
                x = held[label, d]
                for q in range(p + 1, P + 1):
                    arc[q] += gap[p, d, q] * x
            if c + arc[P] < best:
                best, last_label = c + arc[P], label
            last = -1
            limit = min(best, ceiling)
            for q in range(p + 1, P):
                if c + arc[q] + onward[q] <= limit:
                    last = q
            if last < 0:
                continue
            unpack(data, held[label], S)
            q = p + 1
            for k in range(interval[p] + 1, interval[last] + 1):
                begin(data, s, k, S, t)
                if interval[q] == k:
                    if c + arc[q] + onward[q] <= limit:
                        for w in range(visit[q], visit[q + 1]):
                            other[:] = S
                            take(member, looks, w, taken, 1.0)
                            x = c + arc[q] + due[w] + finish(data, s, k, other, True, taken, t, y)
                            take(member, looks, w, taken, 0.0)
                            if x + value[w, lump[q - p]] <= limit:
                                pack(data, other, DEFLATED, new)
                                _insert(
                                    sizes, w, new, x, label, gap[q], min(q + ahead, P), T[w, 0], held_by, B, held,
                                    cost, worth, parent, X, E, U, scale,
                                )  # fmt: skip
                    q += 1
                finish(data, s, k, S, False, taken, t, y)
    return best, last_label, parent, count


@njit(**OPTIONS)
def _insert(sizes, v, S, c, origin, gap, r, lowest, held_by, B, held, cost, worth, parent, X, E, U, scale):
    """A label of visit v with cost c and covariances S (D,): into a free place, or merged where least is lost.

    `worth` of a label is what its covariances cost over the next gap, r intervals on: with that alone, the lesser cost
    and the lesser worth of two labels are below the better of them by what is taken for lost.
    """
    x = 0.0
    for d in range(len(S)):
        x += gap[d, r] * S[d]
    label, least = -1, np.inf
    for other in range(v * B, v * B + held_by[v]):
        lost = min(c + x, cost[other] + worth[other]) - min(c, cost[other]) - min(x, worth[other])
        if lost < least:
            label, least = other, lost
    if label >= 0:
        there = held[label]
        if c >= cost[label] and above(sizes, S, there, X, E):
            return
        if c <= cost[label] and above(sizes, there, S, X, E):
            there[:] = S
            cost[label], worth[label], parent[label] = c, x, origin
            return
    if held_by[v] < B:
        label = v * B + held_by[v]
        held_by[v] += 1
        held[label] = S
        cost[label], worth[label], parent[label] = c, x, origin
        return
    there = held[label]
    if c + x < cost[label] + worth[label]:
        parent[label] = origin
    meet(sizes, there, S, lowest, DEFLATED, X, E, U, scale)
    cost[label] = min(cost[label], c)
    worth[label] = 0.0
    for d in range(len(S)):
        worth[label] += gap[d, r] * there[d]


def refined(
    course: Course, table: Tables, due: np.ndarray, ceiling: float, buckets: int, rough: Plan | None = None
) -> tuple[Plan, int]:
    """The least that a target costs with visits at `due` (V,), from below, and how many labels that took.

    Parameters
    ----------
    course : Course
    table : Tables of it
    due : (V,) what a visit costs, not negative
    ceiling : what some plan costs at these prices
    buckets : labels of a visit that stay apart
    rough : `plan` of the same, where it is known
    """
    rough = plan(course, table, due) if rough is None else rough
    if not rough.bound < ceiling:
        return rough, 0
    ahead = max(1, round(len(course.interval) / (len(rough.visits) + 1)))
    bound, label, parent, count = _search(
        course.data, course.substeps, course.intervals, course.interval, course.visit, course.member, course.look,
        table.lump, table.T, table.visit, rough.value, table.first, table.never, table.gap, due, ceiling, buckets,
        ahead,
    )  # fmt: skip
    visits = []
    while label >= 0:
        visits.append(label // buckets)
        label = parent[label]
    least = max(rough.bound, min(float(bound), ceiling))
    return Plan(least, np.array(visits[::-1], dtype=np.int64), rough.value), count

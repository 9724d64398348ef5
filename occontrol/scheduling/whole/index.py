"""Schedules of whole looks by the price index: looks go where prices and costs to go say that they are worth most.

At an interval, with the true covariance of every target,

    worth of a look = [charges without it + togo(S, gap since the last visit)] - [with it + togo(S+, 0)] - price,
    togo(S, ..) = min{ end(S), min_w gap(S; w) + due_w + visit(w, c) + V(w, c) },

V the costs to go of forgetful.py at prices of looks. Every resource gives its looks to those of largest worth.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from occontrol.scheduling.blocks.resources import ResourceSet
from occontrol.scheduling.whole.certificate import Chunk
from occontrol.scheduling.whole.courses import Course
from occontrol.scheduling.whole.forgetful import onward_from, plan
from occontrol.scheduling.whole.kernels import OPTIONS, begin, finish, pack, space, start, take
from occontrol.scheduling.whole.levels import place
from occontrol.scheduling.whole.tables import Tables


@njit(**OPTIONS)
def _worth(
    data, s, k, p, last, before, S, visit, member, looks, lump, between, due, total, gap, level, costs, after
):  # fmt: skip
    """costs (1 + visits,) <- of no look and of each visit of open interval p, with what follows; after: covariances.

    The visit before was at open interval `last` (-1: none), with covariances `before` after it, packed.
    """
    t, y, _ = space(data)
    P, D = gap.shape[0], gap.shape[1] - 1
    taken = np.zeros(len(looks) + 1)
    n, B = 1, level.shape[1]
    for b in range(len(data[0])):
        n = max(n, data[0][b, 0])
    onward, packed, X, E = np.empty((B, P + 1)), np.empty(D), np.empty(D), np.empty((n, n))
    begin(data, s, k, S, t)
    onward_from(p, last, visit, lump, between, due, total, onward)
    for c in range(visit[p + 1] - visit[p] + 1):
        v = visit[p] + c - 1
        after[c] = S
        if c == 1:
            onward_from(p, p, visit, lump, between, due, total, onward)
        if c:
            take(member, looks, v, taken, 1.0)
        cost = finish(data, s, k, after[c], c > 0, taken, t, y)
        if c:
            take(member, looks, v, taken, 0.0)
        pack(data, after[c], 1.0, packed)
        if c:
            a, share = place(data[0], packed, level[p], X, E)
        elif last >= 0:
            a, share = place(data[0], before, level[last], X, E)
        else:
            a, share = 0, 0.0
        z = min(a + 1, B - 1)
        best = np.inf
        for q in range(p + 1, P + 1):
            x = gap[p, D, q] + (1.0 - share) * onward[a, q] + share * onward[z, q]
            for d in range(D):
                x += gap[p, d, q] * packed[d]
            best = min(best, x)
        costs[c] = cost + best


@njit(**OPTIONS)
def _idle(data, s, first, last, S):
    """S <- after intervals first .. last - 1 without a look."""
    t, y, _ = space(data)
    taken = np.zeros(1)
    for k in range(first, last):
        begin(data, s, k, S, t)
        finish(data, s, k, S, False, taken, t, y)


class _Walker:
    """One target on its way through the intervals."""

    def __init__(self, course: Course, table: Tables, due: np.ndarray):
        self.course, self.table, self.due = course, table, due
        self.total = plan(course, table, due).total
        self.S = np.empty(int(np.sum(course.data[0][:, 0] ** 2)))
        start(course.data, self.S)
        self.place, self.last, self.reached = 0, -1, 0
        self.before = np.zeros(table.level.shape[2])
        self.costs = self.after = np.zeros(0)

    def options(self, k: int) -> tuple[np.ndarray, np.ndarray]:
        """The looks that may be taken alone on interval k, as weights of the whole problem, and what each is worth."""
        c, t, p = self.course, self.table, self.place
        _idle(c.data, c.substeps, self.reached, k, self.S)
        count = int(c.visit[p + 1] - c.visit[p]) + 1
        self.costs, self.after = np.empty(count), np.empty((count, len(self.S)))
        _worth(
            c.data, c.substeps, k, p, self.last, self.before, self.S, c.visit, c.member, c.look, t.lump, t.between,
            self.due, self.total, t.gap, t.level, self.costs, self.after,
        )  # fmt: skip
        alone = [w for w in range(1, count) if c.member[c.visit[p] + w] - c.member[c.visit[p] + w - 1] == 1]
        look = c.look[c.member[c.visit[p] + np.array(alone) - 1]]
        return c.entry[look], self.costs[0] - self.costs[alone] - c.price[look]

    def go(self, k: int, which: int | None) -> None:
        """Past interval k, with look number `which` of `options` or without."""
        self.S = self.after[0 if which is None else 1 + which].copy()
        if which is not None:
            self.last = self.place
            pack(self.course.data, self.S, 1.0, self.before)
        self.place, self.reached = self.place + 1, k + 1


def price_index(chunk: Chunk, allowed: ResourceSet, prices: np.ndarray) -> np.ndarray | None:
    """The schedule (E, 1) of the looks of largest worth; None where a target has no tables.

    Parameters
    ----------
    chunk : all targets
    allowed : ResourceSet
    prices : (S,) of the stretches
    """
    if not all(isinstance(t, Tables) for t in chunk.known):
        return None
    each = prices[chunk.stretch]
    pairs = zip(chunk.courses, chunk.known, strict=True)
    walkers = [_Walker(c, t, c.dues(each)) for c, t in pairs if isinstance(t, Tables)]
    open_: list[list[_Walker]] = [[] for _ in allowed.lengths]
    for walker in walkers:
        for k in walker.course.interval:
            open_[k].append(walker)
    x, left = np.zeros(allowed.shape[0]), allowed.capacity.astype(np.int64)
    for k, here in enumerate(open_):
        offers = []
        for number, walker in enumerate(here):
            looks, worth = walker.options(k)
            offers += [(-float(w), number, j, int(e)) for j, (e, w) in enumerate(zip(looks, worth, strict=True))]
        chosen: dict[int, int] = {}
        for worth, number, j, e in sorted(offers):
            s = chunk.stretch[e]
            if worth < 0 and number not in chosen and left[s] > 0:
                chosen[number] = j
                x[e] = 1.0
                left[s] -= 1
        for number, walker in enumerate(here):
            walker.go(k, chosen.get(number))
    x[allowed.rest] = left
    return x[:, None]

"""Every plan of a target as a tree of beginnings: what a target can cost at given prices, exactly, where it is small.

Level p decides the open interval p: no look, or one of its visits. A node costs what is charged from its own decision
on to the first charge of the next open interval, or to the end. So the cost to go of every beginning, at given prices,
takes one pass over the tree from the end.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from occontrol.scheduling.whole.courses import Course
from occontrol.scheduling.whole.kernels import OPTIONS, begin, ending, finish, space, start, take

MOST = 400_000  # beginnings of one target


@dataclass(frozen=True, eq=False)
class Beginnings:
    """The tree of one target.

    Parameters
    ----------
    course : Course
    level : (P+2,) where the nodes of each level begin; level 0 is the root alone
    choices : (P,) 1 + visits of every open interval
    cost : (nodes,) of every node by itself
    """

    course: Course
    level: np.ndarray
    choices: np.ndarray
    cost: np.ndarray

    def values(self, due: np.ndarray) -> np.ndarray:
        """(nodes,) cost to go after every node with visits at `due` (V,)."""
        found = np.zeros(len(self.cost))
        _values(self.level, self.choices, self.course.visit, self.cost, due, found)
        return found

    def best(self, due: np.ndarray) -> tuple[float, np.ndarray]:
        """The least cost at `due` (V,), and the visits that it takes."""
        value, visits, node = self.values(due), [], 0
        for p, count in enumerate(self.choices):
            child = self.level[p + 1] + (node - self.level[p]) * count + np.arange(count)
            paid = np.concatenate([[0.0], due[self.course.visit[p] : self.course.visit[p + 1]]])
            c = int(np.argmin(self.cost[child] + value[child] + paid))
            if c:
                visits.append(int(self.course.visit[p]) + c - 1)
            node = int(child[c])
        return float(self.cost[0] + value[0]), np.array(visits, dtype=np.int64)


@njit(**OPTIONS)
def _values(level, choices, visit, cost, due, value):
    for p in range(len(choices) - 1, -1, -1):
        n = choices[p]
        for node in range(level[p], level[p + 1]):
            child = level[p + 1] + (node - level[p]) * n
            best = cost[child] + value[child]
            for c in range(1, n):
                best = min(best, cost[child + c] + value[child + c] + due[visit[p] + c - 1])
            value[node] = best


@njit(**OPTIONS)
def _rest(data, s, intervals, interval, p, S, t, y, taken):
    """From the end of open interval p (-1: from the start) to the first charge of the next, or to the end."""
    P = len(interval)
    cost = 0.0
    first = interval[p] + 1 if p >= 0 else 0
    last = interval[p + 1] if p + 1 < P else intervals
    for k in range(first, last):
        cost += begin(data, s, k, S, t)
        cost += finish(data, s, k, S, False, taken, t, y)
    if last == intervals:
        return cost + ending(data, S, t)
    return cost + begin(data, s, last, S, t)


@njit(**OPTIONS)
def _costs(data, s, intervals, interval, visit, member, looks, level, choices, cost):
    t, y, total = space(data)
    P = len(interval)
    taken = np.zeros(len(looks) + 1)
    now = np.empty((1, total))
    start(data, now[0])
    cost[0] = _rest(data, s, intervals, interval, -1, now[0], t, y, taken)
    for p in range(P):
        n = choices[p]
        after = np.empty((len(now) * n, total))
        for i in range(len(now)):
            for c in range(n):
                S = after[i * n + c]
                S[:] = now[i]
                if c:
                    take(member, looks, visit[p] + c - 1, taken, 1.0)
                x = finish(data, s, interval[p], S, c > 0, taken, t, y)
                if c:
                    take(member, looks, visit[p] + c - 1, taken, 0.0)
                cost[level[p + 1] + i * n + c] = x + _rest(data, s, intervals, interval, p, S, t, y, taken)
        now = after


def beginnings(course: Course, most: int = MOST) -> Beginnings | None:
    """The tree of a target; None where it is too large or a visit stands for several sets of looks.

    Parameters
    ----------
    course : Course
    most : nodes
    """
    choices = 1 + np.diff(course.visit)
    counts = np.cumprod(np.concatenate([[1.0], choices]))
    if np.sum(counts) > most or np.max(np.diff(course.member), initial=0) > 2:
        return None
    level = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    cost = np.zeros(int(level[-1]))
    _costs(
        course.data, course.substeps, course.intervals, course.interval, course.visit, course.member, course.look,
        level, choices, cost,
    )  # fmt: skip
    return Beginnings(course, level, choices, cost)

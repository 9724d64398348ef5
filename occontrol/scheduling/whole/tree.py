"""The best schedule of whole looks, proven: depth first over intervals and targets, where targets are small.

A node has decided some visits. With the costs to go V_i of the beginnings (prefixes.py) at prices lam, no schedule
below it costs less than

    sum_i [what i has cost so far + V_i] - sum_s lam_s (looks that stretch s has left),    s not yet decided.

Children are tried in the order of that bound; what reaches the best cost known, but for a gap, is left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from occontrol.scheduling.whole.kernels import OPTIONS
from occontrol.scheduling.whole.prefixes import Beginnings


@dataclass(frozen=True, eq=False)
class Outcome:
    """What the tree found.

    Parameters
    ----------
    cost : of the best schedule, inf where none is below the one that was known
    looks : its weights' numbers, None where there is none
    bound : no schedule costs less, if the one that was known does not
    nodes : that were looked at
    finished : whether nothing is left to be tried
    """

    cost: float
    looks: np.ndarray | None
    bound: float
    nodes: int
    finished: bool


@njit(**OPTIONS)
def _search(
    owner, place, level_at, choices_at, levels, choices, nodes_at, cost, value, visit_at, visits, paid, member_at,
    members, look_at, looks, stretch, close_at, closes, left, lam, roots, best, gap, most,
):  # fmt: skip
    """Decisions d = 0 .. in order of time: open interval `place` of target `owner`. What is returned: see `search`."""
    depth = len(owner)
    node = roots.copy()  # of every target
    at = np.zeros(depth + 1, dtype=np.int64)  # the next child that is tried
    most_children = np.max(choices) if len(choices) else 1
    order = np.zeros((depth, most_children), dtype=np.int64)
    bound = np.full((depth, most_children), np.inf)
    count = np.zeros(depth, dtype=np.int64)
    before = np.zeros(depth, dtype=np.int64)
    chosen, known = np.full(depth, -1, dtype=np.int64), np.full(depth, -1, dtype=np.int64)
    so_far = np.zeros(depth + 1)  # bound of the node
    T = len(roots)
    total = 0.0
    for i in range(T):
        total += cost[nodes_at[i]] + value[nodes_at[i]]
    for s in range(len(left)):
        total -= lam[s] * left[s]
    so_far[0] = total
    found, tried, d, opened = False, 0, 0, False
    finished = True
    cut = np.inf  # the least bound among what was left out
    while True:
        if d == depth:
            if so_far[d] < best:
                best, found = so_far[d], True
                known[:] = chosen
            d -= 1
            opened = True
            continue
        i, p = owner[d], place[d]
        if not opened:
            n = choices[choices_at[i] + p]
            first = levels[level_at[i] + p + 1] + (node[i] - levels[level_at[i] + p]) * n
            before[d], count[d] = node[i], 0
            here = value[nodes_at[i] + node[i]]
            v = -1
            for c in range(n):
                x = so_far[d] - here + cost[nodes_at[i] + first + c] + value[nodes_at[i] + first + c]
                fits = True
                if c:
                    v = visits[visit_at[i] + p] + c - 1
                    x += paid[member_at[i] + v - i]
                    for a in range(members[member_at[i] + v], members[member_at[i] + v + 1]):
                        s = stretch[look_at[i] + looks[look_at[i] + a]]
                        fits = fits and left[s] > 0
                        left[s] -= 1
                        x += lam[s]
                for a in range(close_at[d], close_at[d + 1]):  # what is left of a stretch is worth nothing any more
                    x += lam[closes[a]] * left[closes[a]]
                if c:
                    for a in range(members[member_at[i] + v], members[member_at[i] + v + 1]):
                        left[stretch[look_at[i] + looks[look_at[i] + a]]] += 1
                if fits:
                    k = count[d]
                    while k > 0 and bound[d, k - 1] > x:
                        bound[d, k], order[d, k] = bound[d, k - 1], order[d, k - 1]
                        k -= 1
                    bound[d, k], order[d, k] = x, first * n + c
                    count[d] += 1
            at[d] = 0
        else:  # back from a child
            if chosen[d] >= 0:
                v = chosen[d]
                for a in range(members[member_at[i] + v], members[member_at[i] + v + 1]):
                    left[stretch[look_at[i] + looks[look_at[i] + a]]] += 1
                chosen[d] = -1
            node[i] = before[d]
        opened = False
        k = at[d]
        if k < count[d] and bound[d, k] < best - gap * abs(best) and tried < most:
            at[d] += 1
            tried += 1
            n = choices[choices_at[i] + p]
            first, c = order[d, k] // n, order[d, k] % n
            node[i] = first + c
            if c:
                v = visits[visit_at[i] + p] + c - 1
                chosen[d] = v
                for a in range(members[member_at[i] + v], members[member_at[i] + v + 1]):
                    left[stretch[look_at[i] + looks[look_at[i] + a]]] -= 1
            so_far[d + 1] = bound[d, k]
            d += 1
            continue
        if k < count[d]:
            cut = min(cut, bound[d, k])
            if tried >= most and bound[d, k] < best - gap * abs(best):
                finished = False
        d -= 1
        if d < 0:
            break
        opened = True
    return found, best, cut, tried, finished, known


def search(
    trees: Sequence[Beginnings],
    stretch: np.ndarray,
    capacity: np.ndarray,
    prices: np.ndarray,
    known: float,
    gap: float,
    most: int,
) -> Outcome:
    """The best schedule of all targets together.

    Parameters
    ----------
    trees : Beginnings of every target
    stretch : (E,) number of the stretch of every look
    capacity : (S,) looks of every stretch
    prices : (S,) lam >= 0
    known : cost of a schedule
    gap : relative, what is not looked for
    most : nodes
    """
    T = len(trees)
    prices = np.ascontiguousarray(prices)
    value, level, cost, choices, visits, members, paid, looks, at_look = ([] for _ in range(9))
    for tree in trees:
        c = tree.course
        value.append(tree.values(c.dues(prices[stretch])))
        level.append(tree.level)
        cost.append(tree.cost)
        choices.append(tree.choices)
        visits.append(c.visit)
        members.append(c.member)
        paid.append(c.dues(np.zeros(len(stretch))))
        looks.append(c.look)
        at_look.append(stretch[c.entry])
    # looks and their stretches lie side by side: the longer of the two sets the distance
    width = [max(len(a), len(b)) for a, b in zip(looks, at_look, strict=True)]
    looks = [np.pad(a, (0, w - len(a))) for a, w in zip(looks, width, strict=True)]
    at_look = [np.pad(a, (0, w - len(a))) for a, w in zip(at_look, width, strict=True)]
    when = [(int(k), i, p) for i, tree in enumerate(trees) for p, k in enumerate(tree.course.interval)]
    when.sort()
    owner, place = (np.array([w[j] for w in when], dtype=np.int64) for j in (1, 2))

    last = np.full(len(capacity), -1, dtype=np.int64)
    for d, (i, p) in enumerate(zip(owner, place, strict=True)):
        c = trees[i].course
        first, end = c.member[c.visit[p]], c.member[c.visit[p + 1]]
        last[stretch[c.entry[c.look[first:end]]]] = d
    closing = np.argsort(last, kind="stable")
    close_at = np.searchsorted(last[closing], np.arange(len(owner) + 1))

    def starts(parts: list[np.ndarray]) -> np.ndarray:
        return np.concatenate([[0], np.cumsum([len(x) for x in parts])]).astype(np.int64)

    def joined(parts: list[np.ndarray]) -> np.ndarray:
        return np.concatenate(parts)

    found, best, cut, tried, finished, chosen = _search(
        owner, place, starts(level), starts(choices), joined(level), joined(choices), starts(cost), joined(cost),
        joined(value), starts(visits), joined(visits), joined(paid), starts(members), joined(members), starts(looks),
        joined(looks), joined(at_look), close_at, closing, np.array(capacity, dtype=np.int64), prices,
        np.zeros(T, dtype=np.int64), float(known), gap, most,
    )  # fmt: skip
    taken = None
    if found:
        pairs = [(trees[i].course, int(v)) for i, v in zip(owner, chosen, strict=True) if v >= 0]
        each = [c.entry[c.looks_of([v])] for c, v in pairs]
        taken = np.concatenate(each) if each else np.zeros(0, dtype=np.int64)
    return Outcome(float(best) if found else np.inf, taken, float(min(cut, best)), int(tried), bool(finished))

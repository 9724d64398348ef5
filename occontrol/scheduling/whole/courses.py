"""One target and the looks that it may get, as plain arrays: what the bound on whole looks is worked out from.

A visit is what happens to a target on one interval: a look of one resource, or looks of several at once. Where three or
more resources see a target on the same interval, one visit stands for all that are of two or more of them: it tells
what all together tell and costs what the cheapest two cost, so that a minimum over visits stays a lower bound.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from occontrol.scheduling.blocks.single import Singles


@njit(cache=True, nogil=True)
def _dues(each, member, look):
    """What the looks of every visit cost, of several the cheapest two."""
    found = np.empty(len(member) - 1)
    for v in range(len(found)):
        one, two = np.inf, np.inf
        for a in range(member[v], member[v + 1]):
            x = each[look[a]]
            if x < one:
                one, two = x, one
            elif x < two:
                two = x
        found[v] = one + two if member[v + 1] - member[v] > 1 else one
    return found


@dataclass(frozen=True, eq=False)
class Course:
    """A target, its blocks and its visits; picklable.

    Parameters
    ----------
    data : arrays of `Singles` for the blocks of this target alone, with entries counted in `entry`
    substeps : steps of integration on every interval
    interval : (P,) intervals on which the target may be looked at, ascending
    visit : (P+1,) where the visits of each of them begin
    member : (V+1,) where the looks of each visit begin in `look`
    look : entries, numbers among `entry`
    entry : (e,) the weight of the whole problem that each entry is
    price : (e,) what a look costs by itself, alpha q h
    """

    data: tuple[np.ndarray, ...]
    substeps: int
    interval: np.ndarray
    visit: np.ndarray
    member: np.ndarray
    look: np.ndarray
    entry: np.ndarray
    price: np.ndarray

    @property
    def intervals(self) -> int:
        """N"""
        return len(self.data[9]) // self.substeps

    @property
    def size(self) -> int:
        """D, entries of the lower triangles of all covariances of the target."""
        n = self.data[0][:, 0]
        return int(np.sum(n * (n + 1) // 2))

    @property
    def where(self) -> np.ndarray:
        """(V,) place in `interval` of every visit."""
        return np.repeat(np.arange(len(self.interval)), np.diff(self.visit))

    def dues(self, prices: np.ndarray) -> np.ndarray:
        """(V,) what every visit costs at prices (E,) of all looks of the problem, beside what they cost by themselves.

        A visit of several looks pays its cheapest two.
        """
        return _dues(self.price + prices[self.entry], self.member, self.look)

    def looks_of(self, visits: Sequence[int] | np.ndarray) -> np.ndarray:
        """The looks that visits (n,) stand for, as numbers in `entry`."""
        found = [self.look[self.member[v] : self.member[v + 1]] for v in visits]
        return np.concatenate(found) if found else np.zeros(0, dtype=np.int64)


def courses(data: Singles, interval: np.ndarray, target: np.ndarray, price: np.ndarray, substeps: int) -> list[Course]:
    """Every target of a problem.

    Parameters
    ----------
    data : Singles
    interval, target : (E,) of every look; target is -1 for what a resource leaves unused
    price : (E,) what a look costs by itself
    substeps : steps of integration on every interval
    """
    T = len(data.blocks) - 1
    real = np.flatnonzero(target >= 0)
    order = real[np.lexsort((interval[real], target[real]))]
    first = np.searchsorted(target[order], np.arange(T + 1))
    return [_course(data, i, order[first[i] : first[i + 1]], interval, price, substeps) for i in range(T)]


def _course(
    data: Singles, i: int, entries: np.ndarray, interval: np.ndarray, price: np.ndarray, substeps: int
) -> Course:
    a, z = int(data.blocks[i]), int(data.blocks[i + 1])
    back = np.full(len(interval), -1, dtype=np.int64)
    back[entries] = np.arange(len(entries))
    sizes = data.sizes[a:z].copy()
    matrices, flows, rows, uses, row, first = [], [], [], [], [], []
    at = to = on = count = 0
    nodes = data.predicts.shape[1]
    for b in range(z - a):
        n, per, m, f, pattern, q = (int(x) for x in data.sizes[a + b])
        nn = n * n
        span = int(np.max(data.predicts[pattern])) + 1
        matrices.append(data.matrices[m : m + 3 * nn])
        flows += [data.flows[f : f + span * nn], data.flows[q : q + span * nn]]
        sizes[b, 2], sizes[b, 3], sizes[b, 5] = at, to, to + span * nn
        at, to = at + 3 * nn, to + 2 * span * nn
        u, w = int(data.first[a + b, 0]), int(data.first[a + b, -1])
        uses.append(back[data.entry[u:w]])
        starts, inverse = np.unique(data.row[u:w], return_inverse=True)
        row.append(on + inverse * per * n)
        rows += [data.rows[s : s + per * n] for s in starts]
        on += len(starts) * per * n
        first.append(data.first[a + b] - u + count)
        count += w - u
    none = np.zeros(0)
    plain = (
        sizes, np.concatenate(matrices), np.concatenate(flows), data.predicts, np.array(first).reshape(-1, nodes),
        np.concatenate(uses).astype(np.int64), np.concatenate(row).astype(np.int64),
        np.concatenate(rows) if rows else none, np.array([0, z - a]), data.steps, data.charges,
    )  # fmt: skip
    k, starts, counts = np.unique(interval[entries], return_index=True, return_counts=True)
    visit, member, look = [0], [0], []
    for s, c in zip(starts, counts, strict=True):
        listed = [[s + r] for r in range(c)] + ([list(range(s, s + c))] if c > 1 else [])
        for group in listed:
            look += group
            member.append(len(look))
        visit.append(len(member) - 1)
    return Course(
        plain, substeps, k.astype(np.int64), np.array(visit), np.array(member), np.array(look, dtype=np.int64),
        entries.astype(np.int64), np.ascontiguousarray(price[entries]),
    )  # fmt: skip

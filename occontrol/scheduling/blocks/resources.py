"""What schedules of looks are allowed: on every interval each resource gives at most so many looks, each at most whole.

The open looks of one resource on one interval stand together, and after them what the resource leaves unused, which
costs nothing: so 0 <= v_e <= upper_e and sum_e v_e = capacity on every such stretch. Pairs that are closed are not
listed at all.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit

from occontrol.core.errors import Mistake
from occontrol.scheduling.feasible_set import Face, FeasibleSet
from occontrol.scheduling.polytope import project_row
from occontrol.scheduling.polytope_face import face_row

_OPTIONS = {"cache": True, "nogil": True, "error_model": "numpy"}
ROUNDING = 1e-9


@njit(**_OPTIONS)
def _cheapest(g, capacity, w):
    """w <- the vertex of one stretch, whose last weight is what is left over; returns g.w."""
    M = len(g) - 1
    w[:] = 0.0
    negative = 0
    for j in range(M):
        if g[j] < 0.0:
            negative += 1
    limit = 0.0
    exact = negative > capacity
    if exact:
        if capacity == 0:
            w[M] = 0.0
            return 0.0
        limit = np.partition(g[:M], capacity - 1)[capacity - 1]
    used, total = 0, 0.0
    for j in range(M):  # strictly below the limit first: ties are filled up from the front
        if g[j] < limit:
            w[j] = 1.0
            used += 1
            total += g[j]
    if exact:
        for j in range(M):
            if used < capacity and g[j] == limit:
                w[j] = 1.0
                used += 1
                total += g[j]
    w[M] = capacity - used
    return total


@njit(**_OPTIONS)
def _vertex(g, starts, capacity, w):
    for s in range(len(capacity)):
        a, b = starts[s], starts[s + 1]
        _cheapest(g[a:b], capacity[s], w[a:b])


@njit(**_OPTIONS)
def _excess(v, g, starts, capacity, found, w):
    for s in range(len(capacity)):
        a, b = starts[s], starts[s + 1]
        total = 0.0
        for e in range(a, b):
            total += g[e] * v[e]
        found[s] = total - _cheapest(g[a:b], capacity[s], w[: b - a])


@njit(**_OPTIONS)
def _project(y, upper, starts, capacity, w):
    for s in range(len(capacity)):
        a, b = starts[s], starts[s + 1]
        if capacity[s] == 0:
            w[a:b] = 0.0
        else:
            project_row(y[a:b], upper[a:b], float(capacity[s]), w[a:b])


@njit(**_OPTIONS)
def _face(v, g, upper, starts, near, free, move, listed, ends):
    size = rows = 0
    for s in range(len(starts) - 1):
        a, b = starts[s], starts[s + 1]
        if face_row(v[a:b], g[a:b], upper[a:b], near, free[a:b], move[a:b]) > 1:
            for e in range(a, b):
                if free[e]:
                    listed[size] = e
                    size += 1
            ends[rows] = size
            rows += 1
    return size, rows


@njit(**_OPTIONS)
def scaled_step(v, g, starts, capacity, w):
    """w <- min(1, tau v (-g)), tau such that each stretch gives as much as it can; g <= 0 of every look.

    The last weight of a stretch takes what is left. A weight of 0 stays 0.
    """
    for s in range(len(capacity)):
        a, b = starts[s], starts[s + 1] - 1
        if b - a <= capacity[s]:
            for e in range(a, b):
                w[e] = 1.0
            w[b] = capacity[s] - (b - a)
            continue
        total = 0.0
        for e in range(a, b):
            w[e] = max(-g[e], 0.0) * v[e]
            total += w[e]
        left = float(capacity[s])
        tau = left / total if total > 0.0 else 0.0
        while total > 0.0:  # what reaches 1 stays there, the others share what is left
            rest, free = float(capacity[s]), 0.0
            for e in range(a, b):
                if tau * w[e] >= 1.0:
                    rest -= 1.0
                else:
                    free += w[e]
            if free <= 0.0 or rest <= 0.0 or rest / free <= tau * (1.0 + 1e-15):
                break
            tau = rest / free
        used = 0.0
        for e in range(a, b):
            w[e] = min(1.0, tau * w[e])
            used += w[e]
        w[b] = max(left - used, 0.0)


@njit(**_OPTIONS)
def _sum_up(v, starts, capacity, lane, lanes, lengths, segment_interval, order, result):
    """Sum-up rounding with a deficit for every lane (target and resource), stretches in the given order."""
    deficit = np.zeros(lanes)
    for i in range(len(order)):
        s = order[i]
        a, b = starts[s], starts[s + 1] - 1
        h = lengths[segment_interval[s]]
        for e in range(a, b):
            deficit[lane[e]] += h * v[e]
            result[e] = 0.0
        used = 0
        for _ in range(min(capacity[s], b - a)):
            best = -1
            for e in range(a, b):
                if result[e] == 0.0 and (best < 0 or deficit[lane[e]] > deficit[lane[best]] + 1e-12 * h):
                    best = e
            if deficit[lane[best]] <= 0.0:
                break
            result[best] = 1.0
            used += 1
            deficit[lane[best]] -= h
        result[b] = capacity[s] - used


@dataclass(frozen=True, eq=False)
class ResourceSet(FeasibleSet):
    """The looks that resources of limited capacity may give.

    Parameters
    ----------
    starts : (S+1,) where the looks of every stretch begin; the last weight of a stretch is what is left over
    capacity : (S,) whole numbers
    interval : (S,) the interval that each stretch lies on
    lengths : (N,) of the intervals
    lane : (E,) number of the pair of target and resource that each look belongs to; anything where nothing is looked at
    """

    starts: np.ndarray
    capacity: np.ndarray
    interval: np.ndarray
    lengths: np.ndarray
    lane: np.ndarray

    @cached_property
    def upper(self) -> np.ndarray:
        """(E,) largest weights."""
        upper = np.ones(int(self.starts[-1]))
        upper[self.rest] = self.capacity
        return upper

    @property
    def shape(self) -> tuple[int, int]:
        """(E, 1)"""
        return int(self.starts[-1]), 1

    @property
    def places(self) -> int:
        """The largest capacity."""
        return int(np.max(self.capacity, initial=0))

    @property
    def rest(self) -> np.ndarray:
        """(S,) the weights that stand for what is left over."""
        return self.starts[1:] - 1

    def vertex(self, gradient: np.ndarray) -> np.ndarray:
        """The cheapest allowed looks (E, 1) for `gradient` (E, 1); whole, and none that costs."""
        w = np.empty(self.shape)
        _vertex(np.ascontiguousarray(gradient).reshape(-1), self.starts, self.capacity, w.reshape(-1))
        return w

    def excess(self, weights: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        """(S,) v.g - min w.g, stretch by stretch, for `weights` (E, 1) and `gradient` (E, 1)."""
        found = np.empty(len(self.capacity))
        v, g = np.ascontiguousarray(weights).reshape(-1), np.ascontiguousarray(gradient).reshape(-1)
        longest = int(np.max(np.diff(self.starts), initial=0))
        _excess(v, g, self.starts, self.capacity, found, np.empty(longest))
        return found

    def project(self, weights: np.ndarray) -> np.ndarray:
        """The nearest allowed weights (E, 1) to `weights` (E, 1)."""
        w = np.empty(self.shape)
        y = np.ascontiguousarray(weights).reshape(-1)
        _project(y, self.upper, self.starts, self.capacity, w.reshape(-1))
        return w

    def uniform(self) -> np.ndarray:
        """Every resource in equal shares (E, 1), as much as it can give."""
        count = np.diff(self.starts) - 1
        share = np.minimum(1.0, self.capacity / np.maximum(count, 1))
        v = np.repeat(share, count + 1)
        v[self.rest] = self.capacity - share * count
        return v[:, None]

    def round(self, weights: np.ndarray, backward: bool = False) -> np.ndarray:
        """Sum-up rounding (E, 1) of weights (E, 1): looks go where use lags behind most."""
        order = np.arange(len(self.capacity))[:: -1 if backward else 1]
        result = np.empty(self.shape)
        v = np.ascontiguousarray(weights).reshape(-1)
        lanes = int(np.max(self.lane, initial=0)) + 1
        _sum_up(
            v, self.starts, self.capacity, self.lane, lanes, self.lengths, self.interval,
            np.ascontiguousarray(order), result.reshape(-1),
        )  # fmt: skip
        return result

    def scaled(self, weights: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        """The multiplicative step min(1, tau v (-g)) of weights (E, 1) along a gradient (E, 1) that is not positive."""
        w = np.empty(self.shape)
        v, g = np.ascontiguousarray(weights).reshape(-1), np.ascontiguousarray(gradient).reshape(-1)
        scaled_step(v, g, self.starts, self.capacity, w.reshape(-1))
        return w

    def face(self, weights: np.ndarray, gradient: np.ndarray, near: float) -> Face:
        """The groups are the stretches; `weights` (E, 1), `gradient` (E, 1)."""
        E = self.shape[0]
        v, g = np.ascontiguousarray(weights).reshape(-1), np.ascontiguousarray(gradient).reshape(-1)
        free, move = np.empty(E, dtype=np.bool_), np.empty(self.shape)
        listed, ends = np.empty(E, dtype=np.int64), np.empty(len(self.capacity), dtype=np.int64)
        size, rows = _face(v, g, self.upper, self.starts, near, free, move.reshape(-1), listed, ends)
        return Face(listed[:size], ends[:rows], move)

    def exchange_masks(self, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Looks that are taken, and looks that may be taken yet, (E, 1) each, for `weights` (E, 1)."""
        taken = weights > 0.5
        return taken, ~taken

    def swap_mask(self, weights: np.ndarray) -> np.ndarray:
        """Nothing may change places as a whole, (E-1,): local_search.py trades single looks of `weights` (E, 1)."""
        return np.zeros(len(weights) - 1, dtype=bool)

    def part(self, first: int, last: int) -> ResourceSet:
        """The looks on intervals first .. last - 1."""
        mine = np.flatnonzero((self.interval >= first) & (self.interval < last))
        a, z = self.starts[mine[0]], self.starts[mine[-1] + 1]
        starts = np.append(self.starts[mine], z) - a
        lengths = self.lengths[first:last]
        return ResourceSet(starts, self.capacity[mine], self.interval[mine] - first, lengths, self.lane[a:z])

    def check(self, weights: np.ndarray) -> list[Mistake]:
        """What is wrong with weights (E, 1), one mistake of a kind."""
        v = np.asarray(weights).reshape(-1)
        found = []
        if len(v) != self.shape[0]:
            return [Mistake(("schedule",), f"there are {len(v)} weights of {self.shape[0]} looks")]
        if not np.all(np.isfinite(v)) or np.any(v < -ROUNDING) or np.any(v > self.upper + ROUNDING):
            found.append(Mistake(("schedule",), "a weight does not lie between 0 and 1"))
        sums = np.add.reduceat(v, self.starts[:-1])
        wrong = np.abs(sums - self.capacity) > ROUNDING * np.maximum(self.capacity, 1)
        if np.any(wrong):
            s = int(np.argmax(wrong))
            what = f"on interval {self.interval[s] + 1} a resource gives more than {self.capacity[s]} looks"
            found.append(Mistake(("schedule",), what))
        return found

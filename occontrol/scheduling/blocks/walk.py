"""Rules of thumb for looks: on every interval the looks of largest index are taken, from what is known by then.

Indices of a look, from the covariance S before it and S+ after it:
    trace         tr(R S), or tr(W S) without a running weight: how uncertain the target is
    information   (ln det S - ln det S+)/2: what the look tells
    myopic        tr(P (S - S+)) with P the costate when nothing is looked at any more
    costate       the same with P the costate of the relaxed optimum
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit

from occontrol.scheduling.blocks.lanes import BlockGroup
from occontrol.scheduling.blocks.resources import ResourceSet

_OPTIONS = {"cache": True, "nogil": True, "error_model": "numpy"}
TRACE, INFORMATION, CHANGE = 0, 1, 2


@njit(**_OPTIONS)
def _advance(F, Q, S):
    """S (B, n, n) <- F S F' + Q, block by block."""
    for b in range(len(S)):
        S[b] = F[b] @ S[b] @ F[b].T + Q[b]
        S[b] = 0.5 * (S[b] + S[b].T)


@njit(**_OPTIONS)
def _update(S, rows, w):
    """S (n, n) after looks at the rows (r, n) with information w, in place; returns half the fall of ln det S."""
    told = 0.0
    n = len(S)
    for r in range(len(rows)):
        y = S @ rows[r]
        d = w * (rows[r] @ y)
        told += 0.5 * np.log1p(d)
        gain = w / (1.0 + d)
        for i in range(n):
            for j in range(n):
                S[i, j] -= gain * y[i] * y[j]
    return told


@njit(**_OPTIONS)
def _index(kind, S, weight, block, entry, row, rows, per, h, index):
    """index (E,) += what the looks of this step are worth, seen by these blocks."""
    for a in range(len(block)):
        b = block[a]
        if kind == TRACE:
            index[entry[a]] += np.sum(weight[b] * S[b])
            continue
        after = S[b].copy()
        told = _update(after, rows[row[a] : row[a] + per], h)
        index[entry[a]] += told if kind == INFORMATION else np.sum(weight[b] * (S[b] - after))


@njit(**_OPTIONS)
def _take(S, block, entry, row, rows, per, h, x):
    """The looks that are taken, in place on S."""
    for a in range(len(block)):
        if x[entry[a]] > 0.0:
            _update(S[block[a]], rows[row[a] : row[a] + per], h * x[entry[a]])


@njit(**_OPTIONS)
def _costates(F, Q, predict, S0, W, R, charges, steps, first, block, entry, row, rows, per, x, found):
    """found (K, B, n, n) <- dJ/dS+ after every step along the weights x (E,)."""
    K, B = len(steps), len(S0)
    n = S0.shape[1]
    path = np.empty((K, B, n, n))
    S = S0.copy()
    for k in range(K):
        for b in range(B):
            S[b] = F[b, predict[k]] @ S[b] @ F[b, predict[k]].T + Q[b, predict[k]]
        for a in range(first[k], first[k + 1]):
            if x[entry[a]] > 0.0:
                _update(S[block[a]], rows[row[a] : row[a] + per], steps[k] * x[entry[a]])
        path[k] = S
    P = np.empty((B, n, n))
    for b in range(B):
        P[b] = F[b, predict[K]].T @ W[b] @ F[b, predict[K]]
    for k in range(K - 1, -1, -1):
        for b in range(B):
            if R.shape[1]:
                P[b] += charges[k, 1] * R[b, 0]
        found[k] = P
        keep = np.zeros((B, n, n))
        for b in range(B):
            for i in range(n):
                keep[b, i, i] = 1.0
        for a in range(first[k], first[k + 1]):
            w = steps[k] * x[entry[a]]
            if w > 0.0:
                b = block[a]
                for r in range(per):
                    c = rows[row[a] + r]
                    y = path[k, b] @ c
                    for i in range(n):
                        for j in range(n):
                            keep[b, i, j] -= w * y[i] * c[j]
        for b in range(B):
            P[b] = keep[b].T @ P[b] @ keep[b]
            if R.shape[1]:
                P[b] += charges[k, 0] * R[b, 0]
            P[b] = F[b, predict[k]].T @ P[b] @ F[b, predict[k]]


class Walk:
    """Goes through the steps once, choosing as it goes.

    Parameters
    ----------
    groups : BlockGroups
    allowed : ResourceSet
    price : (E,) of the looks
    steps : (K,) lengths; every interval has the same number of them
    charges : (K, 2) of the running weight
    """

    def __init__(
        self,
        groups: Sequence[BlockGroup],
        allowed: ResourceSet,
        price: np.ndarray,
        steps: np.ndarray,
        charges: np.ndarray,
    ):
        self.groups, self.allowed, self.price, self.steps, self.charges = groups, allowed, price, steps, charges
        self._uses = []
        for group in groups:
            order = np.argsort(group.step, kind="stable")
            first = np.searchsorted(group.step[order], np.arange(len(steps) + 1))
            self._uses.append((first, *(np.ascontiguousarray(x[order]) for x in (group.block, group.entry, group.row))))
        ends = np.searchsorted(allowed.interval, np.arange(len(allowed.lengths) + 1))
        self._stretches = ends

    def costates(self, weights: np.ndarray) -> list[np.ndarray]:
        """(K, B, n, n) of every group: what a change of S+ costs later, along `weights` (E, 1)."""
        found, x = [], np.ascontiguousarray(weights).reshape(-1)
        for group, (first, block, entry, row) in zip(self.groups, self._uses, strict=True):
            P = np.empty((len(self.steps), *group.initial.shape))
            _costates(
                np.ascontiguousarray(group.transition), np.ascontiguousarray(group.noise), group.predict,
                group.initial, group.terminal, group.running, self.charges, self.steps, first, block, entry, row,
                group.rows, group.per_use, x, P,
            )  # fmt: skip
            found.append(P)
        return found

    def charged(self, weights: np.ndarray) -> list[np.ndarray]:
        """(K, B) tr(R S+) of every block along `weights` (E, 1); tr(W S+) of blocks without a running weight."""
        x = np.ascontiguousarray(weights).reshape(-1)
        states = [np.array(group.initial) for group in self.groups]
        what = [charged_weight(group) for group in self.groups]
        found = [np.empty((len(self.steps), len(group))) for group in self.groups]
        for k in range(len(self.steps)):
            self._predict(states, k)
            for i, group in enumerate(self.groups):
                first, block, entry, row = self._uses[i]
                now = slice(first[k], first[k + 1])
                h = float(self.steps[k])
                _take(states[i], block[now], entry[now], row[now], group.rows, group.per_use, h, x)
                found[i][k] = np.einsum("bij,bij->b", what[i], states[i])
        return found

    def policy(self, kind: int, weights: Sequence[np.ndarray]) -> np.ndarray:
        """The schedule (E, 1) of the looks of largest index.

        Parameters
        ----------
        kind : TRACE, INFORMATION or CHANGE
        weights : for every group (B, n, n), or (K, B, n, n), of the index
        """
        x = np.zeros(self.allowed.shape[0])
        states = [np.array(group.initial) for group in self.groups]
        s = len(self.steps) // len(self.allowed.lengths)
        index = np.zeros(len(x))
        for interval in range(len(self.allowed.lengths)):
            k = interval * s
            for q in range(s):
                self._predict(states, k + q)
                if q == 0:
                    for i, group in enumerate(self.groups):
                        weight = weights[i] if weights[i].ndim == 3 else weights[i][k + s - 1]
                        first, block, entry, row = self._uses[i]
                        now = slice(first[k], first[k + 1])
                        _index(
                            kind, states[i], weight, block[now], entry[now], row[now], group.rows, group.per_use,
                            float(self.allowed.lengths[interval]), index,
                        )  # fmt: skip
                    self._choose(interval, index, x)
                for i, group in enumerate(self.groups):
                    first, block, entry, row = self._uses[i]
                    now = slice(first[k + q], first[k + q + 1])
                    _take(
                        states[i], block[now], entry[now], row[now], group.rows, group.per_use,
                        float(self.steps[k + q]), x,
                    )  # fmt: skip
        return x[:, None]

    def _predict(self, states: list[np.ndarray], k: int) -> None:
        for group, S in zip(self.groups, states, strict=True):
            u = group.predict[k]
            _advance(np.ascontiguousarray(group.transition[:, u]), np.ascontiguousarray(group.noise[:, u]), S)

    def _choose(self, interval: int, index: np.ndarray, x: np.ndarray) -> None:
        """The largest indices of every resource, those that are worth their price."""
        allowed = self.allowed
        for s in range(self._stretches[interval], self._stretches[interval + 1]):
            a, b = allowed.starts[s], allowed.starts[s + 1] - 1
            worth = index[a:b] - self.price[a:b]
            best = np.argsort(-worth, kind="stable")[: allowed.capacity[s]]
            best = best[worth[best] > 0]
            x[a + best] = 1.0
            x[b] = allowed.capacity[s] - len(best)


def charged_weight(group: BlockGroup) -> np.ndarray:
    """(B, n, n) what of a block is charged: its running weight, or the terminal one where there is none."""
    R = group.running[:, 0] if group.running.shape[1] else np.zeros_like(group.terminal)
    return np.where(np.any(R != 0, axis=(1, 2), keepdims=True), R, group.terminal)


def round_robin(allowed: ResourceSet, lanes: int) -> np.ndarray:
    """The looks (E, 1) in turn: on every interval what has not been looked at for longest.

    Parameters
    ----------
    allowed : ResourceSet
    lanes : pairs of target and resource
    """
    return _by_age(allowed, lanes, None)


def random_looks(allowed: ResourceSet, seed: int) -> np.ndarray:
    """Random looks (E, 1), as many as each resource gives."""
    return _by_age(allowed, 0, np.random.default_rng(seed))


def _by_age(allowed: ResourceSet, lanes: int, rng: np.random.Generator | None) -> np.ndarray:
    x, last = np.zeros(allowed.shape[0]), np.full(lanes, -1, dtype=np.int64)
    for s in range(len(allowed.capacity)):
        a, b = allowed.starts[s], allowed.starts[s + 1] - 1
        size = min(int(allowed.capacity[s]), b - a)
        if rng is not None:
            chosen = rng.choice(b - a, size=size, replace=False)
        else:
            chosen = np.argsort(last[allowed.lane[a:b]], kind="stable")[:size]
            last[allowed.lane[a + chosen]] = s
        x[a + chosen] = 1.0
        x[b] = allowed.capacity[s] - size
    return x[:, None]

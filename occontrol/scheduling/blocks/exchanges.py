"""The change of J for every single exchange 'use e instead of j on step k', where a plant falls into blocks.

A change touches the blocks that the two sensors see. Each of them is swept on from step k with the changed weights,
until the covariance is nearly what it was; what is left of the change is then worth tr(P dS), P the costate, to first
order, and never more than that: a later covariance is a concave function of an earlier one. So an exchange saves at
least what is said, and the error is of the order of NEAR^2; with a running weight, too, and for sensors that see
several blocks or the same ones. J is convex: exchanges are tried only where the gradient promises something.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit

from occontrol.scheduling.blocks.lanes import BlockGroup

_OPTIONS = {"cache": True, "nogil": True, "fastmath": {"contract", "nsz", "reassoc"}, "error_model": "numpy"}
NEAR = 0.05  # of the covariance: a change so small is worth what the costate says
MOST = 10_000_000  # pairs of sensors, over all steps, that are looked at together


@njit(**_OPTIONS)
def _predict(F, Q, S, T):
    """S (n, n) <- F S F' + Q; T is work space."""
    n = len(S)
    for i in range(n):
        for j in range(n):
            s = 0.0
            for m in range(n):
                s += F[i, m] * S[m, j]
            T[i, j] = s
    for i in range(n):
        for j in range(i + 1):
            s = Q[i, j]
            for m in range(n):
                s += T[i, m] * F[j, m]
            S[i, j] = S[j, i] = s


@njit(**_OPTIONS)
def _update(S, w, rows, at, per, y):
    """S (n, n) after `per` rows from `at` on with information w, in place; y (n,) is work space."""
    n = len(S)
    for r in range(at, at + per):
        d = 0.0
        for i in range(n):
            s = 0.0
            for j in range(n):
                s += S[i, j] * rows[r, j]
            y[i] = s
            d += s * rows[r, i]
        gain = w / (1.0 + w * d)
        for i in range(n):
            for j in range(n):
                S[i, j] -= gain * y[i] * y[j]


@njit(**_OPTIONS)
def _apart(M, S, other):
    """tr(M (S - other))"""
    n, total = len(S), 0.0
    for i in range(n):
        for j in range(n):
            total += M[i, j] * (S[i, j] - other[i, j])
    return total


@njit(**_OPTIONS)
def path(F, Q, predict, S0, W, R, running_set, charges, first, entry, row, rows, per, steps, v, before, after, later):
    """before, after (B, K, n, n) <- the covariance of every block before and after the update of every step; later
    (B, K, n, n) <- P, the derivative by the second of all that is charged after that step.

    first (B, K+1) where the uses of a step begin; v (E,) flat
    """
    B, K, n = before.shape[0], before.shape[1], before.shape[2]
    S, T, X, y, zero = np.empty((n, n)), np.empty((n, n)), np.empty((n, n)), np.empty(n), np.zeros((n, n))
    for b in range(B):
        S[:] = S0[b]
        for k in range(K):
            _predict(F[b, predict[k]], Q[b, predict[k]], S, T)
            before[b, k] = S
            for a in range(first[b, k], first[b, k + 1]):
                w = steps[k] * v[entry[a]]
                if w > 0.0:
                    _update(S, w, rows, row[a], per, y)
            after[b, k] = S
        S[:] = W[b]
        for k in range(K, -1, -1):
            if k < K:
                later[b, k] = S
                if R.shape[1]:
                    S += charges[k, 1] * R[b, running_set[k]]
                X[:] = 0.0  # I - S+ L
                for i in range(n):
                    X[i, i] = 1.0
                for a in range(first[b, k], first[b, k + 1]):
                    w = steps[k] * v[entry[a]]
                    if w > 0.0:
                        for r in range(row[a], row[a] + per):
                            for i in range(n):
                                y[i] = 0.0
                                for j in range(n):
                                    y[i] += after[b, k, i, j] * rows[r, j]
                            for i in range(n):
                                for j in range(n):
                                    X[i, j] -= w * y[i] * rows[r, j]
                _predict(X.T, zero, S, T)
                if R.shape[1]:
                    S += charges[k, 0] * R[b, running_set[k]]
            _predict(F[b, predict[k]].T, zero, S, T)


@njit(**_OPTIONS)
def _change(
    b, k, less, more, F, Q, predict, R, running_set, charges, first, entry, row, rows, per, steps, v, before, after,
    later, S, T, y,
):  # fmt: skip
    """What the block costs more where weight `less` is one lower and `more` one higher on step k (-1: neither)."""
    K, n = before.shape[1], len(S)
    S[:] = before[b, k]
    change = 0.0
    for q in range(k, K):
        if q > k:
            _predict(F[b, predict[q]], Q[b, predict[q]], S, T)
            if R.shape[1]:
                change += charges[q, 0] * _apart(R[b, running_set[q]], S, before[b, q])
        for a in range(first[b, q], first[b, q + 1]):
            x = v[entry[a]]
            if q == k:
                x += (entry[a] == more) - (entry[a] == less)
            if x > 0.0:
                _update(S, steps[q] * x, rows, row[a], per, y)
        if R.shape[1]:
            change += charges[q, 1] * _apart(R[b, running_set[q]], S, after[b, q])
        left = size = 0.0
        for i in range(n):
            for j in range(n):
                left = max(left, abs(S[i, j] - after[b, q, i, j]))
                size = max(size, abs(after[b, q, i, j]))
        if left <= NEAR * size or q == K - 1:
            return change + _apart(later[b, q], S, after[b, q])
    return change


@njit(**_OPTIONS)
def _changes(
    start, promising, minus, plus, both, F, Q, predict, R, running_set, charges, first, entry, row, rows, per, steps, v,
    before, after, later,
):  # fmt: skip
    """minus, plus (s, M) and both (s, M, M) += what leaving and entering, and doing both on one block, add to J.

    promising (s, M, M) whether the exchange of j for e is to be known, on steps start .. start + s - 1
    """
    n, M = before.shape[2], promising.shape[1]
    S, T, y = np.empty((n, n)), np.empty((n, n)), np.empty(n)
    for s in range(len(promising)):
        k = start + s
        for b in range(before.shape[0]):
            a, z = first[b, k], first[b, k + 1]
            for p in range(a - 1, z):  # a - 1: nothing leaves, or nothing enters
                for q in range(a - 1, z):
                    j = entry[p] - k * M if p >= a else -1
                    e = entry[q] - k * M if q >= a else -1
                    wanted = False
                    if j >= 0 and e >= 0:
                        wanted = promising[s, j, e]
                    else:
                        for other in range(M):
                            wanted = wanted or (j >= 0 and promising[s, j, other])
                            wanted = wanted or (e >= 0 and promising[s, other, e])
                    if not wanted:
                        continue
                    less, more = entry[p] if j >= 0 else -1, entry[q] if e >= 0 else -1
                    change = _change(b, k, less, more, F, Q, predict, R, running_set, charges, first, entry, row, rows,
                                     per, steps, v, before, after, later, S, T, y)  # fmt: skip
                    if j >= 0 and e >= 0:
                        both[s, j, e] += change
                        continue
                    if j >= 0:
                        minus[s, j] += change
                    else:
                        plus[s, e] += change
                    for o in range(a, z):  # where both see this block, only the two together count
                        other = entry[o] - k * M
                        if j >= 0 and other != j:
                            both[s, j, other] -= change
                        elif e >= 0 and other != e:
                            both[s, other, e] -= change


class BlockExchanges:
    """Exchanges on blocks whose decisions are single steps.

    Parameters
    ----------
    groups : BlockGroups whose weight number k M + j is that of sensor j on step k
    steps : (K,) lengths
    charges : (K, 2) of the running weight
    cost : (K, M) what a weight of one costs by itself
    """

    def __init__(self, groups: Sequence[BlockGroup], steps: np.ndarray, charges: np.ndarray, cost: np.ndarray):
        self.cost, self._groups = cost, []
        K, charges, steps = len(steps), np.ascontiguousarray(charges), np.ascontiguousarray(steps)
        for group in groups:
            B, n = len(group), group.states
            key = group.block.astype(np.int64) * K + group.step
            by = np.argsort(key, kind="stable")
            first = np.zeros((B, K + 1), dtype=np.int64)
            first[:, 1:] = np.cumsum(np.bincount(key, minlength=B * K)).reshape(B, K)
            first[1:, 0] = first[:-1, -1]
            entry, row = (np.ascontiguousarray(x[by], dtype=np.int64) for x in (group.entry, group.row))
            F, Q, R = (np.ascontiguousarray(x) for x in (group.transition, group.noise, group.running))
            front = (F, Q, group.predict)
            ends = np.ascontiguousarray(group.initial), np.ascontiguousarray(group.terminal)
            rest = (R, group.running_set, charges, first, entry, row, np.ascontiguousarray(group.rows), group.per_use)
            space = tuple(np.empty((B, K, n, n)) for _ in range(3))
            self._groups.append((front, ends, (*rest, steps), space))

    def best(
        self, weights: np.ndarray, gradient: np.ndarray, leaves: np.ndarray, enters: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The best exchange of every step and its effect on J.

        Parameters
        ----------
        weights : (K, M) whole policy
        gradient : (K, M) dJ/dv there
        leaves, enters : (K, M) what may be exchanged

        Returns gain (K,) <= 0 (0 where no exchange helps), leaving (K,) and entering (K,) sensors or -1.
        """
        K, M = weights.shape
        v = np.ascontiguousarray(weights, dtype=float).reshape(-1)
        for front, ends, rest, space in self._groups:
            path(*front, *ends, *rest, v, *space)
        gain, leaving, entering = np.zeros(K), np.full(K, -1), np.full(K, -1)
        together = max(1, MOST // (M * M))
        for start in range(0, K, together):
            part = slice(start, start + together)
            g, cost = gradient[part], self.cost[part]
            promising = leaves[part][:, :, None] & enters[part][:, None, :] & (g[:, None, :] < g[:, :, None])
            s = len(promising)
            minus, plus, both = np.zeros((s, M)), np.zeros((s, M)), np.zeros((s, M, M))
            for front, _, rest, space in self._groups:
                _changes(start, promising, minus, plus, both, *front, *rest, v, *space)
            change = (minus - cost)[:, :, None] + (plus + cost)[:, None, :] + both
            change = np.where(promising, change, 0.0).reshape(s, M * M)
            best = np.argmin(change, axis=1)
            least = change[np.arange(s), best]
            at = np.flatnonzero(least < 0)
            gain[start + at], (leaving[start + at], entering[start + at]) = least[at], divmod(best[at], M)
        return gain, leaving, entering

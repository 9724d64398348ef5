"""What a schedule costs that differs from a known one between two steps alone: a few steps and one small system.

Let S_b be the covariance before step b. With the policy from b on fixed, what is still to come costs

    c_b + tr(M_b Z),   (I + S_b O_b) Z = S_b M_b'

where from the end back, M = V, O = 0, c = tr(W Q_N) with V'V = W before the last predict, and over step k with
information L = sum_j h v_j c_j c_j' and predict (F, Q)

    O <- O + L,   c <- c + tr(M T Q M'),   M <- M T F,   O <- F' O T F,   T = (I + Q O)^-1

(the matrix inversion lemma). A running weight looks at every covariance, so the steps then go on to the end.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from occontrol.scheduling.rules.model import CriterionModel
from occontrol.scheduling.sweep import Sweep


@njit(cache=True, nogil=True)
def _tails(F, Q, predict, rows, row_set, offsets, steps, v, M, X, c):
    """Fill M (K+1, p, n), X = O (K+1, n, n), c (K+1,) from their last entries on."""
    n, p = F.shape[1], M.shape[1]
    both = np.empty((n, n + p))
    for k in range(steps.shape[0] - 1, -1, -1):
        f, q = F[predict[k]], Q[predict[k]]
        both[:, :n] = X[k + 1]
        for j in range(offsets.shape[0] - 1):
            w = steps[k] * v[k, j]
            if w > 0.0:
                for r in range(offsets[j], offsets[j + 1]):
                    row = rows[row_set[k], r]
                    for a in range(n):
                        for b in range(n):
                            both[a, b] += w * row[a] * row[b]
        system = np.dot(both[:, :n].copy(), q)
        for a in range(n):
            system[a, a] += 1.0
        both[:, n:] = M[k + 1].T
        solved = np.linalg.solve(system, both)  # (I + O Q)^-1 [O, M'] = [O T, (M T)']
        through = np.ascontiguousarray(solved[:, n:].T)
        c[k] = c[k + 1] + np.sum(np.dot(through, q) * M[k + 1])
        M[k] = np.dot(through, f)
        half = np.dot(f.T.copy(), np.dot(np.ascontiguousarray(solved[:, :n]), f))
        X[k] = 0.5 * (half + half.T)


@njit(cache=True, nogil=True)
def _to_go(S, X, M):
    """tr(M Z) with (I + S X) Z = S M'; S, X (n, n), M (p, n)."""
    system = np.dot(S, X)
    for a in range(len(S)):
        system[a, a] += 1.0
    Z = np.linalg.solve(system, np.dot(S, M.T.copy()))
    return np.sum(M.T * Z)


class BlockCost:
    """J of policies that differ little from one that was looked at before.

    Parameters
    ----------
    sweep : of the problem; of a criterion nothing is known sooner
    """

    def __init__(self, sweep: Sweep | CriterionModel):
        self.sweep, self._base = sweep, None
        r = sweep.recursion
        self._first = np.append(r.first_steps, len(r.steps))

    def begin(self, weights: np.ndarray) -> np.ndarray:
        """dJ/dv (N, C) at a policy, `weights` (N, C), from which others will differ."""
        sweep, r = self.sweep, self.sweep.recursion
        _, gradient = sweep.cost_and_gradient(weights)
        if not isinstance(sweep, Sweep) or sweep.root is None:
            return gradient
        n, K = r.states, len(r.steps)
        self._base, self._spent = weights.copy(), np.zeros(K + 1)
        self._before = np.concatenate([r.initial[None], sweep.kept[0][:, :, :n]])
        if sweep.dense:
            for k in range(K):
                self._spent[k + 1] = self._spent[k] + sweep.onward(self._before[k], k, k + 1, weights)[0]
            return gradient
        self._M, self._O, self._c = np.empty((K + 1, len(sweep.root), n)), np.empty((K + 1, n, n)), np.empty(K + 1)
        self._M[K], self._O[K], self._c[K] = sweep.root, 0.0, sweep.constant
        v = np.ascontiguousarray(r.on_steps(weights), dtype=float)
        _tails(r.transition, r.noise, r.predict, r.rows, r.row_set, r.offsets, r.steps, v, self._M, self._O, self._c)
        return gradient

    def value(self, weights: np.ndarray) -> float:
        """J of a policy, `weights` (N, C): soon where it differs from the one begun with on few intervals in a row."""
        sweep = self.sweep
        if self._base is None or not isinstance(sweep, Sweep):
            return sweep.cost(weights)
        changed = np.flatnonzero(np.any(weights != self._base, axis=1))
        a, b = (int(changed[0]), int(changed[-1]) + 1) if len(changed) else (0, 0)
        k0, k1 = int(self._first[a]), int(self._first[-1 if sweep.dense else b])
        running, S = sweep.onward(self._before[k0], k0, k1, weights)
        total = float(np.vdot(sweep.recursion.decision_cost, weights)) + self._spent[k0] + running
        if sweep.dense:
            return total + float(np.vdot(sweep.terminal, S)) + sweep.constant
        return total + self._c[k1] + _to_go(S, self._O[k1], self._M[k1])

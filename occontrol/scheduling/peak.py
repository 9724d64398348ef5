"""The largest of several variances along the way, to be minimised or to be kept below a limit.

    f_i = tr(W_i S+_{k_i}) + c_i,      peak = max_i f_i <= mu log sum_i exp(f_i / mu) <= peak + mu log m
    limit e:  J = cost + rho mu log(1 + sum_i exp((f_i - e)/mu))

Every f_i is convex in the policy, and so are both. With l_i = softmax(f/mu), or rho times the share of i in the second,

    J(w) >= cost.w + sum_i l_i f_i(w)         or    J(w) >= cost.w + sum_i l_i (f_i(w) - e) where the limit is kept,

and the right-hand sides are problems of traces: bounds of the true peak, and of the problem with the limit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from occontrol.scheduling.certified import Term
from occontrol.scheduling.proof import Judged
from occontrol.scheduling.recursion import Recursion
from occontrol.scheduling.sweep import Sweep

ROUNDING = 16 * float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class Watched:
    """The variances f_i.

    Parameters
    ----------
    step : (m,) the update after which S+ counts; -1 where nothing that is chosen comes before
    weight : (m, n, n) W_i; not looked at where step is -1
    constant : (m,) c_i
    """

    step: np.ndarray
    weight: np.ndarray
    constant: np.ndarray


def watched_before(recursion: Recursion, weights: np.ndarray, steps: np.ndarray) -> Watched:
    """Variances tr(W S-) before updates, in terms of S+ of the update before.

    Parameters
    ----------
    recursion : Recursion with n states
    weights : (m, n, n) W
    steps : (m,) the updates k; K stands for the end
    """
    r = recursion
    W, c = np.empty((len(steps), r.states, r.states)), np.empty(len(steps))
    for i, k in enumerate(steps):
        F, Q = r.transition[r.predict[k]], r.noise[r.predict[k]]
        W[i], c[i] = F.T @ weights[i] @ F, float(np.vdot(weights[i], Q))
        if k == 0:
            c[i] += float(np.vdot(W[i], r.initial))
    return Watched(np.asarray(steps) - 1, W, c)


def _charged_after(r: Recursion) -> tuple[np.ndarray, float]:
    """The running weight (K, n, n) as charged on S+ alone, and what is then constant."""
    K, n = len(r.steps), r.states
    after = np.zeros((K + 1, n, n))
    if not len(r.running):
        return after[1:], 0.0
    R = r.running[r.running_set]
    after[1:] = r.charges[:, 1, None, None] * R
    before = watched_before(r, r.charges[:, 0, None, None] * R, np.arange(K))
    after[:K] += before.weight
    return after[1:], float(np.sum(before.constant))


class PeakSweep(Sweep):
    """Cost and gradient where the largest of some variances counts; a CriterionObjective.

    The peak takes the place of the weight on the last covariance.

    Parameters
    ----------
    recursion : Recursion; its own running weight is charged too, its terminal weight is not
    watched : Watched
    smoothing : mu, in units of a variance; 0 for the true peak
    limit : e, or None where the peak is minimised
    penalty : rho, of a limit
    """

    splits = False
    signed = False
    corners = True

    def __init__(
        self,
        recursion: Recursion,
        watched: Watched,
        smoothing: float = 0.0,
        limit: float | None = None,
        penalty: float = 0.0,
    ):
        r, self._given = recursion, recursion
        K, n = len(r.steps), r.states
        self._base, self._constant = _charged_after(r)
        self.watched, self.smoothing, self.limit, self.penalty = watched, smoothing, limit, penalty
        self._seen = np.flatnonzero(watched.step >= 0)
        own = replace(
            r,
            running=self._base.copy(),
            running_set=np.arange(K, dtype=np.int64),
            charge=np.tile([0.0, 1.0], (K, 1)),
            terminal=np.zeros((n, n)),
        )
        super().__init__(own, memory_budget=2**62)
        self._variances = np.zeros(len(watched.step))

    @property
    def spread(self) -> float:
        """How far smoothing raises the peak at most, for each unit of mu."""
        m = len(self.watched.step)
        return float(np.log(m)) if self.limit is None else self.penalty * float(np.log(m + 1))

    @property
    def criterion_value(self) -> float:
        """The true peak of the last cost."""
        return float(np.max(self._variances))

    @property
    def variances(self) -> np.ndarray:
        """(m,) f_i of the last cost."""
        return self._variances.copy()

    @property
    def smoothing_error(self) -> float:
        """What the last cost has to lose before its tangent bounds the true problem."""
        shares, value = self._shares(), self._value()
        kept = shares > 0  # f of a share of 0 may be as large as it likes
        if self.limit is None:
            return max(value - float(shares[kept] @ self._variances[kept]), 0.0)
        return max(value - float(shares[kept] @ (self._variances[kept] - self.limit)), 0.0)

    @property
    def foresees_exchanges(self) -> bool:
        """False: what an exchange does to the peak is not known before."""
        return False

    def with_smoothing(self, smoothing: float) -> PeakSweep:
        """The same with another mu, `smoothing`; 0 is the true peak."""
        return PeakSweep(self._given, self.watched, smoothing, self.limit, self.penalty)

    def with_limit(self, limit: float | None, penalty: float) -> PeakSweep:
        """The same with the `limit` e of the peak, kept by the `penalty` rho."""
        return PeakSweep(self._given, self.watched, self.smoothing, limit, penalty)

    @property
    def given(self) -> Recursion:
        """The recursion as it was given, with its own running weight."""
        return self._given

    def on(self, columns: Recursion) -> PeakSweep:
        """The same on a recursion that differs from the given one in its `columns` alone."""
        return PeakSweep(columns, self.watched, self.smoothing, self.limit, self.penalty)

    def tangent(self, weights: np.ndarray) -> Judged:
        """The policy `weights` (N, M) with its tangent as a problem of traces."""
        J, g = self.cost_and_gradient(weights)
        J, shares = J - self.smoothing_error, self._shares()
        offset = self._constant + float(shares @ self.watched.constant)
        if self.limit is not None:
            offset -= self.limit * float(np.sum(shares))
        trace = replace(self.recursion, running=self._weighted(shares))
        sizes = np.abs(self.watched.constant) + np.abs(self._variances) + abs(self.limit or 0.0)
        # terms of the offset cancel those of the trace
        slack = ROUNDING * (abs(self._constant) + float(shares @ sizes))
        return Judged(weights, J, g, [Term(1.0, trace)], offset=offset, slack=slack)

    def _run_forward(self, weights: np.ndarray, keep: bool) -> float:
        n, watched, seen = self._n, self.watched, self._seen
        self._R[:, :, :n] = self._base
        rest = super()._run_forward(weights, keep=True)
        f = watched.constant.copy()
        f[seen] += np.einsum("kij,kij->k", watched.weight[seen], self._store[watched.step[seen], :, :n])
        self._variances = f
        return rest + self._constant + self._value()

    def _turn(self) -> None:
        self._R[:, :, : self._n] = self._weighted(self._shares())

    def _weighted(self, shares: np.ndarray) -> np.ndarray:
        running, seen = self._base.copy(), self._seen
        np.add.at(running, self.watched.step[seen], shares[seen, None, None] * self.watched.weight[seen])
        return running

    def _value(self) -> float:
        f, mu, e = self._variances, self.smoothing, self.limit
        top = float(np.max(f))
        if e is None:
            return top + (mu * float(np.log(np.sum(np.exp((f - top) / mu)))) if mu else 0.0)
        if not mu:
            return self.penalty * max(top - e, 0.0)
        high = max(top - e, 0.0)
        total = np.exp(-high / mu) + np.sum(np.exp((f - e - high) / mu))
        return self.penalty * (high + mu * float(np.log(total)))

    def _shares(self) -> np.ndarray:
        """(m,) l_i, the derivatives of the criterion by f_i."""
        f, mu, e = self._variances, self.smoothing, self.limit
        top = int(np.argmax(f))
        shares = np.zeros(len(f))
        if not mu:
            shares[top] = 1.0 if e is None else self.penalty * (f[top] > e)
            return shares
        if e is None:
            shares = np.exp((f - f[top]) / mu)
            return shares / np.sum(shares)
        high = max(float(f[top]) - e, 0.0)
        shares = np.exp((f - e - high) / mu)
        return self.penalty * shares / (np.exp(-high / mu) + np.sum(shares))

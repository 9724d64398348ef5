"""The independent check: a plain covariance filter along a schedule of readings, from the problem's own signals.

It shares no code with the recursion: readings are taken in one by one in Joseph's form, in extended precision where
the matrices are small; the plant between two samples is integrated by Gragg's extrapolated midpoint rule, all gaps at
once (Hairer, Norsett & Wanner, Solving Ordinary Differential Equations I, section II.9).

    dPhi/dt = A Phi,   dQ/dt = A Q + Q A' + Xi,   dS/dt = A S + S A' + Xi on the way for the running integral
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import cast

import numpy as np

from occontrol.core.signal import Signal
from occontrol.families.athans.criteria.plain import counts, is_peak, plain_value
from occontrol.families.athans.readings.clock import SampleTimes
from occontrol.families.athans.readings.problem import ReadingsProblem

EXTENDED = 24  # states up to which extended precision is fast enough
ORDERS = (2, 4, 6, 8, 10, 12, 14)  # substeps of the extrapolation
SHORT = 0.5  # |A| times a step


@dataclass(frozen=True)
class PlainCost:
    """What a schedule costs by the plain filter.

    Parameters
    ----------
    cost : observation + running + criterion
    observation : alpha times the prices of the readings
    running : sum or integral of tr(R S)
    prediction : tr(W S)
    criterion : the criterion's value, tr(W S) unless the problem has another; a peak with a limit is no part of `cost`
    """

    cost: float
    observation: float
    running: float
    prediction: float
    criterion: float


def plain_cost(problem: ReadingsProblem, weights: np.ndarray) -> PlainCost:
    """Cost of a policy of readings; a share v of a reading has the noise R/v.

    Parameters
    ----------
    problem : ReadingsProblem with N readings and M sensors
    weights : (N, M) of every reading
    """
    times, n = problem.clock.times, problem.states
    kind = np.longdouble if n <= EXTENDED else np.float64
    C = [s.C.sample(times) for s in problem.sensors]
    noise = [s.noise.sample(times) for s in problem.sensors]
    prices = np.column_stack([s.cost.sample(times)[:, 0, 0] for s in problem.sensors])
    gaps, running, peaks = Gaps(problem), 0.0, []
    outputs = problem.output.sample(times) if is_peak(problem.criterion) else None
    S = problem.plant.covariance.astype(kind)
    if not problem.discrete:
        S, charged = gaps.across(0, S)
        running += charged
    R = None if problem.running is None else problem.running.sample(times)
    for k in range(len(times)):
        if R is not None and problem.running_at == "prior":
            running += float(np.sum(R[k] * S))
        if outputs is not None and counts(problem.criterion, "prior", times[k]):
            peaks.append(float(np.sum((outputs[k] @ S) * outputs[k])))
        for j in np.flatnonzero(weights[k] > 0):
            if problem.sensors[j].rows:
                S = _read(S, C[j][k].astype(kind), noise[j][k] / weights[k, j], kind)
        if R is not None and problem.running_at == "posterior":
            running += float(np.sum(R[k] * S))
        if outputs is not None and counts(problem.criterion, "posterior", times[k]):
            peaks.append(float(np.sum((outputs[k] @ S) * outputs[k])))
        if k < len(times) - 1 or problem.at == "predicted":
            S, charged = gaps.across(k + (not problem.discrete), S)
            running += charged
    D = problem.output.at(problem.output_at).astype(kind)
    if not problem.discrete:
        D = D @ gaps.beyond
    X = D @ S @ D.T
    prediction = float(np.trace(X))
    observation = problem.cost_weight * float(np.sum(prices * weights))
    value = prediction if problem.criterion is None else plain_value(problem.criterion, X, peaks)
    charged = 0.0 if problem.criterion is not None and problem.criterion.limit is not None else value
    return PlainCost(observation + running + charged, observation, running, prediction, value)


def _read(S: np.ndarray, C: np.ndarray, noise: np.ndarray, kind: type) -> np.ndarray:
    """S after a reading of covariance `noise`, row by row once the noise is white."""
    lower = np.linalg.cholesky((noise + noise.T) / 2).astype(kind)
    rows = C.copy()
    for i in range(len(rows)):  # forward substitution
        for j in range(i):
            rows[i] -= lower[i, j] * rows[j]
        rows[i] /= lower[i, i]
    one = np.eye(len(S), dtype=kind)
    for c in rows:
        b = S @ c
        gain = b / (1 + c @ b)
        left = one - np.outer(gain, c)
        S = left @ S @ left.T + np.outer(gain, gain)
        S = (S + S.T) / 2
    return S


class Gaps:
    """The plant from one instant to the next.

    Parameters
    ----------
    problem : of readings
    """

    def __init__(self, problem: ReadingsProblem):
        self._problem, plant = problem, problem.plant
        if problem.discrete:
            k = problem.clock.times
            self._F, self._Q = plant.F.sample(k), plant.Q.sample(k)
            self._G = None if plant.G is None else plant.G.sample(k)
            return
        start, since = problem.clock.start, cast(SampleTimes, problem.clock).since
        self._integral = problem.running is not None and problem.running_at == "integral"
        if (known := problem.gaps) is not None:  # of a linearised plant, whose maps are what is given
            self._Phi, self._N, self.beyond = known.transition, known.noise, known.beyond[0]
            if self._integral:
                self._M, self._c = known.charges(cast(Signal, problem.running))
            return
        self._Phi, self._N, self._M, self._c = _integrated(problem, since[:-1], since[1:], self._integral)
        last = float(problem.predict_at or 0.0) - start
        self.beyond = _integrated(problem, since[-1:], np.array([max(last, since[-1])]), False)[0][0]

    def transition(self, k: int) -> np.ndarray:
        """F or Phi (n, n) of gap `k`."""
        return self._F[k] if self._problem.discrete else self._Phi[k]

    def across(self, k: int, S: np.ndarray) -> tuple[np.ndarray, float]:
        """S, (n, n), after gap `k`, and what the running integral charged on it."""
        if self._problem.discrete:
            Q = self._Q[k] if self._G is None else self._G[k] @ self._Q[k] @ self._G[k].T
            F = self._F[k].astype(S.dtype)
            S = F @ S @ F.T + Q
            return (S + S.T) / 2, 0.0
        charged = float(np.sum(self._M[k] * S)) + float(self._c[k]) if self._integral else 0.0
        F = self._Phi[k].astype(S.dtype)
        S = F @ S @ F.T + self._N[k]
        return (S + S.T) / 2, charged


def _integrated(problem: ReadingsProblem, starts: np.ndarray, ends: np.ndarray, charged: bool):
    """Phi, Q, M (K, n, n) and c (K,) of many gaps, by the extrapolated midpoint rule; equal gaps are done once."""
    plant, origin = problem.plant, problem.clock.start
    fixed = plant.A.constant and plant.noise.constant and (not charged or cast(Signal, problem.running).constant)
    if fixed:
        spans, index = np.unique(ends - starts, return_inverse=True)
        starts, ends = np.zeros(len(spans)), spans
    else:
        index = np.arange(len(starts))
    probed = origin + starts[:, None] + (ends - starts)[:, None] * np.linspace(0, 1, 5)
    size = np.linalg.norm(plant.A.sample(probed.ravel()), 1, axis=(1, 2)).reshape(probed.shape).max(axis=1)
    parts = np.maximum(1, np.ceil(size * (ends - starts) / SHORT)).astype(int)
    found = []
    for a, b, p in zip(starts, ends, parts, strict=True):
        found.append(_one_gap(problem, a, b, int(p), origin, charged))
    return tuple(np.array([each[i] for each in found])[index] for i in range(4))


def _one_gap(problem: ReadingsProblem, a: float, b: float, parts: int, origin: float, charged: bool):
    n = problem.states
    moving = [problem.plant.A, problem.plant.noise, *([cast(Signal, problem.running)] if charged else [])]
    inner = np.concatenate([s.breaks(origin + a, origin + b) for s in moving]) - origin
    cuts = np.union1d(np.linspace(a, b, parts + 1), inner[(inner > a) & (inner < b)])
    Phi, Q, M, c = np.eye(n), np.zeros((n, n)), np.zeros((n, n)), 0.0
    for left, right in pairwise(cuts):
        if right > left:
            Phi, Q, M, c = _step(problem, left, right, origin, charged, (Phi, Q, M, c))
    return Phi, Q, M, c


def _step(problem: ReadingsProblem, a: float, b: float, origin: float, charged: bool, state):
    """One step of the extrapolation for Phi, Q, M = int Phi' R Phi and c = int tr(R Q)."""
    plant, n = problem.plant, problem.states
    table: list[list] = []
    for row, count in enumerate(ORDERS):
        h = (b - a) / count
        # a held table takes its next value at the very end: the last time lies just inside
        times = origin + a + (b - a) * np.minimum(np.arange(count + 1) / count, 1 - 1e-9)
        A, X = plant.A.sample(times), plant.noise.sample(times)
        R = cast(Signal, problem.running).sample(times) if charged else np.zeros((count + 1, n, n))

        def slope(i: int, y, A=A, X=X, R=R):
            P, Q, _, _ = y
            drift = A[i] @ Q
            return A[i] @ P, drift + drift.T + X[i], P.T @ R[i] @ P, float(np.sum(R[i] * Q))

        before = state
        now = tuple(y + h * d for y, d in zip(state, slope(0, state), strict=True))
        for i in range(1, count):
            before, now = now, tuple(y + 2 * h * d for y, d in zip(before, slope(i, now), strict=True))
        last = slope(count, now)
        entry = [0.5 * (x + y + h * d) for x, y, d in zip(before, now, last, strict=True)]
        table.append([entry])
        for m in range(1, row + 1):
            ratio = (ORDERS[row] / ORDERS[row - m]) ** 2 - 1
            fine, coarse = table[row][m - 1], table[row - 1][m - 1]
            table[row].append([x + (x - y) / ratio for x, y in zip(fine, coarse, strict=True)])
    return tuple(table[-1][-1])

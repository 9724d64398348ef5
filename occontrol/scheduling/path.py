"""A policy followed step by step in plain array code: for checks and for output, not for the solvers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occontrol.scheduling.criterion import Criterion, TraceCriterion
from occontrol.scheduling.recursion import Recursion


@dataclass(frozen=True, eq=False)
class StepPath:
    """Covariance and costate at every update of a recursion, K steps.

    Parameters
    ----------
    before : (K, n, n) S- of each update
    after : (K, n, n) S+
    costate : (K, n, n) dJ/dS+: what a small change of S+ would cost in all that follows
    final : (n, n) S after predict K
    """

    before: np.ndarray
    after: np.ndarray
    costate: np.ndarray
    final: np.ndarray


def step_path(recursion: Recursion, weights: np.ndarray, criterion: Criterion | None = None) -> StepPath:
    """Forward and backward along a policy, measurement row by measurement row.

    Parameters
    ----------
    recursion : Recursion
    weights : (N, M) policy
    criterion : Criterion of the last covariance; tr(W S) with the recursion's own W if left out
    """
    r, v = recursion, recursion.on_steps(weights)
    criterion = criterion or TraceCriterion(r.terminal)
    n, K = r.states, len(r.steps)
    per_row = np.repeat(np.arange(r.sensors), np.diff(r.offsets))
    before, after, costate, gains = (np.empty((K, n, n)) for _ in range(4))
    S = r.initial
    for k in range(K):
        F = r.transition[r.predict[k]]
        S = before[k] = _mean(F @ S @ F.T + r.noise[r.predict[k]])
        gains[k] = np.eye(n)
        for row in r.rows[r.row_set[k]] * np.sqrt(r.steps[k] * v[k, per_row])[:, None]:
            gain = S @ row / (1.0 + row @ S @ row)
            each = np.eye(n) - np.outer(gain, row)
            S = each @ S @ each.T + np.outer(gain, gain)
            gains[k] = each @ gains[k]
        S = after[k] = _mean(S)
    F = r.transition[r.predict[K]]
    final = _mean(F @ S @ F.T + r.noise[r.predict[K]])
    P = criterion.gradient(final)
    for k in range(K - 1, -1, -1):
        F = r.transition[r.predict[k + 1]]
        R = r.running[r.running_set[k]] if len(r.running) else np.zeros((n, n))
        P = costate[k] = _mean(F.T @ P @ F) + r.charges[k, 1] * R
        P = gains[k].T @ P @ gains[k] + r.charges[k, 0] * R
    return StepPath(before, after, costate, final)


def _mean(matrix: np.ndarray) -> np.ndarray:
    return (matrix + matrix.T) / 2

"""Covariance, costate and switching functions at the nodes of the grid, by the plain form of the recursion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occontrol.families.athans.discretise import HalfPredicts
from occontrol.scheduling.recursion import Recursion


@dataclass(frozen=True, eq=False)
class Path:
    """Covariance, costate and switching functions along a policy.

    Parameters
    ----------
    covariance : (N+1, n, n) at the nodes
    updated : (N, n, n) S+ after each update (at the midpoints)
    costate : (N+1, n, n) at the nodes
    switching : (N, M) s_j = alpha q_j - tr(L_j S+ P+ S+)
    """

    covariance: np.ndarray
    updated: np.ndarray
    costate: np.ndarray
    switching: np.ndarray


def node_path(recursion: Recursion, halves: HalfPredicts, weights: np.ndarray) -> Path:
    """Covariance and costate at the nodes, S+ and the switching functions of every sensor, available or not.

    The slow, plain form of the recursion with the two half predicts apart; for output, not for the solvers.

    Parameters
    ----------
    recursion : Recursion with one step a decision
    halves : HalfPredicts of the same grid
    weights : (N, M) policy
    """
    r, n, N = recursion, recursion.states, recursion.intervals
    F = halves.transition
    gains = []
    covariance, updated = np.empty((N + 1, n, n)), np.empty((N, n, n))
    S = covariance[0] = r.initial
    per_row = np.repeat(np.arange(r.sensors), np.diff(r.offsets))
    for k in range(N):
        a, b = halves.index[2 * k], halves.index[2 * k + 1]
        C = r.rows[r.row_set[k]] * np.sqrt(r.steps[k] * weights[k, per_row])[:, None]
        left = np.eye(n)
        S = F[a] @ S @ F[a].T + halves.noise[a]
        # row by row: I + C S C' is singular in doubles where S is huge and the rows nearly parallel
        for row in C[np.any(C != 0, axis=1)]:
            gain = S @ row / (1.0 + row @ S @ row)
            each = np.eye(n) - np.outer(gain, row)
            S = each @ S @ each.T + np.outer(gain, gain)
            left = each @ left
        S = updated[k] = (S + S.T) / 2
        gains.append(left)
        S = F[b] @ S @ F[b].T + halves.noise[b]
        S = covariance[k + 1] = (S + S.T) / 2
    costate, switching = np.empty((N + 1, n, n)), np.empty((N, r.sensors))
    P = costate[N] = r.terminal
    for k in range(N - 1, -1, -1):
        a, b = halves.index[2 * k], halves.index[2 * k + 1]
        R = 0.5 * r.steps[k] * r.running[r.running_set[k]] if len(r.running) else 0.0
        P = F[b].T @ P @ F[b] + R
        rows = r.rows[r.row_set[k]] @ updated[k]
        per = np.einsum("ri,ij,rj->r", rows, P, rows)
        switching[k] = r.cost[k] / r.steps[k] - np.bincount(per_row, per, minlength=r.sensors)
        P = gains[k].T @ P @ gains[k] + R
        P = F[a].T @ P @ F[a]
        P = costate[k] = (P + P.T) / 2
    return Path(covariance, updated, costate, switching)

"""Gains and covariances along a schedule as factors L diag(d) L', which need no square root on the target."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occontrol.core.target import TargetModel
from occontrol.files.export.flight.tables import distinct
from occontrol.numerics.linalg import square_root
from occontrol.numerics.square_root_filter import advance, gain_of

ROUNDINGS = 16.0  # of the largest edge, between what two equal intervals give
LARGEST_SHARE = 1e-9  # of a number, beyond which intervals are never called equal
SPANNED = 2e-15  # of a row's length: what is left of one that the earlier rows span


@dataclass(frozen=True, eq=False)
class FlightPlan:
    """What the filter does while everything arrives.

    Parameters
    ----------
    gain : N arrays K (n, m)
    innovation_root : N arrays D (m, m), lower triangular, D D' = Y
    root : (N+1, n, n) S with P = S S' at the nodes
    """

    gain: list[np.ndarray]
    innovation_root: list[np.ndarray]
    root: np.ndarray


def same_intervals(model: TargetModel, edges: np.ndarray) -> np.ndarray:
    """(N,) for every interval the first one that is the same but for the rounding of its edges: its F, H and noise are.

    Parameters
    ----------
    model : TargetModel with N intervals
    edges : (N+1,) their times
    """
    n, N = model.states, len(model.transition)
    m = max((len(d) for d in model.offset), default=0)
    rows, near = np.zeros((2, N, 1 + n * n + m * n + (n + m) ** 2))
    h = np.maximum(np.diff(edges), np.spacing(np.abs(edges[-1])))
    # an edge is known to its last place, and Q may go with the fifth power of the length
    share = np.minimum(ROUNDINGS * np.spacing(np.max(np.abs(edges))) / h, LARGEST_SHARE)
    for k in range(N):
        F, H, root = model.transition[k], model.observe[k], model.noise_root[k]
        size = np.linalg.norm(root, axis=1)
        parts = [np.array([float(len(H))]), F, H, root @ root.T]
        scales = [np.zeros(1), _sizes(F), _sizes(H), np.outer(size, size)]
        row, scale = (np.concatenate([part.ravel() for part in each]) for each in (parts, scales))
        rows[k, : len(row)], near[k, : len(row)] = row, share[k] * scale
    kept, index = distinct(rows, near)
    return kept[index]


def _sizes(matrix: np.ndarray) -> np.ndarray:
    """For every entry the smaller one of the largest entries of its row and of its column."""
    absolute = np.abs(matrix)
    largest = [np.max(absolute, axis=axis, initial=0.0, keepdims=True) for axis in (0, 1)]
    return np.maximum(absolute, np.minimum(*largest))


def make_plan(model: TargetModel, same: np.ndarray) -> FlightPlan:
    """Gains and covariances when every planned value arrives.

    Parameters
    ----------
    model : TargetModel with N intervals
    same : (N,) from `same_intervals`
    """
    n, N = model.states, len(model.transition)
    root = np.empty((N + 1, n, n))
    root[0] = square_root(model.covariance, floor=0.0)
    gains, innovations = [], []
    for k in range(N):
        j = same[k]
        noise = model.noise_root[j]
        stacked = np.ascontiguousarray(np.concatenate((noise[n:], noise[:n])))
        F, H = np.ascontiguousarray(model.transition[j]), np.ascontiguousarray(model.observe[j])
        root[k + 1], normalised, innovation = advance(root[k], F, H, stacked)
        gains.append(gain_of(normalised, innovation))
        innovations.append(innovation)
    return FlightPlan(gains, innovations, root)


def unit_factor(root: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """L below its diagonal, row by row (n(n-1)/2,), and d (n,) of G G' = L diag(d) L'.

    Gram-Schmidt on the rows, the later ones made orthogonal to each one in turn: rows of very different size keep their
    own digits, and a row that the earlier ones span gets no pivot.

    Parameters
    ----------
    root : (n, s) G
    """
    rows = np.array(root, dtype=float)
    n = len(rows)
    size = np.einsum("ij,ij->i", rows, rows)
    unit, pivot = np.zeros((n, n)), np.zeros(n)
    for i in range(n):
        left = float(rows[i] @ rows[i])
        if left > SPANNED**2 * size[i]:
            pivot[i] = left
            unit[i + 1 :, i] = rows[i + 1 :] @ rows[i] / left
            rows[i + 1 :] -= np.outer(unit[i + 1 :, i], rows[i])
    i, j = np.tril_indices(n, -1)
    return unit[i, j], pivot

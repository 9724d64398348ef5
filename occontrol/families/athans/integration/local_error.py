"""The error of every step of integration, weighted by what it does to the cost.

    e = tr(P D) + the same difference of the running charge and of the prices,   D = two halves - one step from one S

with the costate P after the step. The scheme is of second order, so the sum of e times 4/3 is the error of J.
"""

from __future__ import annotations

import numpy as np

from occontrol.families.athans.integration.folded import Folded
from occontrol.scheduling.kernels_costate import costate_back

BLOCK_BYTES = 3e7
CANCEL = 100.0  # innovation from which an update is done in Joseph's form


def step_errors(whole: Folded, half: Folded, weights: np.ndarray) -> np.ndarray:
    """(K,) e of the steps of a mesh along a policy; `whole` must have computed its gradient there last.

    Parameters
    ----------
    whole : Folded on the mesh
    half : Folded on the mesh halved
    weights : (N, M)
    """
    n, K = whole.fine.states, len(whole.mesh)
    v = weights[whole.mesh.owner]
    found = (half.fine.cost.reshape(K, 2, -1).sum(axis=1) - whole.fine.cost) * v
    errors = np.sum(found, axis=1)
    nodes, costate = node_matrices(whole, weights)
    v_half = np.repeat(v, 2, axis=0)
    block = max(1, int(BLOCK_BYTES / (8 * n * n)))
    for first in range(0, K, block):
        k = np.arange(first, min(first + block, K))
        one, charged = _advance(whole, nodes[k], v, k)
        middle, charged_a = _advance(half, nodes[k], v_half, 2 * k)
        two, charged_b = _advance(half, middle, v_half, 2 * k + 1)
        errors[k] += np.einsum("kij,kij->k", costate[k + 1], two - one) + charged_a + charged_b - charged
    return errors


def _rows(folded: Folded, v: np.ndarray, k: np.ndarray) -> np.ndarray:
    """(len(k), r, n) the rows of the sensors times the roots of h v."""
    r = folded.fine
    per_row = np.repeat(np.arange(r.sensors), np.diff(r.offsets))
    return r.rows[r.row_set[k]] * np.sqrt(r.steps[k, None] * v[k][:, per_row])[:, :, None]


def _charge(folded: Folded, S: np.ndarray, k: np.ndarray) -> np.ndarray:
    """(len(k),) half a step's running charge on the covariances S."""
    r = folded.fine
    if not len(r.running):
        return np.zeros(len(k))
    return 0.5 * r.steps[k] * np.einsum("kij,kij->k", r.running[r.running_set[k]], S)


def _advance(folded: Folded, S: np.ndarray, v: np.ndarray, k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The covariance one step later, and the running charge of the step."""
    halves = folded.halves
    a, b = halves.index[2 * k], halves.index[2 * k + 1]
    S = halves.transition[a] @ S @ np.swapaxes(halves.transition[a], 1, 2) + halves.noise[a]
    charged = _charge(folded, S, k)
    S = _updated(S, _rows(folded, v, k))
    charged = charged + _charge(folded, S, k)
    return halves.transition[b] @ S @ np.swapaxes(halves.transition[b], 1, 2) + halves.noise[b], charged


def _updated(S: np.ndarray, C: np.ndarray) -> np.ndarray:
    """(S^-1 + C'C)^-1 of many, row by row; in Joseph's form where S - b b' would cancel."""
    S = S.copy()
    for row in range(C.shape[1]):
        # of many sensors few are used at a time
        used = np.flatnonzero(np.any(C[:, row], axis=1))
        if not len(used):
            continue
        c, before = C[used, row], S[used]
        b = np.einsum("kij,kj->ki", before, c)
        innovation = np.einsum("ki,ki->k", c, b)
        gain = b / (1.0 + innovation)[:, None]
        after = before - gain[:, :, None] * b[:, None, :]
        large = np.flatnonzero(innovation > CANCEL)
        if len(large):
            K = np.eye(S.shape[1]) - gain[large, :, None] * c[large, None, :]
            after[large] = K @ before[large] @ np.swapaxes(K, 1, 2) + gain[large, :, None] * gain[large, None, :]
        S[used] = after
    return S


def node_matrices(folded: Folded, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Covariance and costate (K+1, n, n) at the ends of the steps, from the S+ that the gradient has kept.

    Parameters
    ----------
    folded : Folded whose gradient was computed last at this policy, and that keeps all covariances
    weights : (N, M)
    """
    v = weights[folded.mesh.owner]
    r, halves, n = folded.fine, folded.halves, folded.fine.states
    K = len(folded.mesh)
    plus = folded.sweep.kept[0][:, :n, :n]
    a, b = halves.index[0::2], halves.index[1::2]
    Fa, Fb = halves.transition[a], halves.transition[b]
    nodes = np.empty((K + 1, n, n))
    nodes[0] = r.initial
    nodes[1:] = Fb @ plus @ np.swapaxes(Fb, 1, 2) + halves.noise[b]
    C = _rows(folded, v, np.arange(K))
    loop = np.eye(n) - (plus @ np.swapaxes(C, 1, 2)) @ C
    before = loop @ Fa
    closed = Fb @ before
    costate = np.empty((K + 1, n, n))
    costate[K] = r.terminal
    if len(r.running):
        R = 0.5 * r.steps[:, None, None] * r.running[r.running_set]
        charged = np.swapaxes(before, 1, 2) @ R @ before + np.swapaxes(Fa, 1, 2) @ R @ Fa
    else:
        charged = np.zeros((1, n, n))
    costate_back(np.ascontiguousarray(closed), np.ascontiguousarray(charged), costate, np.empty((n, n)))
    return nodes, costate

"""A safe lower bound of the integral of min_{w in V} sum_j w_j s_j(t) for polynomials s_j.

The minimum of smooth functions has kinks, which no quadrature rule sees. Here every panel is halved until one vertex w
is shown, by the Bernstein coefficients of the differences s_j - s_i, to be the minimiser up to a stated excess, and the
excess that remains is subtracted: the result never exceeds the integral for the polynomials.
"""

from __future__ import annotations

import numpy as np

from occontrol.numerics.gauss import bernstein_matrix, halving_matrices

MAX_HALVINGS = 40
BATCH = 4096


def cheapest_vertices(values: np.ndarray, room: np.ndarray, select: float) -> np.ndarray:
    """Minimisers of sum_j w_j values_j over 0 <= w <= room, sum w = select: fill the cheapest first.

    Parameters
    ----------
    values, room : (P, M); where the rooms sum to less than `select` everything is filled

    Returns
    -------
    (P, M) weights
    """
    order = np.argsort(values, axis=1, kind="stable")
    sorted_room = np.take_along_axis(room, order, axis=1)
    filled = np.cumsum(sorted_room, axis=1)
    taken = np.clip(select - (filled - sorted_room), 0.0, sorted_room)
    weights = np.empty_like(taken)
    np.put_along_axis(weights, order, taken, axis=1)
    return weights


def minimum_integral(
    lengths: np.ndarray, values: np.ndarray, room: np.ndarray, select: float, tolerance: float
) -> tuple[float, float]:
    """Lower bound of sum_p int min_w sum_j w_j s_j dt over panels, and the excess that it holds back.

    Parameters
    ----------
    lengths : (P,) lengths of the panels
    values : (P, nodes, M) s_j at the Gauss nodes of each panel
    room : (P, M) largest weights
    select : what the weights sum to
    tolerance : aimed bound of the whole excess, in cost units

    Returns
    -------
    (bound, excess): bound <= integral <= bound + excess
    """
    bound = excess = 0.0
    for first in range(0, len(lengths), BATCH):
        part = slice(first, first + BATCH)
        share = tolerance * max(float(np.sum(lengths[part]) / np.sum(lengths)), 1e-12)
        coefficients = np.einsum("ij,pjm->pim", bernstein_matrix(values.shape[1]), values[part])
        below, over = _integrate(lengths[part], coefficients, room[part], select, share)
        bound, excess = bound + below, excess + over
    return bound, excess


def _integrate(h: np.ndarray, b: np.ndarray, room: np.ndarray, select: float, tolerance: float) -> tuple[float, float]:
    left, right = halving_matrices(b.shape[1])
    total, count = float(np.sum(h)), len(h)
    bound = excess = 0.0
    for depth in range(MAX_HALVINGS + 1):
        w = cheapest_vertices(np.mean(b, axis=1), room, select)
        dearest_used = np.max(np.where((w > 0)[:, None, :], b, -np.inf), axis=2)
        cheapest_spare = np.min(np.where((w < room)[:, None, :], b, np.inf), axis=2)
        over = select * h * np.maximum(0.0, np.max(dearest_used - cheapest_spare, axis=1))
        done = (over <= 0.5 * tolerance * h / total) | (over <= 0.02 * tolerance / count) | (depth == MAX_HALVINGS)
        bound += float(np.sum((h * np.einsum("pm,pm->p", np.mean(b, axis=1), w) - over)[done]))
        excess += float(np.sum(over[done]))
        if np.all(done):
            break
        h, b, room = h[~done] / 2, b[~done], room[~done]
        b = np.concatenate([np.einsum("ij,pjm->pim", left, b), np.einsum("ij,pjm->pim", right, b)])
        h, room = np.concatenate([h, h]), np.concatenate([room, room])
    return bound, excess

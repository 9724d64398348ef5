"""The set V of one interval's weights: 0 <= v_j <= upper_j, sum_j v_j = select; all intervals at once.

upper_j is 0 outside a sensor's windows, 1 inside, `select` for 'idle'.
"""

from __future__ import annotations

import numpy as np


def vertex(gradient: np.ndarray, upper: np.ndarray, select: int) -> np.ndarray:
    """argmin over V of gradient . w on every interval; ties go to the lowest index.

    Parameters
    ----------
    gradient : (N, M)
    upper : (N, M)
    select : sum of the weights

    Returns (N, M); integral because `upper` and `select` are.
    """
    if select == 1:
        choice = np.argmin(np.where(upper > 0, gradient, np.inf), axis=1)
        w = np.zeros_like(gradient)
        w[np.arange(len(w)), choice] = 1.0
        return w
    order = np.argsort(np.where(upper > 0, gradient, np.inf), axis=1, kind="stable")
    room = np.take_along_axis(upper, order, axis=1)
    before = np.cumsum(room, axis=1) - room
    w = np.zeros_like(gradient)
    np.put_along_axis(w, order, np.clip(select - before, 0.0, room), axis=1)
    return w


def excess(weights: np.ndarray, gradient: np.ndarray, upper: np.ndarray, select: int) -> np.ndarray:
    """(N,) v.g - min over V of w.g: what each interval could still save to first order; their sum is J minus the bound."""
    g = np.where(upper > 0, gradient, 0.0)
    return np.sum(g * (weights - vertex(gradient, upper, select)), axis=1)


def project(weights: np.ndarray, upper: np.ndarray, select: int) -> np.ndarray:
    """The nearest point of V, interval by interval (N, M).

    v_j = clip(y_j - lam, 0, upper_j) with lam such that the sum is `select`; lam from the sorted kinks (Held, Wolfe & Crowder 1974).
    """
    y, N, M = weights, *weights.shape
    kinks = np.sort(np.concatenate([y, y - upper], axis=1), axis=1)
    low, high = np.zeros(N, dtype=int), np.full(N, 2 * M - 1)
    rows = np.arange(N)
    # the sum falls as lam grows: find the last kink at which it is still >= select
    while np.any(high - low > 1):
        middle = (low + high) // 2
        total = np.sum(np.clip(y - kinks[rows, middle][:, None], 0.0, upper), axis=1)
        above = total >= select
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    a, b = kinks[rows, low], kinks[rows, high]
    at_a = np.sum(np.clip(y - a[:, None], 0.0, upper), axis=1)
    at_b = np.sum(np.clip(y - b[:, None], 0.0, upper), axis=1)
    fall = at_a - at_b
    share = np.clip(np.divide(at_a - select, fall, out=np.zeros(N), where=fall > 0), 0.0, 1.0)
    return np.clip(y - (a + share * (b - a))[:, None], 0.0, upper)


def uniform(upper: np.ndarray, select: int) -> np.ndarray:
    """The available sensors in equal shares (N, M): a feasible point that favours none."""
    v = np.zeros_like(upper)
    left = np.full(len(upper), float(select))
    for _ in range(upper.shape[1]):
        room = upper - v
        open_ = room > 1e-15
        count = np.maximum(np.sum(open_, axis=1), 1)
        step = np.minimum(room, np.where(open_, (left / count)[:, None], 0.0))
        v += step
        left = left - np.sum(step, axis=1)
        if np.all(left < 1e-14 * select):
            break
    return v

"""Compiled loops behind scheduling/feasible_set.py: 0 <= v_j <= upper_j, sum_j v_j = select, all intervals at once.

upper_j is 0 outside a sensor's windows, 1 inside, `select` for 'idle'.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from occontrol.numerics.loops import ENTRY, copy_vector

_OPTIONS = {"cache": True, "nogil": True, "error_model": "numpy", **ENTRY}
BISECTIONS = 100


@njit(**_OPTIONS)
def fill(g, upper, select, w):
    """w (M,) <- the vertex of one interval that minimises g.w: the cheapest open weights, on ties the lowest index."""
    M = len(g)
    for j in range(M):
        w[j] = 0.0
    left = float(select)
    while left > 0.0:
        best = -1
        for j in range(M):
            if upper[j] > w[j] and (best < 0 or g[j] < g[best]):
                best = j
        if best < 0:
            return
        w[best] = upper[best] if upper[best] < left else left
        left -= w[best]


@njit(**_OPTIONS)
def _vertex(g, upper, select, w):
    for k in range(len(g)):
        fill(g[k], upper[k], select, w[k])


@njit(**_OPTIONS)
def _excess(v, g, upper, select, found, w):
    for k in range(len(g)):
        fill(g[k], upper[k], select, w)
        total = 0.0
        for j in range(len(w)):
            if upper[k, j] > 0.0:
                total += g[k, j] * (v[k, j] - w[j])
        found[k] = total


def vertex(gradient: np.ndarray, upper: np.ndarray, select: int) -> np.ndarray:
    """argmin over V of gradient . w on every interval; ties go to the lowest index.

    Parameters
    ----------
    gradient : (N, M)
    upper : (N, M)
    select : sum of the weights

    Returns (N, M); integral because `upper` and `select` are.
    """
    w = np.empty(gradient.shape)
    _vertex(np.ascontiguousarray(gradient), upper, select, w)
    return w


def excess(weights: np.ndarray, gradient: np.ndarray, upper: np.ndarray, select: int) -> np.ndarray:
    """(N,) v.g - min over V of w.g: what each interval could still save to first order; their sum is J minus the bound.

    Parameters
    ----------
    weights, gradient, upper : (N, M)
    select : sum of the weights
    """
    found, least = np.empty(len(weights)), np.empty(upper.shape[1])
    _excess(np.ascontiguousarray(weights), np.ascontiguousarray(gradient), upper, select, found, least)
    return found


@njit(**_OPTIONS, inline="always")
def project_row(y, upper, select, w):
    """w (M,) <- clip(y - lam, 0, upper) with the sum `select`."""
    M = len(y)
    # the multiplier lies between these two; the clipped sum falls as it grows
    low, high = np.inf, -np.inf
    for j in range(M):
        if upper[j] > 0.0:
            x = y[j] - upper[j]
            low = x if x < low else low
            high = y[j] if y[j] > high else high
    lam = 0.5 * (low + high)
    for _ in range(BISECTIONS):
        total, slope = 0.0, 0
        for j in range(M):
            x = y[j] - lam
            if upper[j] > 0.0 and x > 0.0:
                if x >= upper[j]:
                    total += upper[j]
                else:
                    total += x
                    slope += 1
        rest = total - select
        if abs(rest) <= 1e-15 * select:
            break
        if rest > 0.0:
            low = lam
        else:
            high = lam
        # Newton on the piecewise linear sum, bisection where it leaves the bracket
        trial = lam + rest / slope if slope > 0 else 0.5 * (low + high)
        lam = trial if low < trial < high else 0.5 * (low + high)
    for j in range(M):
        x = y[j] - lam if y[j] > lam else 0.0
        w[j] = x if x < upper[j] else upper[j]


@njit(**_OPTIONS)
def _project(y, upper, select, w):
    for k in range(len(y)):
        project_row(y[k], upper[k], select, w[k])


def project(weights: np.ndarray, upper: np.ndarray, select: int) -> np.ndarray:
    """The nearest point of V, interval by interval: v_j = clip(y_j - lam, 0, upper_j) with the sum `select`.

    Parameters
    ----------
    weights, upper : (N, M)
    select : sum of the weights
    """
    w = np.empty(weights.shape)
    _project(np.ascontiguousarray(weights), upper, float(select), w)
    return w


def uniform(upper: np.ndarray, select: int) -> np.ndarray:
    """The available sensors in equal shares (N, M): a feasible point that favours none.

    Parameters
    ----------
    upper : (N, M)
    select : sum of the weights
    """
    v = np.zeros(upper.shape)
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


def mixture(
    constants: np.ndarray, gradients: np.ndarray, last: int, upper: np.ndarray, select: int, rounds: int, wanted: float
) -> float:
    """The best bound of the cuts by entropic ascent on their shares, from cut `last`, up to `wanted`.

    The same as FeasibleSet.mixture, without a pass of its own for every step.

    Parameters
    ----------
    constants : (K,) of the cuts
    gradients : (K, N, M)
    last : cut that the ascent begins at
    upper : (N, M)
    select : sum of the weights
    rounds : steps at most
    wanted : value at which to stop
    """
    shares = np.zeros(len(constants))
    shares[last] = 1.0
    space = (shares, np.empty(len(constants)), *np.empty((2, upper.shape[1])))
    return _mixture(constants, gradients, upper, select, rounds, wanted, *space)


@njit(cache=True, nogil=True, fastmath={"contract", "nsz", "reassoc"}, error_model="numpy", **ENTRY)
def _mixture(a, g, upper, select, rounds, wanted, shares, values, mixed, w):
    N, M = upper.shape
    count = len(a)
    best = -np.inf
    for turn in range(rounds):
        copy_vector(a, values)
        for k in range(N):
            for j in range(M):
                mixed[j] = 0.0
            for i in range(count):
                x = shares[i]
                if x > 1e-9:  # any shares are valid, so the smallest may be dropped
                    for j in range(M):
                        mixed[j] += x * g[i, k, j]
            fill(mixed, upper[k], select, w)
            for j in range(M):
                x = w[j]
                if x > 0.0:
                    for i in range(count):
                        values[i] += x * g[i, k, j]
        # w minimises the mixture of the kept shares, so their sum is the divisor
        total = kept = 0.0
        low, high = np.inf, -np.inf
        for i in range(count):
            if shares[i] > 1e-9:
                total += shares[i] * values[i]
                kept += shares[i]
            low = values[i] if values[i] < low else low
            high = values[i] if values[i] > high else high
        total /= kept
        best = total if total > best else best
        if not high > low or best >= wanted:
            break
        total = 0.0
        for i in range(count):
            shares[i] = (shares[i] + 1e-4) * np.exp(3.0 / (high - low) / np.sqrt(turn + 1.0) * (values[i] - high))
            total += shares[i]
        for i in range(count):
            shares[i] /= total
    return best

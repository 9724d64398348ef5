"""Finite escape of a game Riccati flow, in information form.

P(t + h) escapes when P(t)^-1 + R(h) becomes singular, R the span's observability part. Without sensors -R grows with h,
so the test at h also covers everything before h, and it needs P at the start of the span only. With sensors P may
escape and come back within a span, so a span is first proven free of escapes without its sensor (which only helps),
and only the last stretch, too short for such a proof, is searched for the first zero of the smallest eigenvalue.
Unknown: Pi = P^-1, (n, n) symmetric.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from scipy.optimize import brentq

from occontrol.core.errors import SolveFailed
from occontrol.core.signal import ConstantSignal
from occontrol.numerics.scattering import Flow, compose_exists, star

RESOLUTION = 1e-15  # of a time, relative
SHORTEST = 1e-6  # of a span, relative: below it the zero is bracketed instead of proven away


def smallest(matrix: np.ndarray) -> float:
    """The smallest eigenvalue of a symmetric matrix."""
    return float(np.linalg.eigvalsh((matrix + matrix.T) / 2)[0])


def free_weights(flow: Flow, edges: np.ndarray) -> np.ndarray | None:
    """X (N+1, n, n) at the edges, X(T) = 0, without sensors; None when it escapes on the way back to edges[0].

    -dX/dt = A'X + X A + K'K + X BB' X
    """
    (F, Q, R), exists = flow.free_elements(edges[:-1], edges[1:])
    if not np.all(exists):
        return None
    X = np.zeros((len(edges), flow.n, flow.n))
    later = None
    for k in range(len(edges) - 2, -1, -1):
        slot = (F[k], Q[k], R[k])
        if later is not None and not compose_exists(slot, later):
            return None
        later = slot if later is None else star(slot, later)
        X[k] = -later[2]
    return X


def inverse_after(inverse: np.ndarray, element) -> np.ndarray:
    """P^-1 at the end of a span from P^-1 at its start:  (Q + F (Pi + R)^-1 F')^-1."""
    F, Q, R = element
    P = Q + F @ np.linalg.solve(inverse + R, F.T)
    result = np.linalg.inv((P + P.T) / 2)
    return (result + result.T) / 2


def horizon(flow: Flow, weight: np.ndarray, start: float = 0.0, limit: float = np.inf) -> float | None:
    """The supremum of T for which X exists on [start, T] and X(start) < X0; None when there is none below `limit`.

    It is the escape time of the sensor-free P from P(start) = X0^-1. Constant plants need no limit: on the part of the
    state that K sees, P either escapes or stands still.

    Parameters
    ----------
    flow : Flow; its sensors are ignored
    weight : (n, n) X0
    start, limit : times
    """
    if flow.constant:
        flow, weight = _observable(flow, weight)
        if flow is None:
            return None
        limit = min(limit, start + 1e12 / flow.rate)
    t, inverse = start, weight
    h = 0.5 / flow.rate if flow.constant else (limit - start) / 64
    failed = np.inf
    while t < limit:
        end = min(t + h, limit, failed)
        element, exists = flow.free_elements(np.array([t]), np.array([end]))
        F, Q, R = (part[0] for part in element)
        if exists[0] and smallest(inverse + R) > 0:
            following = inverse_after(inverse, (F, Q, R))
            still = flow.constant and np.allclose(following, inverse, rtol=1e-15, atol=0) and np.max(np.abs(F)) < 1e-8
            if still or (end >= limit):
                return None
            t, inverse = end, following
            h *= 2.0 if np.isinf(failed) else 1.0
        else:
            failed = end
        if np.isfinite(failed):
            h = (failed - t) / 2
            if h <= RESOLUTION * max(abs(t), abs(failed - start)):
                return failed
    return None


def _observable(flow: Flow, weight: np.ndarray) -> tuple[Flow | None, np.ndarray]:
    """The part of a constant plant that K sees: X lives there, and X0 is replaced by its Schur complement."""
    A, B, K = flow.A.at(0.0), flow.B.at(0.0), flow.gain * flow.K.at(0.0)
    scale = max(np.linalg.norm(A, 2), 1e-300)
    block, rows = K, [K]
    for _ in range(flow.n - 1):
        block = block @ A / scale
        rows.append(block)
    _, values, vectors = np.linalg.svd(np.concatenate(rows))
    rank = int(np.sum(values > 1e-13 * max(values[0], 1e-300))) if values[0] > 0 else 0
    if rank == 0:
        return None, weight
    seen = vectors[:rank]
    shape = seen @ np.linalg.solve(weight, seen.T)
    parts = (ConstantSignal(m) for m in (seen @ A @ seen.T, seen @ B, K @ seen.T))
    return Flow(*parts), np.linalg.inv((shape + shape.T) / 2)


def escape_time(flow: Flow, weight: np.ndarray, edges: np.ndarray, sequence: Sequence[int | None]) -> float | None:
    """When P of a schedule escapes, from P(edges[0]) = X0^-1; None when it lives to edges[-1].

    Parameters
    ----------
    flow : Flow
    weight : (n, n) X0
    edges : (N+1,) slot edges
    sequence : (N,) the sensor of each slot, None for no sensor

    Raises SolveFailed when P grazes the escape so closely that its time cannot be told.
    Savkin, Evans & Skafidas, theorem 2.1 (i).
    """
    inverse = weight
    for a, b, sensor in zip(edges[:-1], edges[1:], sequence, strict=True):
        t, h = float(a), float(b - a)
        for _ in range(20_000):
            if t >= b:
                break
            end = min(t + h, b)
            (_F, _Q, R), exists = flow.free_elements(np.array([t]), np.array([end]))
            if exists[0] and smallest(inverse + R[0]) > 0:
                inverse = inverse_after(inverse, flow.element(t, end, sensor))
                t, h = end, 2 * h
            elif end - t > SHORTEST * (b - a):
                h = (end - t) / 2
            else:
                found = _bracket(flow, inverse, t, min(t + 64 * SHORTEST * (b - a), b), sensor)
                if found is not None:
                    return found
                # the sensor holds it off: go on with what it gives
                end = min(t + 64 * SHORTEST * (b - a), b)
                inverse = inverse_after(inverse, flow.element(t, end, sensor))
                t = end
        else:
            raise SolveFailed(f"the set of states grazes infinity near t = {t:.10g}; its escape time cannot be told")
    return None


def _bracket(flow: Flow, inverse: np.ndarray, t: float, end: float, sensor: int | None) -> float | None:
    """The first zero of the smallest eigenvalue of Pi + R(h) on a short stretch, or None."""

    def margin(time: float) -> float:
        return smallest(inverse + flow.element(t, time, sensor)[2]) if time > t else smallest(inverse)

    times = np.linspace(t, end, 65)
    for left, right in itertools.pairwise(times):
        if margin(right) <= 0:
            return float(brentq(margin, left, right, xtol=1e-15 * max(abs(end), 1e-300), rtol=8.9e-16))
    return None


def gain_that_fits(flow: Flow, weight: np.ndarray, edges: np.ndarray) -> float:
    """The supremum of the factors f <= 1 on K for which the plant is uniformly robustly observable on [t0, T]."""
    low, high = 0.0, 1.0
    while high - low > 1e-9:
        factor = (low + high) / 2
        X = free_weights(flow.scaled(factor), edges)
        if X is not None and smallest(weight - X[0]) > 0:
            low = factor
        else:
            high = factor
    return low


def first_lost(flow: Flow, edges: np.ndarray) -> float | None:
    """The time at which X, followed back from edges[-1], escapes; None when it lives to edges[0]."""
    start, end = float(edges[0]), float(edges[-1])
    if free_weights(flow, edges) is not None:
        return None
    low, high = start, end  # X lives on (high, end], not on [low, end]
    while high - low > RESOLUTION * max(abs(start), abs(end)):
        middle = (low + high) / 2
        if middle in (low, high):
            break
        lives = free_weights(flow, np.append(middle, edges[edges > middle])) is not None
        low, high = (low, middle) if lives else (middle, high)
    return high

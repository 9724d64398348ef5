"""Finite escape of a game Riccati flow, by a test that needs no inverse of P.

P(t + h) escapes when P(t)^-1 + R(h) becomes singular, R the span's observability part; with a root P = G G' that is
when I + G'R G does. Without sensors -R grows with h, so the test at h also covers everything before h, and it needs P
at the start of the span only. With sensors P may escape and come back within a span, so a span is first proven free of
escapes without its sensor (which only helps), and only the last stretch, too short for such a proof, is searched for
the first zero of the smallest eigenvalue.
Unknown: P, (n, n) symmetric positive semidefinite.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from scipy.optimize import brentq

from occontrol.core.errors import SolveFailed
from occontrol.core.signal import ConstantSignal
from occontrol.families.robust.scattering import Element, Flow, advance, compose_exists, star

RESOLUTION = 1e-15  # of a time, relative
SHORTEST = 1e-6  # of a span, relative: below it the zero is bracketed instead of proven away


def smallest(matrix: np.ndarray) -> float:
    """The smallest eigenvalue of a symmetric `matrix` (n, n)."""
    return float(np.linalg.eigvalsh((matrix + matrix.T) / 2)[0])


def free_weights(flow: Flow, edges: np.ndarray) -> np.ndarray | None:
    """X (N+1, n, n) at the edges, X(T) = 0, without sensors; None when it escapes on the way back to edges[0].

    -dX/dt = A'X + X A + K'K + X BB' X

    `edges` (N+1,).
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


def margin(P: np.ndarray, R: np.ndarray) -> float:
    """The smallest eigenvalue of I + G'R G, P = G G': P escapes over the span when it reaches zero.

    P and R are (n, n) each, G too.
    """
    values, vectors = np.linalg.eigh((P + P.T) / 2)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    return smallest(np.eye(len(P)) + root.T @ R @ root)


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
        part = _observable(flow, weight)
        if part is None:
            return None
        flow, weight = part
        limit = min(limit, start + 1e12 / flow.rate)
    t, P = start, np.linalg.inv(weight)
    h = 0.5 / flow.rate if flow.constant else (limit - start) / 64
    before = np.zeros((flow.n, flow.n))

    def look(end: float) -> tuple[Element, bool]:
        element, exists = flow.free_elements(np.array([t]), np.array([end]))
        F, Q, R = (part[0] for part in element)
        return (F, Q, R), bool(exists[0]) and margin(P, R) > 0

    while t < limit:
        end = min(t + h, limit)
        element, lives = look(end)
        if not lives:
            # bisect from the same start, so that nothing is carried through a nearly infinite P
            low, high = t, end
            while high - low > RESOLUTION * max(abs(high), high - start):
                middle = (low + high) / 2
                if middle in (low, high):
                    break
                low, high = (middle, high) if look(middle)[1] else (low, middle)
            return high
        # X over a span of a constant plant has stopped growing with its length: nothing longer can fail
        settled = flow.constant and np.allclose(element[2], before, rtol=1e-14, atol=0)
        if settled or end >= limit:
            return None
        t, P, before, h = end, advance(P, element), element[2], 2 * h
    return None


def _observable(flow: Flow, weight: np.ndarray) -> tuple[Flow, np.ndarray] | None:
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
        return None
    seen = vectors[:rank]
    shape = seen @ np.linalg.solve(weight, seen.T)
    A, B, K = seen @ A @ seen.T, seen @ B, K @ seen.T
    return Flow(ConstantSignal(A), ConstantSignal(B), ConstantSignal(K)), np.linalg.inv((shape + shape.T) / 2)


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
    P = np.linalg.inv(weight)
    for a, b, sensor in zip(edges[:-1], edges[1:], sequence, strict=True):
        t, h = float(a), float(b - a)
        for _ in range(20_000):
            if t >= b:
                break
            end = min(t + h, b)
            (_F, _Q, R), exists = flow.free_elements(np.array([t]), np.array([end]))
            if exists[0] and margin(P, R[0]) > 0:
                P = advance(P, flow.element(t, end, sensor))
                t, h = end, 2 * h
            elif end - t > SHORTEST * (b - a):
                h = (end - t) / 2
            else:
                found = _bracket(flow, P, t, min(t + 64 * SHORTEST * (b - a), b), sensor)
                if found is not None:
                    return found
                # the sensor holds it off: go on with what it gives
                end = min(t + 64 * SHORTEST * (b - a), b)
                P = advance(P, flow.element(t, end, sensor))
                t = end
        else:
            raise SolveFailed(f"the set of states grazes infinity near t = {t:.10g}; its escape time cannot be told")
    return None


def _bracket(flow: Flow, P: np.ndarray, t: float, end: float, sensor: int | None) -> float | None:
    """The first zero of the margin on a short stretch, or None."""

    def left_over(time: float) -> float:
        return margin(P, flow.element(t, time, sensor)[2]) if time > t else 1.0

    times = np.linspace(t, end, 65)
    for left, right in itertools.pairwise(times):
        if left_over(right) <= 0:
            xtol = 1e-15 * max(abs(end), 1e-300)
            return float(brentq(left_over, left, right, xtol=xtol, rtol=8.9e-16))  # type: ignore[arg-type]
    return None


def gain_that_fits(flow: Flow, weight: np.ndarray, edges: np.ndarray) -> float:
    """The supremum of the factors f <= 1 on K for which the plant is uniformly robustly observable on [t0, T].

    `weight` is X0 (n, n), `edges` (N+1,).
    """
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
    """The time at which X, followed back from edges[-1], escapes; None when it lives to edges[0]. `edges` (N+1,)."""
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

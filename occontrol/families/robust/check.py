"""The independent judge of a switching schedule: adaptive integration of the paper's own equations.

P forward by (17), Y backward by the corrected (25), both with a general-purpose integrator; nothing is shared with the
span elements of the search.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from occontrol.families.robust.ellipsoid_size import Size
from occontrol.families.robust.game import center_weight_rate, shape_rate
from occontrol.families.robust.scattering import Flow

TOLERANCE = 1e-11


@dataclass(frozen=True, eq=False)
class Judged:
    """P(T), Y(t0), the level and the size that they give."""

    shape: np.ndarray
    center_weight: np.ndarray
    level: float
    cost: float


def integrate(
    flow: Flow,
    edges: np.ndarray,
    sequence: Sequence[int | None],
    weight: np.ndarray,
    center: np.ndarray,
    level: float,
    size: Size,
) -> Judged | None:
    """Cost of a sequence by direct integration; None when the integrator gives up.

    Parameters
    ----------
    flow : Flow, for its signals
    edges : (N+1,) slot edges
    sequence : (N,) sensors, None for no sensor
    weight, center, level : X0 (n, n), x0 (n,), d
    size : Size
    """
    from scipy.integrate import solve_ivp

    n = flow.n
    # one tolerance for all states: in units of their own, powers of two, so that other units change no bit
    start = np.linalg.inv(weight)
    d = np.exp2(np.rint(np.log2(np.diagonal(start)) / 2))
    spans = []
    # where tables and formulas jump: an adaptive step would run over some of them
    breaks = np.unique(np.concatenate([flow.cuts(float(edges[0]), float(edges[-1])), np.array(sorted(flow.kinks))]))
    for a, b, sensor in zip(edges[:-1], edges[1:], sequence, strict=True):
        inner = breaks[(breaks > a + 1e-9 * (b - a)) & (breaks < b - 1e-9 * (b - a))]
        nodes = [a, *inner, b]
        spans += [(s, e, sensor) for s, e in itertools.pairwise(nodes)]

    def inside(t: float, span: tuple) -> float:
        # a table that jumps at the end of the span must not be read beyond it
        return min(max(t, span[0]), span[1] - 1e-13 * max(abs(span[1]), span[1] - span[0]))

    def matrices(t: float, span: tuple) -> tuple:
        t = inside(span[0] + t, span)
        C = np.zeros((0, n)) if span[2] is None else flow.rows[span[2]].at(t)
        return flow.A.at(t) * d / d[:, None], flow.B.at(t) / d[:, None], flow.gain * flow.K.at(t) * d, C * d

    def run(rate, start: np.ndarray, span: tuple, backward: bool):
        # counted from the start of the span: a clock at 1.7e9 could not tell the integrator's steps apart
        length = span[1] - span[0]
        limits = (length, 0.0) if backward else (0.0, length)
        scale = float(np.max(np.abs(start), initial=0.0)) or 1e-3
        done = solve_ivp(
            rate, limits, start, "DOP853", dense_output=not backward, rtol=TOLERANCE, atol=TOLERANCE * scale
        )
        return done if done.success and np.all(np.isfinite(done.y)) else None

    P, paths = (start / np.outer(d, d)).ravel(), []
    for span in spans:

        def forward(t: float, z: np.ndarray, span=span) -> np.ndarray:
            A, B, K, C = matrices(t, span)
            return shape_rate(z.reshape(n, n), A, B, K, C).ravel()

        with np.errstate(all="ignore"):
            done = run(forward, P, span, False)
        if done is None:
            return None
        paths.append(done.sol)
        P = done.y[:, -1]
    Y = np.zeros(n * n)
    for span, path in zip(reversed(spans), reversed(paths), strict=True):

        def back(t: float, z: np.ndarray, span=span, path=path) -> np.ndarray:
            A, _, K, C = matrices(t, span)
            return center_weight_rate(z.reshape(n, n), path(t).reshape(n, n), A, K, C).ravel()

        with np.errstate(all="ignore"):
            done = run(back, Y, span, True)
        if done is None:
            return None
        Y = done.y[:, -1]
    shape, weight0 = P.reshape(n, n) * np.outer(d, d), Y.reshape(n, n) / np.outer(d, d)
    shape, weight0 = (shape + shape.T) / 2, (weight0 + weight0.T) / 2
    if np.linalg.eigvalsh(shape)[0] <= 0:
        return None
    total = float(level + center @ weight0 @ center)
    return Judged(shape, weight0, total, float(size.value(shape, total)))

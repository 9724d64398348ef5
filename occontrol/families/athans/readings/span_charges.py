"""The running integral between two readings, as a charge on the covariance after the first of them.

    int_a^b tr(R(t) S(t)) dt = tr(M S(a)) + c        dS/dt = A S + S A' + Xi on [a, b]
    M = int_a^b Phi(t, a)' R Phi(t, a) dt,           c = int_a^b tr(R(t) Q(a, t)) dt

Pieces short against the plant are integrated by Gauss's rule and joined:

    M = M1 + F1' M2 F1,   c = c1 + c2 + tr(M2 Q1),   F = F2 F1,   Q = F2 Q1 F2' + Q2

A gap is cut into twice as many pieces until M and c stand still.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce

import numpy as np

from occontrol.core.errors import SolveFailed
from occontrol.core.plant import LinearPlant
from occontrol.core.signal import Signal
from occontrol.numerics.transition import transitions, unique_spans

NODES, WEIGHTS = np.polynomial.legendre.leggauss(6)
SHORT = 0.5  # |A| times the length of a piece
SETTLED = 1e-12
MOST_PIECES = 1 << 14
JOINED = 8  # cuts of one gap that are tried


@dataclass(frozen=True, eq=False)
class Spans:
    """What happens between neighbouring times: F, Q, M (K, n, n) and c (K,)."""

    transition: np.ndarray
    noise: np.ndarray
    charge: np.ndarray
    constant: np.ndarray


def charged_spans(plant: LinearPlant, running: Signal, starts: np.ndarray, ends: np.ndarray, origin: float) -> Spans:
    """F, Q, M and c of many spans.

    Parameters
    ----------
    plant : with n states
    running : R, (n, n) Signal
    starts, ends : (K,) counted from `origin`; an empty span has the identity and zeros
    origin : the time that `starts` and `ends` are counted from

    Raises SolveFailed where a weight or a plant varies faster than can be integrated.
    """
    constant = plant.A.constant and plant.noise.constant and running.constant
    lengths = ends - starts
    if constant:
        spans, index = unique_spans(lengths)
        found = [_one(plant, running, 0.0, float(b), 0.0) for b in spans]
    else:
        index = np.arange(len(starts))
        found = [_one(plant, running, float(a), float(b), origin) for a, b in zip(starts, ends, strict=True)]
    F, Q, M, c = (np.array([part[i] for part in found]) for i in range(4))
    return Spans(F[index], Q[index], M[index], c[index])


def _one(plant: LinearPlant, running: Signal, a: float, b: float, origin: float):
    n = plant.states
    if b <= a:
        return np.eye(n), np.zeros((n, n)), np.zeros((n, n)), 0.0
    probed = origin + a + (b - a) * np.linspace(0.0, 1.0, 9)
    size = max(float(np.linalg.norm(A, 2)) for A in plant.A.sample(probed)) * (b - a)
    pieces = max(1, int(np.ceil(size / SHORT)))
    if plant.A.constant and plant.noise.constant and running.constant:
        doublings = int(np.ceil(np.log2(pieces)))
        found = _joined(plant, running, np.array([a, a + (b - a) / 2**doublings]), origin)
        for _ in range(doublings):
            found = _after(found, found)
        return found
    inner = np.concatenate([s.breaks(origin + a, origin + b) for s in (plant.A, plant.noise, running)]) - origin
    inner = np.unique(inner[(inner > a) & (inner < b)])
    before = None
    for _ in range(JOINED):
        if pieces > MOST_PIECES:
            break
        cuts = np.union1d(np.linspace(a, b, pieces + 1), inner)
        found = _joined(plant, running, cuts, origin)
        if before is not None and _near(before, found):
            return found
        before, pieces = found, 2 * pieces
    raise SolveFailed(
        f"between t = {origin + a:.6g} and {origin + b:.6g} plant or running weight vary too fast to be integrated\n"
        "  hint: a table instead of a formula, or sample times where it jumps"
    )


def _joined(plant: LinearPlant, running: Signal, cuts: np.ndarray, origin: float):
    """All pieces between `cuts`, one after the other."""
    spans = []
    halves = np.diff(cuts) / 2
    nodes = cuts[:-1, None] + halves[:, None] * (1.0 + NODES)
    ends = np.column_stack([nodes, cuts[1:]])
    starts = np.repeat(cuts[:-1, None], ends.shape[1], axis=1)
    F, Q = transitions(plant.A, plant.noise, starts.ravel(), ends.ravel(), origin)
    n = plant.states
    F, Q = F.reshape(*ends.shape, n, n), Q.reshape(*ends.shape, n, n)
    R = running.sample(origin + nodes.ravel()).reshape(*nodes.shape, n, n)
    for i, half in enumerate(halves):
        w = half * WEIGHTS
        M = np.einsum("s,sba,sbc,scd->ad", w, F[i, :-1], R[i], F[i, :-1], optimize=True)
        c = float(np.einsum("s,sab,sba->", w, R[i], Q[i, :-1]))
        spans.append((F[i, -1], Q[i, -1], (M + M.T) / 2, c))
    return reduce(_after, spans)


def _after(first, second):
    """First one span, then the other."""
    F1, Q1, M1, c1 = first
    F2, Q2, M2, c2 = second
    Q = F2 @ Q1 @ F2.T + Q2
    M = M1 + F1.T @ M2 @ F1
    return F2 @ F1, (Q + Q.T) / 2, (M + M.T) / 2, c1 + c2 + float(np.sum(M2 * Q1))


def _near(one, other) -> bool:
    M, c = np.abs(one[2] - other[2]), abs(one[3] - other[3])
    return bool(np.all(M <= SETTLED * np.max(np.abs(other[2]))) and c <= SETTLED * abs(other[3]))

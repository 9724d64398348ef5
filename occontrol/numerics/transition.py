"""Transition matrices and noise Gramians of dx/dt = A(t) x + xi over given spans.

    F = Phi(b, a),   Q = int_a^b Phi(b, t) Xi(t) Phi(b, t)' dt

Constant plants: power series over a short step, doubled up to the span (short_flow.py). Otherwise: sixth-order Magnus
steps of van Loan's system, spans cut where a table has its times or a formula jumps, the number of steps doubled until
F and Q stand still and A and Xi look smooth; where they do not (a kink of a formula), the span is halved again and
again around the place.
Source: van Loan (1978); Blanes, Casas & Ros (2000) for the Magnus coefficients.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from occontrol.core.errors import SolveFailed
from occontrol.core.scaled_signal import scaled
from occontrol.core.signal import Signal
from occontrol.numerics.balance import StateUnits, balancing
from occontrol.numerics.short_flow import short_flow

TOLERANCE = 1e-12
PROBED = 257  # times at which varying data is looked at for its units
MAX_STEPS = 16  # a span that needs more is halved
MAX_PIECES = 256  # that may still be wrong at the same time
SMOOTH = 0.13  # between 1/16, the fall of the roughness of what is smooth when steps are halved, and 1/4, of a kink
SAME_BITS = 40  # lengths that agree in so many bits are one, their F and Q are shared
BLOCK = 64 * 2**20  # bytes that steps may hold which are taken together
WORKING = 80  # (n, n) arrays of one step: five samples of A and of Xi, three exponents and their commutators, expm
INSET = 1e-7  # of a step: a table that is held takes its next value at the very end


def transitions(
    A: Signal, noise: Signal, starts: np.ndarray, ends: np.ndarray, origin: float = 0.0, cuts: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """F and Q of many spans.

    Parameters
    ----------
    A : (n, n) Signal, 1/time
    noise : (n, n) Signal, intensity Xi
    starts, ends : (K,) spans; an empty one (start = end) gives the identity and zero
    origin : what `starts` and `ends` are counted from, so that they keep their digits
    cuts : (C,) further times, counted from `origin`, across which nothing is taken for smooth

    Returns F (K, n, n) and Q (K, n, n), Q symmetric positive semidefinite.
    """
    starts, ends = np.asarray(starts, dtype=float), np.asarray(ends, dtype=float)
    units = _units(A, noise, starts, ends, origin)
    d = units.factors
    A, noise = scaled(A, 1 / d, d), scaled(noise, 1 / d, 1 / d)
    if A.constant and noise.constant:
        F, Q = _constant(A.at(0.0), noise.at(0.0), ends - starts)
    else:
        F, Q = _varying(A, noise, starts, ends, origin, np.empty(0) if cuts is None else cuts)
    return units.inverse.map(F), units.inverse.covariance(Q)


def _units(A: Signal, noise: Signal, starts: np.ndarray, ends: np.ndarray, origin: float) -> StateUnits:
    """Units in which rates and noise are alike over the longest span, wherever the spans lie."""
    longest = float(np.max(ends - starts, initial=0.0))
    if not longest > 0:
        return StateUnits(np.ones(A.shape[0]))
    probe = origin + np.linspace(np.min(starts), np.max(ends), 1 if A.constant and noise.constant else PROBED)
    rate, driven = (longest * np.max(np.abs(s.sample(probe)), axis=0) for s in (A, noise))
    return StateUnits(balancing(rate, driven, np.zeros_like(rate)))


def unique_spans(lengths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distinct lengths (each to 2^-40 of itself) and, for each span, the index of its length.

    Parameters
    ----------
    lengths : (K,) not negative

    Returns (U,) and (K,).
    """
    lengths = np.asarray(lengths, dtype=float)
    mantissa, exponent = np.frexp(lengths)
    alike = np.ldexp(np.rint(np.ldexp(mantissa, SAME_BITS)), exponent)
    _, first, index = np.unique(alike, return_index=True, return_inverse=True)
    return lengths[first], index.ravel()


def _constant(A: np.ndarray, noise: np.ndarray, lengths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    spans, index = unique_spans(lengths)
    F = np.empty((len(spans), *A.shape))
    Q = np.empty_like(F)
    for i, span in enumerate(spans):
        doublings = max(0, int(np.ceil(np.log2(max(np.linalg.norm(A, 1) * span, 1e-300)))) + 1)
        f, q = short_flow((A * (span / 2**doublings))[None], (noise * (span / 2**doublings))[None])
        f, q = f[0], q[0]
        with np.errstate(over="ignore", invalid="ignore"):
            for _ in range(doublings):
                q = f @ q @ f.T + q
                f = f @ f
        F[i], Q[i] = f, q
    if not (np.all(np.isfinite(F)) and np.all(np.isfinite(Q))):
        raise SolveFailed(
            f"the plant grows beyond all numbers within {np.max(lengths):g} time units\n"
            "  hint: A has an eigenvalue too far to the right for this interval; use shorter intervals or other units"
        )
    return F[index], _semidefinite(Q)[index]


def _semidefinite(Q: np.ndarray) -> np.ndarray:
    """Remove what rounding put below zero."""
    values, vectors = np.linalg.eigh(Q)
    if np.all(values >= 0):
        return Q
    clipped = (vectors * np.maximum(values, 0.0)[:, None, :]) @ np.swapaxes(vectors, 1, 2)
    return (clipped + np.swapaxes(clipped, 1, 2)) / 2


def _varying(
    A: Signal, noise: Signal, starts: np.ndarray, ends: np.ndarray, origin: float, cuts: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    n = A.shape[0]
    first, last = origin + float(np.min(starts, initial=0.0)), origin + float(np.max(ends, initial=0.0))
    cuts = np.union1d(np.union1d(A.breaks(first, last), noise.breaks(first, last)) - origin, cuts)
    pieces: list[tuple[float, float]] = []
    owner: list[int] = []
    for i, (a, b) in enumerate(zip(starts, ends, strict=True)):
        inner = cuts[(cuts > a + 1e-13 * abs(b - a)) & (cuts < b - 1e-13 * abs(b - a))]
        nodes = [a, *inner, b]
        pieces += list(pairwise(nodes))
        owner += [i] * (len(nodes) - 1)
    spans, whose, scale = np.array(pieces), np.array(owner), np.zeros(len(pieces))
    most = len(spans) + MAX_PIECES
    found: list[tuple[int, float, np.ndarray, np.ndarray]] = []
    while len(spans):
        f, q, wrong = _doubled(A, noise, spans, scale, origin)
        found += [(int(whose[k]), spans[k, 0], f[k], q[k]) for k in np.flatnonzero(~wrong)]
        if np.sum(wrong) > most:
            a, b = origin + spans[wrong][0]
            raise SolveFailed(
                f"the plant cannot be integrated between t = {a:g} and {b:g} to {TOLERANCE:g}\n"
                "  hint: A or noise changes too fast there; use a finer grid, or a table with a time at each jump"
            )
        # a formula with a jump or a kink: halve the pieces, only the one that holds it stays wrong
        whose, spans = np.repeat(whose[wrong], 2), spans[wrong]
        scale = np.repeat(np.fmax(scale[wrong], np.max(np.abs(q[wrong]), axis=(1, 2))), 2)
        middle = np.mean(spans, axis=1)
        spans = np.column_stack([spans[:, 0], middle, middle, spans[:, 1]]).reshape(-1, 2)
    found.sort(key=lambda piece: piece[:2])
    F = np.tile(np.eye(n), (len(starts), 1, 1))
    Q = np.zeros_like(F)
    for i, _, f_piece, q_piece in found:
        Q[i] = f_piece @ Q[i] @ f_piece.T + q_piece
        F[i] = f_piece @ F[i]
    return F, _semidefinite((Q + np.swapaxes(Q, 1, 2)) / 2)


def _doubled(
    A: Signal, noise: Signal, spans: np.ndarray, scale: np.ndarray, origin: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """F and Q of the (K, 2) spans by 1, 2, 4, .. steps, and which still move after MAX_STEPS.

    `scale` (K,) is the size of Q below which nothing counts: that of the span which a piece was cut from.
    """
    todo, steps = np.arange(len(spans)), 1
    shortest = 4 * np.finfo(float).eps * (np.max(np.abs(spans), axis=1) + abs(origin))
    with np.errstate(over="ignore", invalid="ignore"):
        f, q, rough = _magnus(A, noise, spans, steps, origin)
        while len(todo) and steps < MAX_STEPS:
            steps *= 2
            finer_f, finer_q, finer_rough = _magnus(A, noise, spans[todo], steps, origin)
            # written so that a step that overflowed counts as wrong
            wrong = ~(_apart(finer_f, f[todo]) <= TOLERANCE * np.max(np.abs(finer_f), axis=(1, 2)))
            size = np.maximum(scale[todo], np.max(np.abs(finer_q), axis=(1, 2)))
            wrong |= ~(_apart(finer_q, q[todo]) <= TOLERANCE * size)
            allowed = np.maximum(SMOOTH * rough[todo], TOLERANCE * np.column_stack([np.ones(len(todo)), size]))
            wrong |= np.any(finer_rough > allowed, axis=1)
            f[todo], q[todo], rough[todo] = finer_f, finer_q, finer_rough
            # a piece as short as the rounding of its times cannot be cut further
            tiny = (spans[todo, 1] - spans[todo, 0] <= shortest[todo]) & np.all(np.isfinite(finer_q), axis=(1, 2))
            todo = todo[wrong & ~tiny]
    left = np.zeros(len(spans), dtype=bool)
    left[todo] = True
    return f, q, left


def _apart(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.max(np.abs(a - b), axis=(1, 2))


def _magnus(
    A: Signal, noise: Signal, spans: np.ndarray, steps: int, origin: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`steps` sixth-order Magnus steps over each of the (K, 2) spans: F, Q, and how rough A and Xi are (K, 2).

    Roughness: h times the distance, at the ends of a step, between a signal and the parabola through its three nodes.
    It falls as h^4 where all is smooth, as h^2 with a kink, as h with a jump, also one between the end and a node.
    Many spans are taken block by block, because one step of one span needs the room of WORKING matrices.
    """
    n = A.shape[0]
    size = max(1, int(BLOCK / (8 * WORKING * n * n * steps)))
    parts = [_magnus_block(A, noise, spans[i : i + size], steps, origin) for i in range(0, len(spans), size)]
    if len(parts) == 1:
        return parts[0]
    F, Q, rough = (np.concatenate([part[k] for part in parts]) for k in range(3))
    return F, Q, rough


def _magnus_block(
    A: Signal, noise: Signal, spans: np.ndarray, steps: int, origin: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The same of a few spans at once."""
    K, n = len(spans), A.shape[0]
    h = (spans[:, 1] - spans[:, 0]) / steps
    nodes = np.array([INSET, 0.5 - np.sqrt(15) / 10, 0.5, 0.5 + np.sqrt(15) / 10, 1 - INSET])
    times = origin + spans[:, 0, None, None] + h[:, None, None] * (np.arange(steps)[None, :, None] + nodes)
    a = A.sample(times.ravel()).reshape(K, steps, 5, n, n)
    x = noise.sample(times.ravel()).reshape(K, steps, 5, n, n)
    rough = h[:, None] * np.column_stack([_roughness(a, nodes), _roughness(x, nodes)])
    scale = h[:, None, None, None, None]
    # van Loan's matrices [[a, x], [0, -a']] as the pairs (a, x)
    first, second, third = ((a[:, :, i] * scale[:, 0], x[:, :, i] * scale[:, 0]) for i in (1, 2, 3))
    a1, a2 = second, _sum((np.sqrt(15) / 3, third), (-np.sqrt(15) / 3, first))
    a3 = _sum((10 / 3, third), (-20 / 3, second), (10 / 3, first))
    c1 = _commutator(a1, a2)
    c2 = _commutator(a1, _sum((2.0, a3), (1.0, c1)))
    last = _commutator(_sum((-20.0, a1), (-1.0, a3), (1.0, c1)), _sum((1.0, a2), (-1 / 60, c2)))
    rate, driven = _sum((1.0, a1), (1 / 12, a3), (1 / 240, last))
    f, q = short_flow(rate.reshape(K * steps, n, n), driven.reshape(K * steps, n, n))
    f, q = f.reshape(K, steps, n, n), q.reshape(K, steps, n, n)
    F, Q = f[:, 0], q[:, 0]
    for s in range(1, steps):
        step = f[:, s]
        Q = step @ Q @ np.swapaxes(step, 1, 2) + q[:, s]
        F = step @ F
    return F, Q, rough


_Pair = tuple[np.ndarray, np.ndarray]


def _sum(*terms: tuple[float, _Pair]) -> _Pair:
    """Linear combination of pairs (a, x)."""
    return sum(c * a for c, (a, _) in terms), sum(c * x for c, (_, x) in terms)  # type: ignore[return-value]


def _commutator(first: _Pair, second: _Pair) -> _Pair:
    """Of van Loan's matrices [[a, x], [0, -a']], x symmetric: the pair of what is again such a matrix."""
    (a, x), (b, y) = first, second
    half = a @ y - b @ x
    return a @ b - b @ a, half + np.swapaxes(half, -1, -2)


def _roughness(values: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Largest distance at the outer two of five nodes from the parabola through the inner three."""
    inner = nodes[1:4]
    worst = np.zeros(len(values))
    for end in (0, 4):
        parabola = 0.0
        for i in range(3):
            others = np.delete(inner, i)
            parabola = parabola + np.prod((nodes[end] - others) / (inner[i] - others)) * values[:, :, 1 + i]
        apart = np.abs(values[:, :, end] - parabola)
        worst = np.maximum(worst, np.max(apart.reshape(len(values), -1), axis=1))
    return worst

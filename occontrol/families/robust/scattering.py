"""Riccati flows over whole spans, as scattering elements that compose.

The flow of   dP/dt = A P + P A' + P S P + W   from t to t + h, whatever P is, stands in three matrices (F, Q, R):
    P(t+h) = Q + F (P(t)^-1 + R)^-1 F'
Q is where P = 0 goes, -R is the largest P^-1 that escapes within the span. Two spans compose by the star product below.
Short spans come from the exponential of the Hamiltonian matrix [[A, W], [-S, -A']], long ones by doubling: no inverse
of P, no growing exponential, so stiff sensors and long spans lose nothing. Time-varying spans: sixth-order Magnus
steps, bisected where a step and its two halves differ. Sources: Redheffer (1962) for the star product; Blanes, Casas
& Ros (2000) for the Magnus coefficients.
Unknowns and order: an element is a tuple (F, Q, R) of (..., n, n) arrays; the leading axes are a batch.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from occontrol.core.errors import SolveFailed
from occontrol.core.signal import Signal
from occontrol.families.robust.star_product import (
    Element,
    advance,
    compose_exists,
    exponential,
    from_transfer,
    identity,
    retreat,
    star,
    star_checked,
    transpose,
)
from occontrol.numerics.balance import balancing

__all__ = ["Element", "Flow", "advance", "compose_exists", "identity", "retreat", "star"]

TOLERANCE = 2e-14
SHORT = 0.5  # |H| h of a span on which no escape from P = 0 is possible
MAX_PIECES = 200_000
INNER = np.array([0.5 - np.sqrt(15) / 10, 0.5, 0.5 + np.sqrt(15) / 10])  # where a step looks
MOST_SCALES = 20  # mixtures of sensors that get units of their own
KINK = 1e-3  # relative jump at an end of a step that counts as one


def _block(A: np.ndarray, W: np.ndarray, S: np.ndarray) -> np.ndarray:
    top = np.concatenate([A, W], axis=-1)
    return np.concatenate([top, np.concatenate([-S, -transpose(A)], axis=-1)], axis=-2)


def magnus_step(H: np.ndarray) -> np.ndarray:
    """Transfer matrices of sixth order from H (K, 3, 2n, 2n): h times the Hamiltonian matrices at the INNER points."""
    first, second, third = H[:, 0], H[:, 1], H[:, 2]
    a1, a2, a3 = second, np.sqrt(15) / 3 * (third - first), 10 / 3 * (third - 2 * second + first)
    c1 = a1 @ a2 - a2 @ a1
    inner = 2 * a3 + c1
    c2 = -(a1 @ inner - inner @ a1) / 60
    x, y = -20 * a1 - a3 + c1, a2 + c2
    return exponential(a1 + a3 / 12 + (x @ y - y @ x) / 240)


def in_user_units(element: Element, scale: np.ndarray) -> Element:
    """Elements (T, n, n) of flows in scaled states (units `scale`, (T, n)) in the user's own units."""
    F, Q, R = element
    both = scale[:, :, None] * scale[:, None, :]
    return F * (scale[:, :, None] / scale[:, None, :]), Q * both, R / both


class Flow:
    """The game Riccati flow of a plant with sensors, span by span.

    dP/dt = A P + P A' + P (K'K - sum_j v_j C_j'C_j) P + B B'

    Parameters
    ----------
    A, B, K : Signals (n, n), (n, p), (q, n)
    rows : one Signal (m_j, n) per sensor, the scaled C_j
    gain : a factor on K

    `kinks` collects the times at which a formula was found to jump.
    `elements` gives the span elements for any weights v; complex weights are welcome, which gives exact derivatives
    (the imaginary part of the element at v + i e d is e times the derivative along d).
    """

    def __init__(self, A: Signal, B: Signal, K: Signal, rows: Sequence[Signal] = (), gain: float = 1.0):
        self.A, self.B, self.K, self.rows, self.gain = A, B, K, tuple(rows), gain
        self.n, self._signals = A.shape[0], [A, B, K, *self.rows]
        self.constant = all(s.constant for s in self._signals)
        if self.constant:
            self._parts = self._sample(np.zeros(1))
        self.kinks: set[float] = set()

    @property
    def rate(self) -> float:
        """The size of the plant's scaled Hamiltonian (of a constant plant): 1/rate is its fastest time."""
        one, none = np.zeros(1), np.zeros((1, len(self.rows)))
        return float(max(self.exponents(one, none, self.scales(one, one, none))[1][0], 1e-300))

    def cuts(self, start: float, end: float) -> np.ndarray:
        """Times (K,), at least those between `start` and `end`, at which tables bend or formulas jump."""
        return np.unique(np.concatenate([s.breaks(start, end) for s in self._signals]))

    def scaled(self, factor: float) -> Flow:
        """The same with K multiplied by a factor."""
        return Flow(self.A, self.B, self.K, self.rows, self.gain * factor)

    def _sample(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """A, BB', K'K (T, n, n) and C'C (T, M, n, n)."""
        A, B, K = (s.sample(times) for s in (self.A, self.B, self.K))
        C = [s.sample(times) for s in self.rows]
        L = np.stack([transpose(c) @ c for c in C], axis=1) if C else np.zeros((len(times), 0, self.n, self.n))
        return A, B @ transpose(B), self.gain**2 * (transpose(K) @ K), L

    def scales(self, starts: np.ndarray, ends: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Units of the states (T, n) in which the spans' Hamiltonian matrices are small: powers of two.

        P is D P D in them. A strong sensor makes the flow fast only by the root of its strength, or less, in the right
        units; in the user's units a step would have to be a million times shorter. `starts` (T,), `ends` (T,),
        `weights` (T, M).
        """
        used, which = np.unique(np.abs(np.real(weights)), axis=0, return_inverse=True)
        if len(used) > MOST_SCALES:
            used, which = np.max(used, axis=0, keepdims=True), np.zeros(len(weights), dtype=int)
        some = slice(None, None, max(1, len(starts) // 100))
        times = (starts[some, None] + (ends - starts)[some, None] * np.array([0.02, 0.34, 0.66, 0.98])).ravel()
        A, W, KK, L = self._parts if self.constant else self._sample(times)
        A, W, KK = (np.max(np.abs(part), axis=0) for part in (A, W, KK))
        L = np.max(np.abs(L), axis=0)
        found = []
        for v in used:
            found.append(balancing(A, W, KK + np.einsum("m,mij->ij", v, L), power=2))
        return np.array(found)[which.ravel()]

    def exponents(self, times: np.ndarray, weights: np.ndarray, scale: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Hamiltonian matrices (T, 2n, 2n) and sizes (T,) at `times` (T,) for `weights` (T, M), in `scale` (T, n)."""
        A, W, KK, L = self._parts if self.constant else self._sample(times)
        S = KK - np.einsum("tm,tmij->tij", weights, np.broadcast_to(L, (len(times), *L.shape[1:])))
        both = scale[:, :, None] * scale[:, None, :]
        A, W, S, KK = A * (scale[:, None, :] / scale[:, :, None]), W / both, S * both, KK * both
        size = np.sum(np.abs(A) + np.abs(W) + np.abs(S) + np.abs(KK), axis=(1, 2))
        return _block(A, W, S), size

    def elements(self, starts: np.ndarray, ends: np.ndarray, weights: np.ndarray | None = None) -> Element:
        """Elements of many spans: starts, ends (T,); weights (T, M), zero if left out (no sensor)."""
        starts, ends = np.atleast_1d(np.asarray(starts, dtype=float)), np.atleast_1d(np.asarray(ends, dtype=float))
        if weights is None:
            weights = np.zeros((len(starts), len(self.rows)))
        return self._spans(starts, ends, weights, None)

    def free_elements(self, starts: np.ndarray, ends: np.ndarray) -> tuple[Element, np.ndarray]:
        """Elements of many spans without a sensor, and (T,) whether P = 0 at the start survives each of them.

        `starts` (T,), `ends` (T,). Where it does not, X does not exist on the span, and the element has no meaning.
        """
        starts, ends = np.atleast_1d(np.asarray(starts, dtype=float)), np.atleast_1d(np.asarray(ends, dtype=float))
        exists = np.ones(len(starts), dtype=bool)
        return self._spans(starts, ends, np.zeros((len(starts), len(self.rows))), exists), exists

    def _spans(self, starts: np.ndarray, ends: np.ndarray, weights: np.ndarray, exists: np.ndarray | None) -> Element:
        scale = self.scales(starts, ends, weights)
        element = (self._constant if self.constant else self._varying)(starts, ends, weights, scale, exists)
        return in_user_units(element, scale)

    def element(self, start: float, end: float, sensor: int | None = None) -> Element:
        """The element of one span with one sensor, or with none."""
        weights = np.zeros((1, len(self.rows)))
        if sensor is not None:
            weights[0, sensor] = 1.0
        F, Q, R = self.elements(np.array([start]), np.array([end]), weights)
        return F[0], Q[0], R[0]

    def _constant(
        self, starts: np.ndarray, ends: np.ndarray, weights: np.ndarray, scale: np.ndarray, exists: np.ndarray | None
    ) -> Element:
        H, size = self.exponents(starts, weights, scale)
        h = ends - starts
        doublings = max(0, int(np.ceil(np.log2(max(float(np.max(size * h)) / SHORT, 1e-300)))))
        element = from_transfer(exponential(H * (h / 2.0**doublings)[:, None, None]))
        for _ in range(doublings):
            element = star_checked(element, element, exists)
        return element

    def _varying(
        self, starts: np.ndarray, ends: np.ndarray, weights: np.ndarray, scale: np.ndarray, exists: np.ndarray | None
    ) -> Element:
        M, _, _, owner = self.partition(starts, ends, weights, scale)
        return self.reduce(from_transfer(M), owner, len(starts), exists)

    def partition(
        self, starts: np.ndarray, ends: np.ndarray, weights: np.ndarray, scale: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Transfer matrix (K, 2n, 2n), start, length and span of every step that is short enough, in order.

        `starts` and `ends` (T,) are the spans, with `weights` (T, M) and `scale` (T, n).
        Raises SolveFailed where the flow is not finite or needs too many steps.
        """
        a, b, owner = self._initial_pieces(starts, ends, weights, scale)
        done: list[tuple[np.ndarray, ...]] = []
        total = 0
        floor = 1e-11 * np.maximum(np.max(np.abs(ends - starts), initial=0.0), 1e-300)
        while len(a):
            middle = (a + b) / 2
            of: np.ndarray = np.asarray(owner, dtype=int)
            how = weights[of], scale[of]
            whole = self._magnus(a, b, *how)
            left, right = self._magnus(a, middle, *how), self._magnus(middle, b, *how)
            halves = right @ left
            error = np.max(np.abs(halves - whole), axis=(1, 2)) / np.max(np.abs(halves), axis=(1, 2))
            smooth = (error <= TOLERANCE * 64) & self._smooth(a, b, *how)
            good = smooth | (b - a <= floor)
            self.kinks.update(float(t) for t in middle[good & ~smooth])
            if not np.all(np.isfinite(error)):
                k = int(np.argmin(np.isfinite(error)))
                raise SolveFailed(f"the plant is not finite between t = {a[k]:.8g} and {b[k]:.8g}")
            for m, x in ((left, a), (right, middle)):
                done.append((m[good], x[good], (b - a)[good] / 2, owner[good]))
            total += 2 * int(np.sum(good))
            a, b, owner = (
                np.concatenate(p) for p in ((a[~good], middle[~good]), (middle[~good], b[~good]), (owner[~good],) * 2)
            )
            if total + len(a) > MAX_PIECES:
                raise SolveFailed(
                    f"the plant cannot be integrated near t = {a[0]:g} in {MAX_PIECES} steps\n"
                    "  hint: A, B, K or C changes too fast there; use a table with a time at each jump"
                )
        M, x, length, who = (np.concatenate(p) for p in zip(*done, strict=True))
        order = np.lexsort((x, who))
        return M[order], x[order], length[order], who[order]

    def _initial_pieces(
        self, starts: np.ndarray, ends: np.ndarray, weights: np.ndarray, scale: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Spans cut at the tables' times and so short that no piece can hold an escape from P = 0."""
        a, b, owner = [], [], []
        cuts = self.cuts(float(np.min(starts)), float(np.max(ends)))
        for i, (s, e) in enumerate(zip(starts, ends, strict=True)):
            slack = 1e-13 * abs(e - s)
            nodes = [s, *cuts[(cuts > s + slack) & (cuts < e - slack)], e]
            a, b = [*a, *nodes[:-1]], [*b, *nodes[1:]]
            owner += [i] * (len(nodes) - 1)
        a, b, owner = np.array(a), np.array(b), np.array(owner, dtype=int)
        while True:
            share = np.linspace(0.02, 0.98, 7)
            times = (a[:, None] + (b - a)[:, None] * share).ravel()
            of = np.repeat(owner, len(share))
            size = self.exponents(times, np.abs(weights[of]), scale[of])[1].reshape(len(a), -1)
            if not np.all(np.isfinite(size)):
                k = int(np.argmin(np.all(np.isfinite(size), axis=1)))
                raise SolveFailed(f"the plant is not finite between t = {a[k]:.8g} and {b[k]:.8g}")
            long = np.max(size, axis=1) * (b - a) > 2 * SHORT
            if not np.any(long):
                return a, b, owner
            # the sum is what it takes at most, by far where the plant is fast for a moment only
            if len(a) > MAX_PIECES or np.sum(np.max(size, axis=1) * (b - a)) > 20 * MAX_PIECES:
                fastest = float(np.max(np.max(size, axis=1)))
                raise SolveFailed(
                    f"near t = {a[np.argmax(long)]:g} the set of possible states moves within {1 / fastest:.1e} time "
                    f"units: the horizon would take more than {MAX_PIECES} steps\n"
                    "  hint: a sensor is very strong there; divide the rows of C by larger errors, or use constants"
                )
            middle = (a + b) / 2
            a, b, owner = (
                np.concatenate([a, middle[long]]),
                np.concatenate([np.where(long, middle, b), b[long]]),
                np.concatenate([owner, owner[long]]),
            )

    def _smooth(self, a: np.ndarray, b: np.ndarray, weights: np.ndarray, scale: np.ndarray) -> np.ndarray:
        """Whether both ends of [a, b] lie on a parabola through the inner points: a jump beside an end is then seen."""
        root = np.sqrt(0.15)
        x = np.array([-0.5 + 1e-9, -root, 0.0, root, 0.5 - 1e-9])
        times = ((a + b)[:, None] / 2 + (b - a)[:, None] * x).ravel()
        H = self.exponents(times, np.repeat(weights, 5, axis=0), np.repeat(scale, 5, axis=0))[0]
        H = H.reshape(len(a), 5, -1)
        rise, bend = (H[:, 3] - H[:, 1]) / (2 * root), (H[:, 3] - 2 * H[:, 2] + H[:, 1]) / (2 * root**2)
        allowed = KINK * (1e-300 + np.max(np.abs(H), axis=(1, 2)))
        fits = [np.max(np.abs(H[:, 2] + rise * x[i] + bend * x[i] ** 2 - H[:, i]), axis=1) <= allowed for i in (0, 4)]
        return fits[0] & fits[1]

    def _magnus(self, a: np.ndarray, b: np.ndarray, weights: np.ndarray, scale: np.ndarray) -> np.ndarray:
        """One sixth-order step of the Hamiltonian system over each [a, b]."""
        h = b - a
        times = (a[:, None] + h[:, None] * INNER).ravel()
        H = self.exponents(times, np.repeat(weights, 3, axis=0), np.repeat(scale, 3, axis=0))[0]
        H = H.reshape(len(a), 3, 2 * self.n, 2 * self.n) * h[:, None, None, None]
        return magnus_step(H)

    def reduce(self, pieces: Element, owner: np.ndarray, count: int, exists: np.ndarray | None) -> Element:
        """The star product, in pairs, of the pieces of each `owner` (K,); `exists` (T,) turns False where one fails."""
        sizes = np.bincount(owner, minlength=count)
        width = 1 << max(0, int(np.max(sizes) - 1).bit_length())
        place = np.arange(len(owner)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
        padded = []
        for part, empty in zip(pieces, identity(self.n, (count, width)), strict=True):
            empty = empty.astype(part.dtype)
            empty[owner, place] = part
            padded.append(empty)
        while padded[0].shape[1] > 1:
            first, second = tuple(p[:, 0::2] for p in padded), tuple(p[:, 1::2] for p in padded)
            padded = list(star_checked(first, second, exists))  # type: ignore[arg-type]
        return padded[0][:, 0], padded[1][:, 0], padded[2][:, 0]

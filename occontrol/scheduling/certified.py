"""Cost, gradient and lower bound of a finished policy in square-root form, and how far rounding may have moved them.

The sweeps of the solvers carry the covariance itself and lose digits where a plant grows far between measurements or
the prior is huge. One pass over the final policy with roots (square_root_kernels.py) loses none of its own; what is
left is what the last digit of the data does. That is measured: the pass is repeated with every number moved by at most
one unit in its last place (those of F and Q by more where a span is long, as an exponential loses digits by its
argument) and the root of the start turned at random, and

    allowance = 10 x the largest change + 10 ulp |J|,   with 1e-9 |J| in place of the second where
                lambda_max(Sigma0 L) T > 1e12.

That term is there because with such a prior errors were seen that are 120 times the change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from occontrol.numerics.linalg import square_root
from occontrol.scheduling.blocks.components import separated
from occontrol.scheduling.feasible_set import Bounding
from occontrol.scheduling.recursion import Recursion
from occontrol.scheduling.roots import ULP, Roots
from occontrol.scheduling.square_root_kernels import backward, forward

REPEATS = 3
FACTOR = 10.0
DIFFUSE, DIFFUSE_SHARE = 1e12, 1e-9
BYTES = 500_000_000


@dataclass(frozen=True, eq=False)
class Pass:
    """Numbers of one pass.

    Parameters
    ----------
    cost : J without what the running weight has below zero
    gradient : (N, M) of that; for a sensor that is not available its cost alone
    below : what the running weight has below zero, charged along the policy; J = cost - below
    """

    cost: float
    gradient: np.ndarray
    below: float


def square_root_pass(roots: Roots, weights: np.ndarray) -> Pass:
    """Cost and gradient of a policy.

        dJ/dv_kj = cost_kj - h |c_j X+ g+|^2,   S+ = X+ X+',  P+ = V' V,  g+ = X+' V'

    Parameters
    ----------
    roots : Roots
    weights : (N, M)
    """
    r, N = roots.recursion, len(roots.recursion.steps)
    weights = np.ascontiguousarray(r.on_steps(weights), dtype=float)
    march = _March(roots, weights)
    X, starts, total = np.ascontiguousarray(roots.initial).copy(), [], float(np.vdot(r.cost, weights))
    for k0 in range(0, N, march.length):
        starts.append(X.copy())
        total += march.ahead(k0, X, roots.running)
    last = march.past_the_end(X)
    total += float(np.sum((roots.terminal @ X) ** 2))
    g, gain = np.ascontiguousarray(last @ (X.T @ roots.terminal.T)), np.zeros((N, r.sensors))
    for s in reversed(range(len(starts))):
        if len(starts) > 1:
            march.ahead(s * march.length, starts[s], roots.running)
        march.back(s * march.length, g, gain)
    below = _below_zero(roots, weights) if len(roots.negative) else 0.0
    gradient = r.cost - np.where(r.on_steps(r.available) > 0, gain, 0.0)
    return Pass(total, r.by_decision(gradient), below)


def _below_zero(roots: Roots, weights: np.ndarray) -> float:
    """What the running weight has below zero, charged along weights (K, M) of the steps."""
    march, X, total = _March(roots, weights), roots.initial.copy(), 0.0
    for k0 in range(0, len(roots.recursion.steps), march.length):
        total += march.ahead(k0, X, roots.negative)
    return total


class _March:
    """Stretches of as many intervals as fit into BYTES, forward and back."""

    def __init__(self, roots: Roots, weights: np.ndarray):
        r, n, most = roots.recursion, roots.recursion.states, roots.rows.shape[1]
        self.roots, self.end = roots, len(r.steps)
        self.of_rows = (roots.rows, r.row_set, r.offsets, r.steps, weights)
        length = self.length = int(np.clip(BYTES / (8 * n * (3 * n + most + 3)), 1, len(r.steps)))
        charged = len(roots.running) + len(roots.negative) > 0
        after, before, Z = (np.empty((k, n, n)) for k in (length, length if charged else 0, length))
        self.kept = (after, before, Z, np.empty((length, most, n + 3)))
        self.tall = tuple(np.empty((n, 2 * n)) for _ in range(3))
        self.lists = (np.empty(n), np.empty(2 * n, dtype=np.int64), np.empty(n, dtype=np.int64))

    def ahead(self, k0: int, X: np.ndarray, V: np.ndarray) -> float:
        """Forward from k0 in place on X; the running charge of V' V."""
        r, k1 = self.roots.recursion, min(k0 + self.length, self.end)
        front = (k0, k1, X, self.roots.transition, self.roots.noise, r.predict)
        space = (*self.tall, *self.lists)
        return float(forward(*front, *self.of_rows, V, r.running_set, r.charges, *self.kept, *space))

    def past_the_end(self, X: np.ndarray) -> np.ndarray:
        """The predict after the last interval, in place on X; Z_1 (n, n) of it."""
        r, (rows, sets, offsets, steps, weights) = self.roots.recursion, self.of_rows
        front = (self.end, self.end + 1, X, self.roots.transition, self.roots.noise, r.predict)
        none = (offsets[:1], steps, weights, self.roots.running[:0], r.running_set, r.charges)  # no rows, no charges
        after, last = np.empty((2, 1, *X.shape))
        forward(*front, rows, sets, *none, after, self.kept[1], last, self.kept[3], *self.tall, *self.lists)
        return last[0]

    def back(self, k0: int, g: np.ndarray, gain: np.ndarray) -> None:
        """Back to k0 in place on g, after `ahead`."""
        k1, V, r = min(k0 + self.length, self.end), self.roots.running, self.roots.recursion
        space = (*self.tall[:2], np.empty(len(g)), *self.lists, np.empty_like(g))
        backward(k0, k1, g, *self.of_rows, V, r.running_set, r.charges, *self.kept, gain, *space)


@dataclass(frozen=True, eq=False)
class Apart:
    """The roots of parts of a recursion that nothing couples, or of the whole as its only part.

    Parameters
    ----------
    recursion : the whole
    parts : Roots, prices of sensors in the first alone
    """

    recursion: Recursion
    parts: Sequence[Roots]

    @classmethod
    def of(cls, recursion: Recursion) -> Apart:
        """The roots of a recursion, part by part where it falls apart."""
        return cls(recursion, [Roots.of(part) for part in separated(recursion)])

    def moved(self, rng: np.random.Generator) -> Apart:
        """The same of matrices moved in their last places."""
        return Apart(self.recursion, [part.moved(rng) for part in self.parts])

    def take(self, weights: np.ndarray) -> Pass:
        """Cost and gradient of a policy, `weights` (N, M)."""
        passes = [square_root_pass(part, weights) for part in self.parts]
        gradient = np.sum([p.gradient for p in passes], axis=0)
        return Pass(sum(p.cost for p in passes), gradient, sum(p.below for p in passes))

    @property
    def convex(self) -> bool:
        """Whether no running weight lies below zero."""
        return not any(len(part.negative) for part in self.parts)

    def below_without(self) -> float:
        """What running weights have below zero, without any measurement."""
        idle = np.zeros((len(self.recursion.steps), self.recursion.sensors))
        return sum(_below_zero(part, idle) for part in self.parts if len(part.negative))


@dataclass(frozen=True, eq=False)
class Certified:
    """What the square-root form says of a policy.

    Parameters
    ----------
    cost : J
    lower_bound : J - sum_k [v_k.g_k - min_w w.g_k], not yet lowered by the allowance
    cost_allowance, bound_allowance : how far rounding may have moved them, in cost units
    below : how much of J is owed to a running weight slightly below zero
    convex : whether nothing is; only then gradients of any form bound J from below
    """

    cost: float
    lower_bound: float
    cost_allowance: float
    bound_allowance: float
    below: float
    convex: bool


@dataclass(frozen=True)
class Term:
    """One recursion and its factor: J = sum of factor * J of the recursion, as extrapolation makes of two meshes.

    Parameters
    ----------
    factor : number
    recursion : Recursion, all of one problem with the same decisions
    """

    factor: float
    recursion: Recursion


def certified(
    terms: Sequence[Term], feasible_set: Bounding, weights: np.ndarray, repeats: int = REPEATS, seed: int = 0
) -> Certified:
    """Cost and lower bound of a policy in square-root form, with the measured allowance.

    What a running weight has below zero is not convex in the policy. It takes away at most what it takes from the
    covariance without any measurement, the largest there is, and the bound is lowered by that.

    Parameters
    ----------
    terms : what the cost is the sum of; the last one, the cheapest, is the one that is perturbed
    feasible_set : the set that the bound holds for
    weights : (N, M)
    repeats : passes with perturbed data
    seed : of the perturbations
    """
    rng = np.random.default_rng(seed)
    roots = [Apart.of(term.recursion) for term in terms]
    passes = [each.take(weights) for each in roots]
    factors = [term.factor for term in terms]
    cost, own, below = _combined(roots, passes, factors, feasible_set, weights)
    change, last = np.zeros(2), roots[-1]
    _, alone, _ = _combined([last], passes[-1:], [1.0], feasible_set, weights)
    start = np.array([passes[-1].cost - passes[-1].below, alone])
    for _ in range(repeats):
        moved = last.moved(rng)
        other = _combined([moved], [moved.take(weights)], [1.0], feasible_set, weights)
        change = np.fmax(change, np.abs(np.array(other[:2]) - start))
    change = change * sum(abs(f) for f in factors)
    # three repeats may happen to change nothing: never less than what n x n factors round over so many steps, whose
    # errors are of either sign
    least = FACTOR * ULP * last.recursion.states * np.sqrt(len(last.recursion.steps))
    extra = (DIFFUSE_SHARE if diffuseness(last.recursion) > DIFFUSE else least) * abs(cost)
    of_cost, of_bound = (FACTOR * float(c) + extra if np.isfinite(c) else np.inf for c in change)
    return Certified(cost, own, of_cost, max(of_cost, of_bound), below, all(r.convex for r in roots))


def _combined(
    roots: Sequence[Apart], passes: Sequence[Pass], factors: Sequence[float], allowed: Bounding, weights: np.ndarray
) -> tuple[float, float, float]:
    """Cost, own bound, and what of the cost lies below zero."""
    cost = sum(f * p.cost for f, p in zip(factors, passes, strict=True))
    gradient = sum(f * p.gradient for f, p in zip(factors, passes, strict=True))
    below = sum(f * p.below for f, p in zip(factors, passes, strict=True))
    bound = allowed.bound(cost, weights, np.asarray(gradient))
    for each, f in zip(roots, factors, strict=True):
        bound -= f * each.below_without()
    return cost - below, bound, below


def diffuseness(recursion: Recursion) -> float:
    """lambda_max(Sigma0 L_j) T of the sensor for which it is largest: how much the first measurement tells."""
    r, horizon = recursion, float(np.sum(recursion.steps))
    root = square_root(r.initial)
    return horizon * max(
        (
            float(np.linalg.norm(rows[a:b] @ root, 2)) ** 2
            for rows in r.rows[:: max(1, len(r.rows) // 16)]
            for a, b in zip(r.offsets[:-1], r.offsets[1:], strict=True)
            if b > a
        ),
        default=0.0,
    )

"""Readings of a plant without noise and without a prior: all that is known is F = sum v L, and J = cost.v + phi(F^-1).

The state at the start is a vector of constant parameters: a reading of row h at step k is one of h Phi_k there, with
Phi_k the product of the transitions so far. Directions that no reading sees are left out where no output needs them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occontrol.core.solution import ALLOWANCE, Certificate
from occontrol.scheduling.criterion import Criterion
from occontrol.scheduling.design import Design
from occontrol.scheduling.feasible_set import FeasibleSet
from occontrol.scheduling.proof import Proof
from occontrol.scheduling.recursion import Recursion

UNSEEN = 1e-13  # of the largest eigenvalue of the correlations: a direction without information
NEEDED = 1e-9  # of an output's row: a part that counts
LONG = np.longdouble
LEAST = float(np.finfo(LONG).eps)


@dataclass(frozen=True, eq=False)
class Seen:
    """What readings tell of the state at the start.

    Parameters
    ----------
    rows : (N, M, r, n) rows of every decision and sensor, zeros where a sensor has fewer
    output : (p, n) the outputs at the end as functions of the state at the start
    across : (n, d) from the start to the end; d = n where nothing of the start is known
    """

    rows: np.ndarray
    output: np.ndarray
    across: np.ndarray

    @property
    def information(self) -> np.ndarray:
        """(N, M, n, n) L"""
        return np.einsum("kjri,kjrm->kjim", self.rows, self.rows, optimize=True)

    def of(self, unknown: np.ndarray) -> Seen:
        """The same where the start is known but for the states that are `unknown` (n,)."""
        return Seen(self.rows[..., unknown], self.output[:, unknown], self.across[:, unknown])


def seen_from_start(recursion: Recursion, output: np.ndarray) -> Seen:
    """The readings and the outputs of a recursion without noise, in terms of the state at its start.

    Parameters
    ----------
    recursion : Recursion of readings
    output : (p, n) D on the last covariance
    """
    r = recursion
    K, n, first = len(r.steps), r.states, r.first_steps
    widest = int(np.max(np.diff(r.offsets), initial=0))
    longest = int(np.max(np.diff(np.append(first, K))))
    rows = np.zeros((r.intervals, r.sensors, widest * longest, n))
    owner = np.arange(K) if r.owner is None else r.owner
    across = np.eye(n)
    for k in range(K):
        across = r.transition[r.predict[k]] @ across
        place = (k - first[owner[k]]) * widest
        for j in range(r.sensors):
            a, b = r.offsets[j], r.offsets[j + 1]
            rows[owner[k], j, place : place + b - a] = np.sqrt(r.steps[k]) * r.rows[r.row_set[k]][a:b] @ across
    across = r.transition[r.predict[K]] @ across
    return Seen(rows, output @ across, across)


class Unseen(ValueError):
    """An output needs a direction of the state that no reading sees; `direction` (n,) is one of them."""

    def __init__(self, direction: np.ndarray):
        super().__init__("no reading sees a direction that an output needs")
        self.direction = direction


def reduced(seen: Seen, available: np.ndarray) -> tuple[np.ndarray, Seen]:
    """The directions (n, d) that readings see, and rows and outputs in terms of them alone.

    Parameters
    ----------
    seen : Seen
    available : (N, M) positive where a sensor may be used

    Raises Unseen where an output needs another direction.
    """
    n = seen.rows.shape[-1]
    rows = seen.rows[available > 0].reshape(-1, n)
    scale = np.sqrt(np.sum(rows**2, axis=0))
    safe = np.where(scale > 0, scale, 1.0)
    _, sizes, basis = np.linalg.svd(np.vstack([rows / safe, np.zeros((n, n))]), full_matrices=False)
    lost = ~(sizes**2 > UNSEEN * max(float(sizes[0]) ** 2, 1e-300))
    if not np.any(lost):
        return np.eye(n), seen
    for direction in (basis[lost] / safe)[::-1]:
        needed = np.abs(seen.output @ direction)
        size = np.linalg.norm(seen.output, axis=1) * np.linalg.norm(direction)
        if np.any(needed > NEEDED * np.where(size > 0, size, 1.0)):
            raise Unseen(direction)
    kept = (basis[~lost] / safe).T  # x = kept y for what is seen
    return kept, Seen(seen.rows @ kept, seen.output @ kept, seen.across @ kept)


class InformationObjective:
    """J on policies (N, M) of readings without a prior; infinite where a direction is not seen.

    Parameters
    ----------
    seen : Seen
    criterion : Criterion of F^-1, with its outputs in terms of the state at the start
    cost : (N, M) prices
    recursion : for whoever asks for the decisions
    """

    def __init__(self, seen: Seen, criterion: Criterion, cost: np.ndarray, recursion: Recursion):
        self.design = Design(seen.information, criterion, None, cost)  # type: ignore[arg-type]
        self.seen, self.criterion, self.prices, self.recursion = seen, criterion, cost, recursion
        self.shape, self.states = self.design.shape, self.design.states
        self.forward_count = self.backward_count = 0
        self._value = self._error = 0.0

    @property
    def signed(self) -> bool:
        """Whether the criterion may be negative."""
        return self.criterion.signed

    @property
    def corners(self) -> bool:
        """Whether it has to be smoothed to be minimised."""
        return hasattr(self.criterion, "smoothed")

    @property
    def curved(self) -> bool:
        """Whether there are second derivatives."""
        return hasattr(self.criterion, "curvature")

    @property
    def spread(self) -> float:
        """How far smoothing raises the criterion at most, for each unit of mu."""
        return self.criterion.spread if self.corners else 0.0  # type: ignore[attr-defined]

    @property
    def criterion_value(self) -> float:
        """Of the last cost."""
        return self._value

    @property
    def smoothing_error(self) -> float:
        """What the last cost has to lose before its tangent bounds the true criterion."""
        return self._error

    def with_smoothing(self, smoothing: float) -> InformationObjective:
        """The same with another mu, `smoothing`; itself where there is nothing to smooth."""
        if not self.corners:
            return self
        criterion = self.criterion.smoothed(smoothing)  # type: ignore[attr-defined]
        return InformationObjective(self.seen, criterion, self.prices, self.recursion)

    def cost(self, weights: np.ndarray) -> float:
        """J of a policy, `weights` (N, M); inf where a direction is not seen."""
        self.forward_count += 1
        S = self.design.covariance(weights)
        if S is None:
            self._value, self._error = np.inf, 0.0
            return np.inf
        self._value, self._error = self.criterion.value(S), self.criterion.smoothing_error(S)
        return float(np.vdot(self.prices, weights)) + self._value

    def cost_and_gradient(self, weights: np.ndarray) -> tuple[float, np.ndarray]:
        """J and dJ/dv (N, M) of a policy, `weights` (N, M); inf and zeros where a direction is not seen."""
        if not np.isfinite(self.cost(weights)):
            return np.inf, np.zeros(self.shape)
        self.backward_count += 1
        J, g, _ = self.design.derivatives(weights, curved=False)
        return J, g


def prove_information(
    objective: InformationObjective,
    feasible_set: FeasibleSet,
    policy: np.ndarray,
    others: list[tuple[InformationObjective, np.ndarray]],
    known_bound: float = -np.inf,
) -> Proof:
    """Cost of a policy and the best lower bound known, computed in extended precision.

    Parameters
    ----------
    objective : the true one
    feasible_set : the set that the bound holds for
    policy : (N, M)
    others : objectives, perhaps smoothed, and policies (N, M) whose tangents prove bounds
    known_bound : proven in another way, if any
    """
    cost, _, condition = _extended(objective, policy)
    size = max(abs(cost), 1.0 if objective.signed else 0.0)
    ulp = float(np.finfo(float).eps)

    def lost(condition: float) -> float:
        return (10 * LEAST * condition * objective.states + 10 * ulp) * size

    bounds, allowance = [], lost(condition)
    for other, at in [(objective, policy), *others]:
        J, g, spoilt = _extended(other, at)
        if not np.isfinite(J):
            continue
        other.cost(at)
        J -= other.smoothing_error
        S = other.design.covariance(at)
        rounding = 0.0 if S is None else other.criterion.rounding(S)
        own = feasible_set.bound(J, at, g)
        room = lost(spoilt) + rounding * (1.0 + abs(J - own))
        bounds.append((own - room, room))
    if np.isfinite(known_bound):
        bounds.append((known_bound - allowance, allowance))
    if not objective.signed:
        bounds.append((0.0, 0.0))
    bound, room = max(bounds) if bounds else (-np.inf, np.inf)
    room = max(room, allowance)
    share = max(ALLOWANCE, room / (1.0 if objective.signed else max(abs(cost), 1e-300)))
    return Proof(Certificate(cost, bound, share, objective.signed), room, 0.0, 0.0)


def _extended(objective: InformationObjective, weights: np.ndarray) -> tuple[float, np.ndarray, float]:
    """J, dJ/dv (N, M) and the condition of the correlations of F, with F and its inverse in extended precision."""
    n = objective.states
    used = np.argwhere(weights > 0)
    F = np.zeros((n, n), dtype=LONG)
    for k, j in used:
        rows = objective.seen.rows[k, j].astype(LONG)
        F += LONG(weights[k, j]) * (rows.T @ rows)
    scale = np.sqrt(np.diagonal(F))
    if not np.all(scale > 0):
        return np.inf, np.zeros(objective.shape), np.inf
    root = _inverse_factor(F / np.outer(scale, scale))
    if root is None:
        return np.inf, np.zeros(objective.shape), np.inf
    root = root / scale
    S = root.T @ root
    double = S.astype(float)
    W = objective.criterion.gradient(double).astype(LONG)
    G = S @ W @ S
    J = float(np.vdot(objective.prices, weights)) + objective.criterion.value(double)
    gradient = np.zeros(objective.shape)
    for k in range(objective.shape[0]):
        rows = objective.seen.rows[k].astype(LONG)
        gradient[k] = objective.prices[k] - np.sum((rows @ G) * rows, axis=(1, 2)).astype(float)
    condition = float(np.linalg.cond((F / np.outer(scale, scale)).astype(float)))
    return J, gradient, condition


def _inverse_factor(matrix: np.ndarray) -> np.ndarray | None:
    """The inverse of the lower Cholesky factor of a matrix (n, n), in its own precision; None if there is none."""
    n = len(matrix)
    L = np.zeros_like(matrix)
    for i in range(n):
        pivot = matrix[i, i] - L[i, :i] @ L[i, :i]
        if not pivot > 4 * n * LEAST:
            return None
        L[i, i] = np.sqrt(pivot)
        L[i + 1 :, i] = (matrix[i + 1 :, i] - L[i + 1 :, :i] @ L[i, :i]) / L[i, i]
    inverse = np.zeros_like(matrix)
    for i in range(n):
        inverse[i, i] = 1 / L[i, i]
        inverse[i, :i] = -(L[i, :i] @ inverse[:i, :i]) / L[i, i]
    return inverse

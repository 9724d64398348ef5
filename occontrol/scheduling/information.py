"""Readings of a plant without noise and without a prior: all that is known is F = sum v L, and J = cost.v + phi(F^-1).

With a prior F_0 that tells next to nothing J is finite for every policy, and lies below the J without it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from occontrol.core.solution import ALLOWANCE, Certificate
from occontrol.scheduling.certified import Certified
from occontrol.scheduling.criteria import LogDeterminant
from occontrol.scheduling.criterion import Criterion
from occontrol.scheduling.design import Design
from occontrol.scheduling.feasible_set import Bounding, FeasibleSet
from occontrol.scheduling.proof import Judged, Proof
from occontrol.scheduling.recursion import Recursion
from occontrol.scheduling.seen import Seen

LONG = np.longdouble
LEAST = float(np.finfo(LONG).eps)
ULP = float(np.finfo(float).eps)


class InformationObjective:
    """J on policies (N, M) of readings without a prior; infinite where a direction is not seen.

    Parameters
    ----------
    seen : Seen
    criterion : Criterion of F^-1, with its outputs in terms of the state at the start
    cost : (N, M) prices
    recursion : for whoever asks for the decisions
    prior : (n, n) F_0; zero if None
    """

    def __init__(
        self, seen: Seen, criterion: Criterion, cost: np.ndarray, recursion: Recursion, prior: np.ndarray | None = None
    ):
        self.design = Design(seen.information, criterion, prior, cost)  # type: ignore[arg-type]
        self.seen, self.criterion, self.prices, self.recursion, self.prior = seen, criterion, cost, recursion, prior
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
        return InformationObjective(self.seen, criterion, self.prices, self.recursion, self.prior)

    def with_prior(self, prior: np.ndarray) -> InformationObjective:
        """The same beside F_0 = `prior` (n, n)."""
        return InformationObjective(self.seen, self.criterion, self.prices, self.recursion, prior)

    def on(self, columns: Recursion) -> InformationObjective:
        """The same with the prices of other `columns`, of which those beyond the sensors tell nothing."""
        more = columns.sensors - self.shape[1]
        seen = replace(self.seen, rows=np.pad(self.seen.rows, ((0, 0), (0, more), (0, 0), (0, 0))))
        return InformationObjective(seen, self.criterion, columns.decision_cost, columns, self.prior)

    def tangent(self, weights: np.ndarray) -> InformationJudged:
        """The policy `weights` (N, M) with cost and gradient, for a proof."""
        J, g = self.cost_and_gradient(weights)
        return InformationJudged(weights, J - self.smoothing_error, g, [], objective=self)

    def cost(self, weights: np.ndarray) -> float:
        """J of a policy, `weights` (N, M); inf where a direction is not seen."""
        self.forward_count += 1
        S = self.design.covariance(weights)
        if S is None:
            self._value, self._error = np.inf, 0.0
            return np.inf
        self._value, self._error = self.criterion.value(S), self.criterion.smoothing_error(S)
        return float(np.vdot(self.prices, weights)) + self._value

    def rough_cost(self, weights: np.ndarray) -> float:
        """J of a policy, `weights` (N, M), also where the errors of the outputs are dependent but for rounding.

        ln det D F^-1 D' = 2 sum ln |diag R| with Q R = X D', X'X = F^-1, has twice the digits.
        """
        try:
            return self.cost(weights)
        except ValueError:
            root = self.design.root(weights)
            if root is None or not isinstance(self.criterion, LogDeterminant):
                raise
            R = np.linalg.qr(root @ self.criterion.output.T, mode="r")
            return float(np.vdot(self.prices, weights)) + 2 * float(np.sum(np.log(np.abs(np.diagonal(R)))))

    def cost_and_gradient(self, weights: np.ndarray) -> tuple[float, np.ndarray]:
        """J and dJ/dv (N, M) of a policy, `weights` (N, M); inf and zeros where a direction is not seen."""
        if not np.isfinite(self.cost(weights)):
            return np.inf, np.zeros(self.shape)
        self.backward_count += 1
        J, g, _ = self.design.derivatives(weights, curved=False)
        return J, g


@dataclass(frozen=True, eq=False)
class InformationJudged(Judged):
    """A policy of readings without a prior that is costed again in extended precision.

    Parameters
    ----------
    objective : InformationObjective that costed it
    """

    objective: InformationObjective | None = None

    def certified(self, bounding: Bounding) -> Certified:
        """Cost and bound, with an allowance that grows with the condition of F.

        Parameters
        ----------
        bounding : what the bound holds for

        Raises ValueError without an objective.
        """
        objective = self.objective
        if objective is None:
            raise ValueError("nothing to cost the policy by")
        J, g, condition = _extended(objective, self.weights)
        if not np.isfinite(J):
            return Certified(np.inf, -np.inf, 0.0, 0.0, 0.0, True)
        objective.cost(self.weights)
        J -= objective.smoothing_error
        S = objective.design.covariance(self.weights)
        bound = bounding.bound(J, self.weights, g)
        size = max(abs(J), 1.0 if objective.signed else 0.0)
        lost = (10 * LEAST * condition * objective.states + 10 * ULP) * size
        rounding = 0.0 if S is None else objective.criterion.rounding(S)
        apart = abs(J - bound) if np.isfinite(bound) else 0.0
        return Certified(J, bound, lost, lost + rounding * (1.0 + apart), 0.0, True)


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
    found = [at.tangent(v).certified(feasible_set) for at, v in [(objective, policy), *others]]
    cost, allowance = found[0].cost, found[0].cost_allowance
    bounds = [(each.lower_bound - each.bound_allowance, each.bound_allowance) for each in found]
    bounds = [(bound, room) for bound, room in bounds if np.isfinite(bound)]
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
    F = np.zeros((n, n), dtype=LONG) if objective.prior is None else objective.prior.astype(LONG)
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

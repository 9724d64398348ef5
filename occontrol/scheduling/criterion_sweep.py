"""Sweeps of any criterion: what its search, its bound and its proof need beside cost and gradient.

Every criterion here has a tangent that is a problem of traces: with Z = dphi/dX at a policy v,

    phi(X(w)) >= phi(X(v)) - tr(Z X(v)) + tr(Z X(w))      after tr(Z X(w)) is bounded by its own tangent at v,

since tr(Z X) is convex in the policy. For a norm the first two terms cancel, and any Z of the dual ball will do.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Generic, Protocol, Self, TypeVar, cast

import numpy as np

from occontrol.scheduling.certified import Term
from occontrol.scheduling.criterion import CorneredCriterion, Criterion
from occontrol.scheduling.objective import RecursiveObjective
from occontrol.scheduling.path import step_path
from occontrol.scheduling.proof import Judged
from occontrol.scheduling.recursion import Recursion
from occontrol.scheduling.sweep import Sweep

LEAST_SHARE = 1e-3  # of the criterion: what smoothing may cost a search that smooths once and for all


class SmoothableObjective(RecursiveObjective, Protocol):
    """An objective with a criterion that is not a weighted sum of covariances.

    Attributes
    ----------
    signed : whether it may be negative
    corners : whether it has to be smoothed to be minimised
    spread : how far smoothing raises it at most, for each unit of mu
    criterion_value : of the last cost
    smoothing_error : what the last cost has to lose before its tangent bounds the true criterion
    """

    @property
    def signed(self) -> bool: ...

    @property
    def corners(self) -> bool: ...

    @property
    def spread(self) -> float: ...

    @property
    def criterion_value(self) -> float: ...

    @property
    def smoothing_error(self) -> float: ...

    def with_smoothing(self, smoothing: float) -> Self:
        """The same with another mu, `smoothing`; 0 is the true criterion."""
        ...


class CriterionObjective(SmoothableObjective, Protocol):
    """One whose tangents are problems of traces."""

    def tangent(self, weights: np.ndarray) -> Judged:
        """The policy `weights` (N, M) with its tangent as a problem of traces, for `proof.prove`."""
        ...

    def on(self, columns: Recursion) -> Self:
        """The same on a recursion that differs in its `columns` alone: prices, rows of sensors, availability."""
        ...


T = TypeVar("T", bound=SmoothableObjective)


class CriterionSweep(Sweep):
    """A Sweep with a criterion of the last covariance; a CriterionObjective.

    Parameters
    ----------
    recursion : Recursion
    criterion : Criterion
    """

    def __init__(self, recursion: Recursion, criterion: Criterion):
        super().__init__(recursion, criterion=criterion)
        self.criterion = criterion

    @property
    def signed(self) -> bool:
        """Whether the criterion may be negative."""
        return self.criterion.signed

    @property
    def corners(self) -> bool:
        """Whether it has to be smoothed to be minimised."""
        return hasattr(self.criterion, "smoothed")

    @property
    def spread(self) -> float:
        """How far smoothing raises it at most, for each unit of mu."""
        return cast(CorneredCriterion, self.criterion).spread if self.corners else 0.0

    def with_smoothing(self, smoothing: float) -> CriterionSweep:
        """The same with another mu, `smoothing`; itself where there is nothing to smooth."""
        if not self.corners:
            return self
        return CriterionSweep(self.recursion, cast(CorneredCriterion, self.criterion).smoothed(smoothing))

    def on(self, columns: Recursion) -> CriterionSweep:
        """The same on a recursion that differs in its `columns` alone."""
        return CriterionSweep(columns, self.criterion)

    def tangent(self, weights: np.ndarray) -> Judged:
        """The policy `weights` (N, M) with its tangent as a problem of traces."""
        J, g = self.cost_and_gradient(weights)
        J -= self.smoothing_error
        final = step_path(self.recursion, weights, self.criterion).final
        W = self.criterion.gradient(final)
        offset = self.criterion.value(final) - self.criterion.smoothing_error(final) - float(np.vdot(W, final))
        trace = replace(self.recursion, terminal=(W + W.T) / 2)
        return Judged(weights, J, g, [Term(1.0, trace)], offset=offset, slack=self.criterion.rounding(final))


class Lowered(Generic[T]):
    """A criterion smoothed once and for all and lowered by that, so that it is convex and nowhere above the true one.

    Parameters
    ----------
    true : SmoothableObjective whose costs count
    whole : what is smoothed, `true` or more than that
    lost : by how much it may lie below `whole`, in units of the cost
    """

    def __init__(self, true: T, whole: SmoothableObjective, lost: float):
        self.true = true
        smooth = whole.corners and whole.spread > 0
        self.smoothing = lost / whole.spread if smooth else 0.0
        self._lower = whole.with_smoothing(self.smoothing) if smooth else whole
        self._shift = lost if smooth else 0.0

    @property
    def shape(self) -> tuple[int, int]:
        """(N, C) of the policies."""
        return self.true.shape

    @property
    def states(self) -> int:
        """n"""
        return self.true.states

    @property
    def forward_count(self) -> int:
        """Evaluations of the cost so far."""
        return self.true.forward_count + (0 if self._lower is self.true else self._lower.forward_count)

    @property
    def backward_count(self) -> int:
        """Evaluations of the gradient so far."""
        return self._lower.backward_count

    def cost_and_gradient(self, weights: np.ndarray) -> tuple[float, np.ndarray]:
        """The convex function below J, and its gradient (N, C), at a policy, `weights` (N, C)."""
        J, g = self._lower.cost_and_gradient(weights)
        return J - self._shift, g


class LowerModel(Lowered[SmoothableObjective]):
    """One whose costs are true, for searches that work with one objective to the end.

    Parameters
    ----------
    objective : SmoothableObjective, the true one
    at : (N, M) policy whose criterion sets how much is smoothed
    """

    foresees_exchanges = dense = False

    def __init__(self, objective: SmoothableObjective, at: np.ndarray):
        lost = 0.0
        if objective.corners and objective.spread > 0:
            objective.cost(at)
            lost = LEAST_SHARE * abs(objective.criterion_value)
        super().__init__(objective, objective, lost)
        self.recursion = objective.recursion

    def cost(self, weights: np.ndarray) -> float:
        """The true J of a policy, `weights` (N, M)."""
        return self.true.cost(weights)

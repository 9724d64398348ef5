"""Policies costed as accurately as the problem asks for, on the decisions of its schedule.

Three ways to cost a policy, by the problem's options: the recursion with one step an interval where that is accurate
enough; with a fixed number of equal steps; or extrapolated from a mesh that the policy's own local errors ask for.
The mesh depends on problem and policy alone, so whoever certifies a schedule gets the number of whoever found it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from occontrol.families.athans.discretise import HalfPredicts, discretise, half_predicts, scaled_rows
from occontrol.families.athans.integration.folded import Extrapolated, Folded
from occontrol.families.athans.integration.local_error import step_errors
from occontrol.families.athans.integration.mesh import MOST_IN_INTERVAL, Mesh, first_mesh
from occontrol.families.athans.integration.spans import Spans
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.scheduling.certified import Term
from occontrol.scheduling.proof import Judged
from occontrol.scheduling.recursion import Recursion
from occontrol.scheduling.sweep import Sweep

PASSES = 4
ATTEMPTS = 3
KEPT = 2  # evaluations that are handed out again when asked for
# the extrapolated error goes with the square of what is extrapolated away: 1e-3 of J leaves some 1e-6 (accuracy.md)
ROOT_SHARE = 0.3


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A policy and what it costs.

    Parameters
    ----------
    weights : (N, M)
    cost : J
    gradient : (N, M) dJ/dv
    error : estimated |J - J of continuous time|
    steps : number of integration steps, of the finer mesh where two are extrapolated
    on : Folded, Extrapolated, or None for one step an interval
    """

    weights: np.ndarray
    cost: float
    gradient: np.ndarray
    error: float
    steps: int
    on: Folded | Extrapolated | None

    def judged(self, plain: Recursion) -> Judged:
        """The same for the pass in square-root form.

        Parameters
        ----------
        plain : Recursion with one step an interval
        """
        terms, error = [Term(1.0, plain)], 0.0
        if isinstance(self.on, Folded):
            terms = [Term(1.0, self.on.shared)]
        elif self.on is not None:
            terms, error = [Term(4 / 3, self.on.half.shared), Term(-1 / 3, self.on.whole.shared)], self.error
        return Judged(self.weights, self.cost, self.gradient, terms, error)


class Integrator:
    """Costs policies of one problem.

    Parameters
    ----------
    problem : SchedulingProblem
    relative_gap : of the method, from which the accuracy follows where none is stated
    """

    def __init__(self, problem: SchedulingProblem, relative_gap: float = 1e-4):
        self.problem, self.options = problem, problem.integration
        self.accuracy = self.options.target(relative_gap)
        self._meshes: dict[bytes, Extrapolated] = {}
        self._evaluated: dict[bytes, Evaluation] = {}

    @cached_property
    def spans(self) -> Spans:
        """F and Q of all spans used so far."""
        return Spans(self.problem, Mesh.coarsest(self.problem, self.options.substeps or 1))

    @cached_property
    def halves(self) -> HalfPredicts:
        """Half predicts with one step an interval."""
        if self.plain or self.options.substeps:
            return half_predicts(self.problem)
        if not self.spans.fixed:  # the finest first: the coarser ones follow from them
            mesh = self.first
            self.spans.half_predicts(mesh.halved().halved())
            self.spans.half_predicts(mesh.halved())
        return self.spans.half_predicts(Mesh.coarsest(self.problem))

    @property
    def plain(self) -> bool:
        """Whether the problem asks for one step an interval."""
        return self.options.substeps == 1

    @cached_property
    def recursion(self) -> Recursion:
        """One step an interval."""
        return discretise(self.problem, self.halves)

    @cached_property
    def sweep(self) -> Sweep:
        """The sweep over `recursion`."""
        return Sweep(self.recursion)

    @cached_property
    def first(self) -> Mesh:
        """The mesh before any error is estimated."""
        rows = scaled_rows(self.problem.sensors, self.problem.midpoints[:1])[0][0]
        return first_mesh(self.problem, rows)

    @cached_property
    def fixed(self) -> Folded:
        """The recursion with the stated number of steps an interval."""
        return Folded(self.spans, Mesh.coarsest(self.problem, self.options.substeps or 1))

    def extrapolated(self, mesh: Mesh) -> Extrapolated:
        """Cost and gradient on a mesh."""
        if mesh.key not in self._meshes:
            if len(self._meshes) > 3:
                self._meshes.pop(next(iter(self._meshes)))
            self._meshes[mesh.key] = Extrapolated(self.spans, mesh, self.recursion)
        return self._meshes[mesh.key]

    def refined(
        self, weights: np.ndarray, mesh: Mesh, share: float = ROOT_SHARE
    ) -> tuple[Extrapolated, float, np.ndarray]:
        """The mesh divided until what is extrapolated away is small, and J and dJ/dv (N, M) of the policy on it.

        Parameters
        ----------
        weights : (N, M)
        mesh : to begin with
        share : of sqrt(accuracy) |J|, that may be extrapolated away
        """
        for attempt in range(PASSES):
            on = self.extrapolated(mesh)
            J, g = on.cost_and_gradient(weights)
            if attempt == PASSES - 1 or not on.whole.keeps_all or not np.isfinite(J):
                break
            errors = 4 / 3 * step_errors(on.whole, on.half, weights)
            allowed = share * np.sqrt(self.accuracy) * abs(J)
            total = float(np.sum(np.abs(errors)))
            if not np.isfinite(total) or total <= allowed or allowed == 0:
                break
            finer = mesh.equidistributed(errors, allowed / 2)
            if len(finer) == len(mesh):
                break
            mesh = finer
        return on, J, g

    def unresolved(self, on: Extrapolated, weights: np.ndarray) -> np.ndarray:
        """(N,) intervals that hold as many steps as may be and still spoil the accuracy.

        Parameters
        ----------
        on : that computed its gradient at the policy last
        weights : (N, M)
        """
        if not on.whole.keeps_all:
            return np.zeros(self.problem.intervals, dtype=bool)
        errors = on.whole.gathered(np.abs(4 / 3 * step_errors(on.whole, on.half, weights)))
        allowed = ROOT_SHARE * np.sqrt(self.accuracy) * abs(on.cost(weights))
        return (errors > 0.5 * allowed) & (on.mesh.counts > MOST_IN_INTERVAL // 2)

    def halving_error(self, weights: np.ndarray) -> float:
        """What the stated number of steps an interval costs a policy wrongly, by halving them once and twice.

        Parameters
        ----------
        weights : (N, M)
        """
        on = self.fixed
        J, meshes = on.cost(weights), (on.mesh.halved(), on.mesh.halved().halved())
        finer = [Folded(self.spans, mesh).cost(weights) for mesh in meshes]
        return max(4 / 3 * abs(finer[0] - J), 16 / 15 * abs(finer[1] - J))

    def evaluate(self, weights: np.ndarray) -> Evaluation:
        """What a policy costs, to the accuracy that the problem asks for if the limits on the steps permit.

        Parameters
        ----------
        weights : (N, M)
        """
        weights = np.ascontiguousarray(weights, dtype=float)
        key = weights.tobytes()
        if key not in self._evaluated:
            if len(self._evaluated) >= KEPT:
                self._evaluated.pop(next(iter(self._evaluated)))
            self._evaluated[key] = self._evaluate(weights)
        return self._evaluated[key]

    def _evaluate(self, weights: np.ndarray) -> Evaluation:
        N = self.problem.intervals
        if self.options.substeps is not None:
            if self.plain:
                return Evaluation(weights, *self.sweep.cost_and_gradient(weights), np.nan, N, None)
            on = self.fixed
            J, g = on.cost_and_gradient(weights)
            return Evaluation(weights, J, g, self.halving_error(weights), len(on.mesh), on)
        plain, slope = self.sweep.cost_and_gradient(weights)
        share, mesh = ROOT_SHARE, self.first
        for _ in range(ATTEMPTS):
            on, J, g = self.refined(weights, mesh, share)
            if len(self.first) == N and abs(J - plain) <= 0.5 * self.accuracy * abs(J):
                return Evaluation(weights, plain, slope, abs(J - plain), N, None)
            error = on.error(weights)
            if error <= self.accuracy * abs(J) or len(on.mesh) == len(mesh) > len(self.first):
                break
            share, mesh = share / 4, on.mesh
        return Evaluation(weights, J, g, error, len(on.half.mesh), on)

"""The recursion on a mesh finer than the decisions, and the two meshes whose difference is extrapolated away.

    J(v) = J_mesh(v[owner]),   dJ/dv_k = sum of dJ_mesh/dv over the steps of interval k
    J := (4 J_half - J_mesh)/3, and so for the gradient: the scheme is of second order

Repeating a policy on the steps is linear, so J on one mesh is convex; the extrapolated one is convex up to its error.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from occontrol.families.athans.discretise import HalfPredicts, recursion_on
from occontrol.families.athans.integration.mesh import Mesh
from occontrol.families.athans.integration.spans import Spans
from occontrol.scheduling.recursion import Recursion
from occontrol.scheduling.sweep import Sweep

KEPT_ERRORS = 4  # policies


class Folded:
    """Cost and gradient of policies (N, M) by the recursion on one mesh.

    Parameters
    ----------
    spans : Spans of the problem
    mesh : Mesh
    """

    def __init__(self, spans: Spans, mesh: Mesh):
        self.spans, self.mesh = spans, mesh
        self.halves: HalfPredicts = spans.half_predicts(mesh)
        steps = mesh.steps
        middle = spans.origin + (mesh.starts + steps / 2)
        self.fine: Recursion = recursion_on(spans.problem, self.halves, middle, steps, mesh.owner)
        self.sweep = Sweep(self.fine)
        self.first = np.searchsorted(mesh.owner, np.arange(mesh.interval[-1] + 1))

    @property
    def shared(self) -> Recursion:
        """The recursion on the steps, with the decisions that own them."""
        return replace(self.fine, available=self.spans.problem.upper, owner=self.mesh.owner)

    @property
    def keeps_all(self) -> bool:
        """Whether the covariances of all steps fit in memory, as the estimate of their errors needs them."""
        return self.sweep.foresees_exchanges

    def cost(self, weights: np.ndarray) -> float:
        """J of a policy, `weights` (N, M)."""
        return self.sweep.cost(weights[self.mesh.owner])

    def cost_and_gradient(self, weights: np.ndarray) -> tuple[float, np.ndarray]:
        """J and dJ/dv (N, M) of a policy, `weights` (N, M); `by_step` keeps those of the steps."""
        value, self.by_step = self.sweep.cost_and_gradient(weights[self.mesh.owner])
        return value, self.gathered(self.by_step)

    def gathered(self, by_step: np.ndarray) -> np.ndarray:
        """(N, ..) sums over the steps of every interval of `by_step` (K, ...), values for each of the K steps."""
        return np.add.reduceat(by_step, self.first, axis=0)


class Extrapolated:
    """Cost and gradient of policies (N, M), extrapolated from a mesh and the same mesh halved.

    Parameters
    ----------
    spans : Spans of the problem
    mesh : Mesh
    base : Recursion on the decisions, for whoever asks for `recursion`
    """

    def __init__(self, spans: Spans, mesh: Mesh, base: Recursion):
        self.spans, self.recursion = spans, base
        self.half = Folded(spans, mesh.halved())
        self.whole = Folded(spans, mesh)
        self.forward_count = self.backward_count = 0
        self._errors: dict[bytes, float] = {}  # of the policies asked for last: three sweeps each

    @property
    def mesh(self) -> Mesh:
        """The coarser mesh."""
        return self.whole.mesh

    def cost(self, weights: np.ndarray) -> float:
        """J of a policy, `weights` (N, M)."""
        self.forward_count += 1
        return (4 * self.half.cost(weights) - self.whole.cost(weights)) / 3

    def cost_and_gradient(self, weights: np.ndarray) -> tuple[float, np.ndarray]:
        """J and dJ/dv (N, M) of a policy, `weights` (N, M)."""
        self.forward_count += 1
        self.backward_count += 1
        coarse, fine = self.whole.cost_and_gradient(weights), self.half.cost_and_gradient(weights)
        return (4 * fine[0] - coarse[0]) / 3, (4 * fine[1] - coarse[1]) / 3

    @cached_property
    def quarter(self) -> Folded:
        """The recursion with every step of the mesh in four."""
        return Folded(self.spans, self.half.mesh.halved())

    def error(self, weights: np.ndarray) -> float:
        """|J - J with every step halved| * 16/15: the extrapolated cost is of fourth order.

        Where a second halving changes the cost by more than half of what the first one did, the steps are too long to
        show any order; then it is at least four times that change.

        Parameters
        ----------
        weights : (N, M)
        """
        key = np.ascontiguousarray(weights).tobytes()
        if key not in self._errors:
            if len(self._errors) >= KEPT_ERRORS:
                self._errors.pop(next(iter(self._errors)))
            self._errors[key] = self._error(weights)
        return self._errors[key]

    def _error(self, weights: np.ndarray) -> float:
        costs = [folded.cost(weights) for folded in (self.whole, self.half, self.quarter)]
        first, second = np.diff(costs)
        error = abs(4 * second - first) / 3 * 16 / 15
        return float(max(error, 4 * abs(second)) if abs(second) > abs(first) / 2 else error)

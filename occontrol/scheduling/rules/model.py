"""A criterion as a search under rules sees it: one convex function below J for bounds, and the true J of schedules.

Corners are smoothed once and for all, by so little that J is lowered by at most a set amount. With a limit e of the
peak, schedules that exceed it are not allowed; where it is kept

    model(v) = cost.v + rho mu log(1 + sum_i exp((f_i - e)/mu)) - rho mu log(m + 1) <= cost.v

so that whatever bounds the model bounds the schedules that keep rules and limit, for every rho. Without a prior J is
infinite where a direction is not seen; a prior that tells next to nothing makes the model finite, and lowers it.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext, suppress
from dataclasses import replace

import numpy as np

from occontrol.scheduling.criterion_sweep import CriterionSweep, Lowered, SmoothableObjective
from occontrol.scheduling.information import InformationObjective
from occontrol.scheduling.peak import PeakSweep
from occontrol.scheduling.proof import Judged
from occontrol.scheduling.recursion import Recursion

KEEPS = 1e-9  # of a limit, by which rounding may exceed it
STRONGER = (1e3, 1e6, 1e9, 1e12)  # times the vague prior
FINER = (1.0, 0.1, 0.0)  # times mu: where tangents are tried in the end


Measured = CriterionSweep | PeakSweep | InformationObjective


class CriterionModel(Lowered[Measured]):
    """J of a criterion under rules; an Objective whose cost and gradient belong together.

    Parameters
    ----------
    true : the objective without a limit, not smoothed
    lost : by how much the model may lie below J, in units of the cost
    limit : e of the peak, or None
    penalty : rho, of the limit
    vague : (n, n) information that tells next to nothing, where there is no prior: the model is finite with it
    """

    def __init__(
        self,
        true: Measured,
        lost: float,
        limit: float | None = None,
        penalty: float = 0.0,
        vague: np.ndarray | None = None,
    ):
        whole = true.with_limit(limit, penalty) if limit is not None and isinstance(true, PeakSweep) else true
        if vague is not None and isinstance(true, InformationObjective):
            whole = true.with_prior(vague)
        super().__init__(true, whole, lost)
        self.lost, self.limit, self.penalty, self.vague, self._whole = lost, limit, penalty, vague, whole
        self._stronger: list[InformationObjective] = []
        if vague is not None and isinstance(true, InformationObjective):
            more = (true.with_prior(factor * vague) for factor in STRONGER)
            self._stronger = [each.with_smoothing(self.smoothing) for each in more]

    @property
    def recursion(self) -> Recursion:
        """Of the decisions."""
        return self.true.given if isinstance(self.true, PeakSweep) else self.true.recursion

    @property
    def signed(self) -> bool:
        """Whether J may be negative."""
        return self.true.signed

    def cost(self, weights: np.ndarray) -> float:
        """The model at a policy, `weights` (N, C)."""
        return self._finite(lambda model: model.cost(weights)) - self._shift

    def cost_and_gradient(self, weights: np.ndarray) -> tuple[float, np.ndarray]:
        """The model, or where rounding makes it infinite one below it, and its gradient (N, C) at `weights` (N, C)."""
        found: list[np.ndarray] = []

        def cost(model: SmoothableObjective) -> float:
            J, g = model.cost_and_gradient(weights)
            found.append(g)
            return J

        return self._finite(cost) - self._shift, found[-1]

    def _finite(self, cost: Callable[[SmoothableObjective], float]) -> float:
        """A cost by the model; by one with a stronger prior, which lies below it, where a direction is all but unseen.

        An infinite cost would be taken for a bound, which the model's own rounding proves for no schedule.
        """
        if not self._stronger:
            return cost(self._lower)
        for model in (self._lower, *self._stronger):
            with suppress(ValueError):  # outputs whose errors rounding makes dependent
                J = cost(model)
                if np.isfinite(J):
                    return J
        raise ValueError("no prior makes the cost of this policy finite: the data span too many orders of magnitude")

    def true_cost(self, weights: np.ndarray) -> float:
        """J of a schedule, `weights` (N, C); inf where it exceeds the limit."""
        J = self.true.rough_cost(weights) if isinstance(self.true, InformationObjective) else self.true.cost(weights)
        if self.limit is None:
            return J
        return J - self.true.criterion_value if self.true.criterion_value <= self.limit * (1 + KEEPS) else np.inf

    def most(self) -> float:
        """What J may be at most beside prices: nothing is measured; with a limit the peak is no part of it."""
        if self.vague is not None:
            return np.inf
        J = self.true.cost(np.zeros(self.shape))
        return J if self.limit is None else J - self.true.criterion_value

    def with_prices(self, prices: np.ndarray) -> CriterionModel:
        """The same with other `prices` (N, C) in the recursion."""
        true = self.true.on(replace(self.recursion, cost=prices))
        return CriterionModel(true, self.lost, self.limit, self.penalty, self.vague)

    def judged(self, weights: np.ndarray) -> Judged:
        """A schedule, `weights` (N, C), with its true J."""
        if self.limit is None or not isinstance(self.true, PeakSweep):
            return self.true.tangent(weights)
        return self.true.with_limit(self.limit, 0.0).tangent(weights)

    def tangents(self, policy: np.ndarray) -> list[Judged]:
        """A `policy` (N, C) with tangents that bound J there, smoothed more and less, with the vague prior or none."""
        own = [] if self.vague is None else [self.true]
        found = []
        for whole in (*own, self._whole):
            smooth = whole.corners and self.smoothing > 0
            stages = [whole.with_smoothing(f * self.smoothing) for f in FINER] if smooth else [whole]
            for stage in stages:
                with suppress(ValueError) if self._stronger else nullcontext():
                    found.append(stage.tangent(policy))
        return [at for at in found if np.isfinite(at.cost)] or [m.tangent(policy) for m in self._stronger[-1:]]

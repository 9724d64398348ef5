"""What is to be minimised under rules, and what one schedule costs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from occontrol.scheduling.certified import Term
from occontrol.scheduling.proof import Judged
from occontrol.scheduling.rules.check import RELATIVE, keeps
from occontrol.scheduling.rules.model import CriterionModel
from occontrol.scheduling.rules.oracle import Oracle
from occontrol.scheduling.rules.plan import Plan
from occontrol.scheduling.rules.rules import Rules
from occontrol.scheduling.sweep import Sweep


@dataclass(frozen=True)
class Goal:
    """F = observation * sum(cost.v) + error * E(v) + switching, with E what J holds beside the observation cost.

    Parameters
    ----------
    observation, error : factors, not negative
    """

    observation: float = 1.0
    error: float = 1.0


@dataclass(frozen=True, eq=False)
class Task:
    """A problem with rules as the search sees it.

    Parameters
    ----------
    rules : Rules
    edges : (N+1,) times of the decisions
    oracle : Oracle of the rules
    sweep : J on the recursion with C columns, sensors measuring and then those that warm up; of a criterion a convex
        function that is nowhere above J
    spend : (N, M) what the use of a sensor on an interval adds to the observation cost
    goal : Goal
    """

    rules: Rules
    edges: np.ndarray
    oracle: Oracle
    sweep: Sweep | CriterionModel
    spend: np.ndarray
    goal: Goal

    @cached_property
    def price(self) -> np.ndarray:
        """(N, C) the linear part of the sweep's J."""
        return self.sweep.recursion.decision_cost

    @cached_property
    def complete(self) -> bool:
        """Whether every plan of the oracle keeps all rules but the caps on cost and error."""
        r, tracked = self.rules, self.oracle.automaton.tracked
        open_rules = {
            "max_uses": np.any(np.isfinite(r.max_uses)),
            "min_off": np.any(r.min_off > 0),
            "revisit": np.any(np.isfinite(r.revisit)),
            "max_time": np.any(np.isfinite(r.max_time)),
            "duty": np.any(np.isfinite(r.duty_time)),
        }
        return not any(wanted for name, wanted in open_rules.items() if name not in tracked)

    @property
    def model(self) -> CriterionModel | None:
        """What stands for J where its criterion is not the trace."""
        return self.sweep if isinstance(self.sweep, CriterionModel) else None

    @property
    def signed(self) -> bool:
        """Whether F may be negative, so that gaps are differences."""
        return self.model is not None and self.model.signed

    def size(self, value: float) -> float:
        """What a gap at F = `value` is a share of."""
        return 1.0 if self.signed else abs(value)

    def parts(self, weights: np.ndarray) -> tuple[float, float]:
        """sum(cost.v) and E of weights (N, C), as bounds are proven."""
        linear = float(np.vdot(self.price, weights))
        return linear, self.sweep.cost(weights) - linear

    def true_parts(self, weights: np.ndarray) -> tuple[float, float]:
        """sum(cost.v) and the true E of a schedule's weights (N, C); E is inf where a limit of the peak is exceeded."""
        if self.model is None:
            return self.parts(weights)
        linear = float(np.vdot(self.price, weights))
        return linear, self.model.true_cost(weights) - linear

    def judged(self, weights: np.ndarray) -> Judged:
        """A schedule, `weights` (N, C), with its true J, for a proof."""
        if self.model is not None:
            return self.model.judged(weights)
        J, g = self.sweep.cost_and_gradient(weights)
        return Judged(weights, J, g, [Term(1.0, self.sweep.recursion)])

    def tangents(self, policy: np.ndarray) -> list[Judged]:
        """A `policy` (N, C) with the tangents there that bound J, for a proof."""
        return [self.judged(policy)] if self.model is None else self.model.tangents(policy)

    def value(self, plan: Plan) -> float:
        """F of a plan; inf where it breaks a rule."""
        spent = float(np.vdot(self.spend, plan.on))
        if spent > self.rules.max_observation * (1 + RELATIVE):
            return np.inf
        if not self.complete and not keeps(self.rules, self.edges, plan.on):
            return np.inf
        linear, error = self.true_parts(plan.weights)
        if error > self.rules.max_error * (1 + RELATIVE):
            return np.inf
        return self.goal.observation * linear + self.goal.error * error + plan.switching

"""What is to be minimised under rules, and what one schedule costs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from occontrol.scheduling.rules.check import RELATIVE, keeps
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
    sweep : J on the recursion with C columns, sensors measuring and then those that warm up
    spend : (N, M) what the use of a sensor on an interval adds to the observation cost
    goal : Goal
    """

    rules: Rules
    edges: np.ndarray
    oracle: Oracle
    sweep: Sweep
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

    def parts(self, weights: np.ndarray) -> tuple[float, float]:
        """sum(cost.v) and E of weights (N, C)."""
        linear = float(np.vdot(self.price, weights))
        return linear, self.sweep.cost(weights) - linear

    def value(self, plan: Plan) -> float:
        """F of a plan; inf where it breaks a rule."""
        spent = float(np.vdot(self.spend, plan.on))
        if spent > self.rules.max_observation * (1 + RELATIVE):
            return np.inf
        if not self.complete and not keeps(self.rules, self.edges, plan.on):
            return np.inf
        linear, error = self.parts(plan.weights)
        if error > self.rules.max_error * (1 + RELATIVE):
            return np.inf
        return self.goal.observation * linear + self.goal.error * error + plan.switching

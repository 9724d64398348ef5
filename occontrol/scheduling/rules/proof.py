"""Cost and bound under rules in square-root form, with what rounding may have done to them.

As scheduling/proof.py, which see: the tree's bound is known in the product form only, so it is lowered by MIXED times
what the two forms differ by, on the final schedule and on the policy whose tangent proves the bound of the first node.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occontrol.core.solution import ALLOWANCE, Certificate
from occontrol.scheduling.certified import Term, certified
from occontrol.scheduling.proof import MIXED, Proof
from occontrol.scheduling.rules.hull import bound_at
from occontrol.scheduling.rules.master import Multipliers, Tangent
from occontrol.scheduling.rules.plan import Plan
from occontrol.scheduling.rules.rows import Rows
from occontrol.scheduling.rules.task import Task


@dataclass(frozen=True, eq=False)
class RuledBound:
    """What a tangent proves for all schedules that keep the rules, with fixed multipliers.

    Parameters
    ----------
    task, rows : what is bounded
    multipliers : Multipliers of the rows that were known when they were found
    """

    task: Task
    rows: Rows
    multipliers: Multipliers

    def bound(self, cost: float, weights: np.ndarray, gradient: np.ndarray) -> float:
        """The lower bound on F that J = `cost` and its gradient (N, C) at `weights` (N, C) prove."""
        linear = float(np.vdot(self.task.price, weights))
        at = Tangent(weights, linear, cost - linear, gradient - self.task.price)
        multipliers = self.multipliers.padded(len(self.rows.known))
        return bound_at(self.task, self.rows, at, multipliers, None)[0]


@dataclass(frozen=True, eq=False)
class Claim:
    """What a search says, to be proven.

    Parameters
    ----------
    plan : the schedule, or None
    weights : (N, C) of it, or of a mixture
    switching : what its changes cost, or cost on average
    lower_bound : of the search
    tangent : (policy (N, C), Multipliers, bound) that the first node's bound rests on
    """

    plan: Plan | None
    weights: np.ndarray
    switching: float
    lower_bound: float
    tangent: tuple[np.ndarray, Multipliers, float]


def prove_under_rules(task: Task, rows: Rows, claim: Claim) -> Proof:
    """Certificate of F for a schedule and a bound.

    Parameters
    ----------
    task, rows : of the search
    claim : what it says
    """
    goal, terms = task.goal, [Term(1.0, task.sweep.recursion)]
    policy, multipliers, own = claim.tangent
    judge = RuledBound(task, rows, multipliers)
    final = certified(terms, judge, claim.weights)  # type: ignore[arg-type]
    at = certified(terms, judge, policy)  # type: ignore[arg-type]
    factor = max(goal.error + multipliers.error, goal.error, 1.0 if goal.error else 0.0)
    difference = factor * max(abs(task.sweep.cost(claim.weights) - final.cost), abs(task.sweep.cost(policy) - at.cost))
    spread = abs(own - at.lower_bound) if np.isfinite(own) else np.inf
    allowance = max(at.bound_allowance, factor * at.cost_allowance)
    bounds = [at.lower_bound - allowance]
    if at.convex:
        bounds += [claim.lower_bound - MIXED * max(spread, difference) - allowance, 0.0]
    linear = float(np.vdot(task.price, claim.weights))
    cost = goal.observation * linear + goal.error * (final.cost - linear) + claim.switching
    bound = max(bound for bound in bounds if np.isfinite(bound)) if any(map(np.isfinite, bounds)) else -np.inf
    allowance = max(allowance, final.cost_allowance)
    share = min(allowance / abs(cost), 1.0) if cost else 0.0
    return Proof(Certificate(cost, bound, max(share, ALLOWANCE)), allowance, difference, final.below)

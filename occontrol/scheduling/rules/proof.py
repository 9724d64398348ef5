"""Cost and bound under rules in square-root form, with what rounding may have done to them.

As scheduling/proof.py, which see: the tree's bound is known in the product form only, so it is lowered by MIXED times
what the two forms differ by, on the final schedule and on the policy whose tangent proves the bound of the first node.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occontrol.core.solution import ALLOWANCE, Certificate
from occontrol.scheduling.certified import Certified
from occontrol.scheduling.proof import MIXED, Judged, Proof
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
    offset : what J is more than the cost that the tangent is given
    """

    task: Task
    rows: Rows
    multipliers: Multipliers
    offset: float = 0.0

    def bound(self, cost: float, weights: np.ndarray, gradient: np.ndarray) -> float:
        """The lower bound on F that J = `cost` and its gradient (N, C) at `weights` (N, C) prove."""
        linear = float(np.vdot(self.task.price, weights))
        at = Tangent(weights, linear, cost + self.offset - linear, gradient - self.task.price)
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
    goal = task.goal
    policy, multipliers, _ = claim.tangent

    def again(judged: Judged) -> tuple[Certified, float, float]:
        """In square-root form; what the product form's cost and bound are away from it."""
        judge = RuledBound(task, rows, multipliers, judged.offset)
        found = judged.certified(judge)
        own = RuledBound(task, rows, multipliers).bound(judged.cost, judged.weights, judged.gradient)
        apart = abs(own - found.lower_bound) if np.isfinite(own) else np.inf
        return found, abs(judged.cost - judged.offset - found.cost), apart

    end = task.judged(claim.weights)
    final, off, _ = again(end)
    tangents = [(each, *again(each)) for each in task.tangents(policy)]
    factor = max(goal.error + multipliers.error, goal.error, 1.0 if goal.error else 0.0)
    difference = factor * max(off, *(apart for _, _, apart, _ in tangents))
    spread = max(apart for *_, apart in tangents)
    bounds, allowances = [], []
    for each, at, *_ in tangents:
        allowance = max(at.bound_allowance, factor * at.cost_allowance) + factor * each.slack
        bounds.append(at.lower_bound - allowance)
        allowances.append(allowance)
    allowance = max(allowances)
    if all(at.convex for _, at, *_ in tangents):
        bounds.append(claim.lower_bound - MIXED * max(spread, difference) - allowance)
        bounds += [] if task.signed else [0.0]
    linear = float(np.vdot(task.price, claim.weights))
    cost = goal.observation * linear + goal.error * (final.cost + end.offset - linear) + claim.switching
    bound = max(bound for bound in bounds if np.isfinite(bound)) if any(map(np.isfinite, bounds)) else -np.inf
    allowance = max(allowance, final.cost_allowance + end.slack)
    size = task.size(cost)
    share = min(allowance / size, 1.0) if size else 0.0
    return Proof(Certificate(cost, bound, max(share, ALLOWANCE), task.signed), allowance, difference, final.below)

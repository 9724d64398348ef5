"""The rest of a horizon planned anew from an estimate: relinearised there, started warm, within a gap and a deadline.

Readings already taken are spent: of a budget the rest is left, and rules hold for what was done and what is to come.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from occontrol.core.errors import InfeasibleError, UsageError
from occontrol.core.monitor import Monitor
from occontrol.families.athans.methods import RelaxRoundPolish
from occontrol.families.athans.readings.budgets import with_budget
from occontrol.families.athans.readings.fill import feasible_set
from occontrol.families.athans.readings.ruled import WEIGHTS
from occontrol.families.athans.replanning.chain import LinearChain, NonlinearChain
from occontrol.families.athans.replanning.rest import Rests
from occontrol.families.athans.replanning.ruled import RulesOnTheWay
from occontrol.scheduling.budget import BudgetSet
from occontrol.scheduling.feasible_set import FeasibleSet, IntervalPolytopes
from occontrol.scheduling.hminimal import polish
from occontrol.scheduling.relaxation import RelaxedOptions, minimise_relaxed
from occontrol.scheduling.rounding import roundings
from occontrol.scheduling.sweep import Sweep

MOST_STEPS = 60  # of a plan's relaxation
POLISH = 30  # rounds
EQUAL_SHARE = 0.05  # of equal shares in a start: zeros would stay at their face


@dataclass(frozen=True, eq=False)
class Replan:
    """One plan.

    Parameters
    ----------
    k : the first reading that it plans
    weights : (N-k, M) of every reading; after a receding horizon those of the old plan
    measuring : (N-k, M) of them what is read: less than is on and paid for where sensors warm up
    relaxed : (E, M) shares of all decisions, the start of the next plan
    cost, lower_bound : of the linearised rest, in cost units
    seconds : it took
    late : whether the deadline passed: the old plan goes on
    """

    k: int
    weights: np.ndarray
    measuring: np.ndarray
    relaxed: np.ndarray
    cost: float
    lower_bound: float
    seconds: float
    late: bool = False


class Planner:
    """Plans the rest of a problem of readings.

    Parameters
    ----------
    chain : of the problem
    gap : relative, of a plan's relaxation
    horizon : readings that a plan looks ahead, or None
    deadline : seconds that a plan may take, or None

    Raises UsageError for a cap on the error, and for a horizon that recedes with rules.
    """

    def __init__(
        self,
        chain: LinearChain | NonlinearChain,
        gap: float = 1e-3,
        horizon: int | None = None,
        deadline: float | None = None,
    ):
        problem = chain.problem
        self.chain, self.problem = chain, problem
        self.gap, self.horizon, self.deadline = gap, horizon, deadline
        self.rules, weight = None, None
        if problem.ruled:
            if horizon is not None:
                what = "a horizon that recedes does not see the rules behind it"
                raise UsageError(f"{what}\n  hint: leave replan.horizon out, or the rules")
            self.rules, weight = RulesOnTheWay(problem), WEIGHTS.get(problem.minimise)
        self.rests, self.allowed = Rests(chain, weight), feasible_set(problem)
        self.owner = self.rests.owner

    def begins(self, k: int) -> bool:
        """Whether a decision begins at reading k."""
        return 0 <= k < len(self.owner) and (k == 0 or self.owner[k] != self.owner[k - 1])

    def measuring(self, weights: np.ndarray) -> np.ndarray:
        """(N, M) what is read along a schedule, `weights` (N, M)."""
        return weights if self.rules is None else self.rules.measuring(self._by_decision(weights))[self.owner]

    def plan(
        self, k: int, mean: np.ndarray, covariance: np.ndarray, old: np.ndarray, shares: np.ndarray | None = None
    ) -> Replan:
        """A plan for readings k .. N-1.

        Parameters
        ----------
        k : the next reading, at which a decision begins
        mean, covariance : (n,) and (n, n) before it
        old : (N, M) the plan so far; its readings before k are spent
        shares : (E, M) relaxed shares of the whole horizon to start from; None: those of the old plan

        Raises ProblemError where the path from the estimate leaves the numbers, InfeasibleError where no schedule
        that keeps the rules goes on from what was done.
        """
        began = time.perf_counter()
        last = len(self.owner) if self.horizon is None else min(len(self.owner), k + self.horizon)
        while last < len(self.owner) and not self.begins(last):
            last += 1
        recursion, upper = self.rests.from_estimate(k, last, mean, covariance)
        first, end = int(self.owner[k]), int(self.owner[last - 1]) + 1
        allowed = self._allowed(upper, old, k, last)
        before = self._by_decision(old)
        whole = before.copy() if shares is None else shares.copy()
        start = allowed.project((1 - EQUAL_SHARE) * whole[first:end] + EQUAL_SHARE * allowed.uniform())
        monitor = Monitor()
        if self.deadline is not None:
            monitor.time_limit = self.deadline
        sweep = Sweep(recursion)
        if self.rules is None:
            relaxed, bound, best = self._searched(sweep, allowed, start, before[first:end], monitor)
            measuring, cost = best, sweep.cost(best)
        else:
            made = minimise_relaxed(sweep, allowed, start, RelaxedOptions(self.gap, MOST_STEPS), monitor)
            relaxed = made.weights
            found = self.rules.searched(recursion, k, self.owner, upper, before, made, self.gap, monitor)
            if found is None:
                what = f"no schedule that keeps the rules goes on from what was done before reading {k}"
                raise InfeasibleError(f"{what}\n  hint: a window that has closed, or a rule that has changed")
            best, measuring, cost, bound = found
        seconds = time.perf_counter() - began
        late = self.deadline is not None and seconds > self.deadline
        weights, reads = old[k:].copy(), self.measuring(old)[k:].copy() if late else old[k:].copy()
        whole[first:end] = relaxed
        if not late:
            at = self.owner[k:last] - first
            weights[: last - k], reads[: last - k] = best[at], measuring[at]
        return Replan(k, weights, reads, whole, float(cost), float(bound), seconds, late)

    def _searched(
        self, sweep: Sweep, allowed: FeasibleSet, start: np.ndarray, before: np.ndarray, monitor: Monitor
    ) -> tuple[np.ndarray, float, np.ndarray]:
        """Shares, bound and schedule of a rest; the old plan `before` (E', M) is one of the candidates."""
        if isinstance(allowed, BudgetSet):
            made = with_budget(sweep, allowed, RelaxRoundPolish(self.gap, polish=POLISH), monitor)
            bound = made.bound if made.relaxed is None else max(made.bound, made.relaxed.lower_bound)
            kept = allowed.contains(before) and sweep.cost(before) < sweep.cost(made.weights)
            return made.weights, bound, before if kept else made.weights
        found = minimise_relaxed(sweep, allowed, start, RelaxedOptions(self.gap, MOST_STEPS), monitor)
        candidates = [*roundings(found.weights, allowed), *([before] if allowed.contains(before) else [])]
        best = polish(sweep, allowed, min(candidates, key=sweep.cost), POLISH, monitor)
        return found.weights, found.lower_bound, best.weights

    def _by_decision(self, weights: np.ndarray) -> np.ndarray:
        return weights[np.flatnonzero(np.diff(self.owner, prepend=-1))]

    def _allowed(self, upper: np.ndarray, old: np.ndarray, k: int, last: int) -> FeasibleSet:
        """The set of the decisions of readings k .. last - 1, less what is spent of a budget."""
        names = tuple(self.problem.sensors.names)
        places = self.problem.places
        if not isinstance(self.allowed, BudgetSet):
            return IntervalPolytopes(upper, places, None, names)
        rest = {}
        for name, count in (self.problem.budget or {}).items():
            measuring = [j for j, s in enumerate(self.problem.sensors) if s.rows and name in ("total", s.name)]
            spent = round(float(np.sum(old[:k][:, measuring])))
            later = round(float(np.sum(old[last:][:, measuring])))
            rest[name] = max(0, int(count) - spent - later)
        return BudgetSet(upper, places, None, names, budget=rest)


def usable(mean: np.ndarray, covariance: np.ndarray) -> bool:
    """Whether an estimate, `mean` (n,), and its `covariance` (n, n) are numbers that one can plan from."""
    return bool(np.all(np.isfinite(mean)) and np.all(np.isfinite(covariance)))

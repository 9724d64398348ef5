"""The rest of a horizon planned anew from an estimate: relinearised there, started warm, within a gap and a deadline.

Readings already taken are spent: of a budget the rest is left. A nonlinear plant is followed from the estimate itself.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import cast

import numpy as np

from occontrol.core.errors import UsageError
from occontrol.core.monitor import Monitor
from occontrol.families.athans.methods import RelaxRoundPolish
from occontrol.families.athans.nonlinear.nominal import spans_of
from occontrol.families.athans.nonlinear.path import evaluate
from occontrol.families.athans.readings.budgets import with_budget
from occontrol.families.athans.readings.fill import feasible_set, fill, in_units
from occontrol.families.athans.replanning.chain import LinearChain, NonlinearChain
from occontrol.numerics.flow import Spans, charges
from occontrol.numerics.linalg import whiten
from occontrol.scheduling.budget import BudgetSet
from occontrol.scheduling.feasible_set import FeasibleSet, IntervalPolytopes
from occontrol.scheduling.hminimal import polish
from occontrol.scheduling.recursion import Recursion
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
    relaxed : (E, M) shares of all decisions, the start of the next plan
    cost, lower_bound : of the linearised rest, in cost units
    seconds : it took
    late : whether the deadline passed: the old plan goes on
    """

    k: int
    weights: np.ndarray
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

    Raises UsageError for rules on whole schedules.
    """

    def __init__(
        self,
        chain: LinearChain | NonlinearChain,
        gap: float = 1e-3,
        horizon: int | None = None,
        deadline: float | None = None,
    ):
        problem = chain.problem
        if problem.rules is not None:
            hint = "windows, select and budgets go with it"
            raise UsageError(f"plans on the way do not keep rules on whole schedules yet\n  hint: {hint}")
        self.chain, self.problem = chain, problem
        self.gap, self.horizon, self.deadline = gap, horizon, deadline
        self.full, self.allowed = fill(problem), feasible_set(problem)
        self.owner = problem.clock.owner
        if self.owner is None:
            self.owner = np.arange(problem.readings)

    def begins(self, k: int) -> bool:
        """Whether a decision begins at reading k."""
        return 0 <= k < len(self.owner) and (k == 0 or self.owner[k] != self.owner[k - 1])

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

        Raises ProblemError where the path from the estimate leaves the numbers.
        """
        began = time.perf_counter()
        last = len(self.owner) if self.horizon is None else min(len(self.owner), k + self.horizon)
        while last < len(self.owner) and not self.begins(last):
            last += 1
        recursion, upper = self._rest(k, last, mean, covariance)
        first, end = int(self.owner[k]), int(self.owner[last - 1]) + 1
        allowed = self._allowed(upper, old, k, last, first, end)
        old_shares = self._by_decision(old) if shares is None else shares
        start = allowed.project((1 - EQUAL_SHARE) * old_shares[first:end] + EQUAL_SHARE * allowed.uniform())
        monitor = Monitor()
        if self.deadline is not None:
            monitor.time_limit = self.deadline
        sweep, before = Sweep(recursion), self._by_decision(old)[first:end]
        relaxed, bound, best = self._searched(sweep, allowed, start, before, monitor)
        cost = sweep.cost(best)
        seconds = time.perf_counter() - began
        late = self.deadline is not None and seconds > self.deadline
        weights, whole = old[k:].copy(), old_shares.copy()
        whole[first:end] = relaxed
        if not late:
            weights[: last - k] = best[self.owner[k:last] - first]
        return Replan(k, weights, whole, float(cost), float(bound), seconds, late)

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

    def _allowed(self, upper: np.ndarray, old: np.ndarray, k: int, last: int, first: int, end: int) -> FeasibleSet:
        """The set of the decisions `first` .. `end` - 1, less what is spent of a budget."""
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

    def _rest(self, k: int, last: int, mean: np.ndarray, covariance: np.ndarray) -> tuple[Recursion, np.ndarray]:
        """The recursion of readings k .. last - 1 from an estimate, and what is open (E', M)."""
        full, units = self.full.recursion, self.full.units
        n, first, end = full.states, int(self.owner[k]), int(self.owner[last - 1]) + 1
        owner = self.owner[k:last] - first
        parts = {
            "steps": full.steps[k:last],
            "cost": full.cost[k:last],
            "charge": None if full.charge is None else full.charge[k:last],
            "owner": owner,
        }
        if isinstance(self.chain, LinearChain):
            transition = np.concatenate([np.eye(n)[None], full.transition])
            noise = np.concatenate([np.zeros((1, n, n)), full.noise])
            predict = np.concatenate([[0], full.predict[k + 1 : last + 1] + 1])
            W = full.terminal
            for i in range(len(full.predict) - 1, last, -1):  # nothing is planned on the way to the end
                F = full.transition[full.predict[i]]
                W = F.T @ W @ F
            recursion = Recursion(
                initial=units.covariance(covariance), transition=transition, noise=noise, predict=predict,
                rows=full.rows, row_set=full.row_set[k:last], offsets=full.offsets, running=full.running,
                running_set=full.running_set[k:last], terminal=W, available=self.problem.upper[first:end], **parts,
            )  # fmt: skip
            return recursion, self.problem.upper[first:end]
        return self._relinearised(k, last, mean, covariance, parts)

    def _relinearised(
        self, k: int, last: int, mean: np.ndarray, covariance: np.ndarray, parts: dict
    ) -> tuple[Recursion, np.ndarray]:
        """The same of a nonlinear plant along its path from `mean`."""
        chain, problem = cast(NonlinearChain, self.chain), self.problem
        stages, n = chain.stages, len(mean)
        spans = self._spans(mean, k)
        states = np.vstack([mean[None], spans.ends[: last - k - 1]])
        times = stages.times[k:last]
        rows, upper = self._rows(states, times, k, last)
        end_map = np.eye(n)
        for F in spans.transition[last - k :][::-1]:
            end_map = end_map @ F
        count = last - k
        D = problem.output.at(problem.output_at)
        posterior = problem.discrete and problem.at == "posterior" and last == problem.readings
        final = np.eye(n)[None] if posterior else spans.transition[count - 1 : count]
        last_noise = np.zeros((1, n, n)) if posterior else spans.noise[count - 1 : count]
        weighed = D if posterior else D @ end_map
        running, running_set = self._running(spans, times, count)
        recursion = Recursion(
            initial=(covariance + covariance.T) / 2,
            transition=np.concatenate([np.eye(n)[None], spans.transition[: count - 1], final]),
            noise=np.concatenate([np.zeros((1, n, n)), spans.noise[: count - 1], last_noise]),
            predict=np.arange(count + 1),
            rows=rows,
            row_set=np.arange(count),
            offsets=self.full.recursion.offsets,
            running=running,
            running_set=running_set,
            terminal=weighed.T @ weighed,
            available=upper,
            **parts,
        )
        return in_units(recursion, self.full.units), upper

    def _spans(self, mean: np.ndarray, k: int) -> Spans:
        """The spans after reading k, along the path from `mean` (n,) there."""
        stages = cast(NonlinearChain, self.chain).stages
        plant = stages.origin.plant
        if self.problem.discrete:
            since = np.arange(k, len(stages.times) + 1, dtype=float)
            return spans_of(plant, 0.0, since, 1, mean)
        nominal = stages.origin.nominal
        since = nominal.since[k + 1 :]
        return spans_of(plant, nominal.origin, since, stages.substeps, mean)

    def _rows(self, states: np.ndarray, times: np.ndarray, k: int, last: int) -> tuple[np.ndarray, np.ndarray]:
        """Whitened rows (count, r, n) of all sensors along the path, and what is open (E', M)."""
        sensors = cast(NonlinearChain, self.chain).sensors
        blocks, open_ = [], np.ones((len(times), len(self.problem.sensors)))
        for j, sensor in enumerate(sensors):
            if sensor is None:
                blocks.append(np.zeros((len(times), 0, states.shape[1])))
                continue
            C, theta = evaluate(sensor.slope(), states, times), evaluate(sensor.covariance(), states, times)
            good = np.all(np.isfinite(C), axis=(1, 2)) & np.all(np.isfinite(theta), axis=(1, 2))
            seen = sensor.seen()
            if seen is not None:
                good &= evaluate(seen, states, times)[:, 0, 0] > 0
            if sensor.windows is not None:
                good &= np.any([(a <= times) & (times <= b) for a, b in sensor.windows], axis=0)
            C, theta = np.where(good[:, None, None], C, 0.0), np.where(good[:, None, None], theta, np.eye(sensor.rows))
            blocks.append(whiten(theta, C)[0])
            open_[:, j] = good
        least, most = self.problem.select
        for j, stated in enumerate(self.problem.sensors):
            if stated.is_idle:
                others = np.sum(np.delete(open_, j, axis=1), axis=1)
                open_[:, j] = np.maximum(most - least, most - others)
        owner = self.owner[k:last]
        return (
            np.ascontiguousarray(np.concatenate(blocks, axis=1)),
            np.minimum.reduceat(open_, np.flatnonzero(np.diff(owner, prepend=-1)), axis=0),
        )

    def _running(self, spans: Spans, times: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
        problem, n = self.problem, spans.transition.shape[1]
        if problem.running is None:
            return np.zeros((0, n, n)), np.zeros(count, dtype=np.int64)
        if problem.running_at != "integral":
            R = np.array(problem.running.sample(times))
        else:
            nodes = spans.times
            inner = np.clip(nodes, nodes[:, :1], nodes[:, :1] + (nodes[:, -1:] - nodes[:, :1]) * (1 - 1e-9))
            weight = np.array(problem.running.sample(inner.ravel())).reshape(*nodes.shape, n, n)
            R = charges(spans, (weight + np.swapaxes(weight, 2, 3)) / 2)[0][:count]
        return (R + np.swapaxes(R, 1, 2)) / 2, np.arange(count)


def usable(mean: np.ndarray, covariance: np.ndarray) -> bool:
    """Whether an estimate, `mean` (n,), and its `covariance` (n, n) are numbers that one can plan from."""
    return bool(np.all(np.isfinite(mean)) and np.all(np.isfinite(covariance)))

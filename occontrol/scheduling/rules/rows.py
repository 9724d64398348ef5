"""Rules that the states of the oracle do not keep, as linear rows u.w <= b that are priced.

    uses      sum_k start_kj <= max_uses                       time    sum_k h_k on_kj <= max_time
    readings  sum_k reads_k on_kj <= max_uses
    cost      sum_kj spend_kj on_kj <= max_observation         duty    sum_k |[t_k, t_k+1] in window| on_kj <= time
    min_off   stops at e <= k with t_k - t_e < min_off, and on_kj, together at most 1
    revisit   - sum_{a <= k < b} on_kj <= -1,  b the first edge with t_b - t_a > revisit

Rows of the last three kinds are many, so only those that a policy violates are made.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from occontrol.scheduling.rules.check import RELATIVE
from occontrol.scheduling.rules.grid import NEVER, Counts, counts
from occontrol.scheduling.rules.oracle import Prices
from occontrol.scheduling.rules.plan import Plan
from occontrol.scheduling.rules.task import Task

VIOLATED = 1e-6  # of a row
AT_ONCE = 8  # rows of a kind that are added together


@dataclass(frozen=True, eq=False)
class Row:
    """u.w <= limit with u = (on, start, stop), scaled so that |limit| or the largest coefficient is 1.

    Parameters
    ----------
    rule : as in Rules
    sensor : index, or None where it is about all of them
    u : Prices, its coefficients
    limit : b
    unit : what one unit of the row is in units of the rule
    """

    rule: str
    sensor: int | None
    u: Prices
    limit: float
    unit: float

    def use(self, plan: Plan) -> float:
        """u.w of a plan."""
        return self.u.of(plan)


@dataclass
class Mean:
    """The average of plans: on, starts, stops (N, M) by `shares`."""

    on: np.ndarray
    starts: np.ndarray
    stops: np.ndarray

    @classmethod
    def of(cls, plans: list[Plan], shares: np.ndarray) -> Mean:
        """The average of P plans with `shares` (P,)."""
        kept = [(p, s) for p, s in zip(plans, shares, strict=True) if s > 1e-12]
        return cls(*(sum(s * getattr(p, name) for p, s in kept) for name in ("on", "starts", "stops")))  # type: ignore[arg-type]


@dataclass
class Rows:
    """The rows of a task: those known from the start, and those found violated.

    Parameters
    ----------
    task : Task
    known : rows so far
    """

    task: Task
    known: list[Row] = field(default_factory=list)

    def __post_init__(self) -> None:
        task, rules = self.task, self.task.rules
        self._seen: set[tuple] = set()
        self._counts: Counts = counts(rules, task.oracle.grid)
        tracked, slack = task.oracle.automaton.tracked, task.oracle.grid.slack
        # a row allows what the check of a schedule allows, so that the bound holds for every schedule that passes it
        for j in range(rules.sensors):
            if np.isfinite(rules.max_uses[j]) and "max_uses" not in tracked:
                counted = {"start": (slice(None), 1.0)} if rules.reads is None else {"on": (slice(None), rules.reads)}
                self._add("max_uses", j, counted, float(rules.max_uses[j]))
            if np.isfinite(rules.max_time[j]):
                limit = float(rules.max_time[j]) + slack
                self._add("max_time", j, {"on": (slice(None), task.oracle.grid.steps)}, limit)
        if np.isfinite(rules.max_observation):
            none = Prices.none(*task.spend.shape)
            unit = max(rules.max_observation, float(np.max(task.spend)), 1e-300)
            u = Prices(task.spend / unit, none.start, none.stop)
            self.known.append(Row("max_observation", None, u, rules.max_observation * (1 + RELATIVE) / unit, unit))

    def _add(self, rule: str, j: int, where: dict, limit: float) -> None:
        N, M = self.task.spend.shape
        u = Prices.none(N, M)
        largest = max(float(np.max(np.abs(value))) for _, value in where.values())
        unit = max(abs(limit), largest)
        for name, (at, value) in where.items():
            getattr(u, name)[at, j] = value / unit
        self.known.append(Row(rule, j, u, limit / unit, unit))

    def adopt(self, other: Rows) -> int:
        """Take over the rows of the same task without its cap; where its own row of the cap then stands, or would."""
        at = next((i for i, row in enumerate(self.known) if row.rule == "max_observation"), len(self.known))
        self.known[:] = [*other.known[:at], *self.known[at : at + 1], *other.known[at:]]
        self._seen = other._seen
        return at

    def separate(self, mean: Mean) -> int:
        """Add rows that an average of plans violates; how many."""
        before = len(self.known)
        rules, tracked = self.task.rules, self.task.oracle.automaton.tracked
        for j in range(rules.sensors):
            if np.isfinite(rules.duty_time[j]):
                self._duty(mean, j)
            if rules.min_off[j] > 0 and "min_off" not in tracked:
                self._min_off(mean, j)
            if np.isfinite(rules.revisit[j]) and "revisit" not in tracked:
                self._revisit(mean, j)
        return len(self.known) - before

    def _worst(self, name: str, j: int, excess: np.ndarray) -> list[int]:
        """The most violated places that have no row yet."""
        order = [int(i) for i in np.argsort(-excess, kind="stable")[: 4 * AT_ONCE] if excess[i] > VIOLATED]
        fresh = [i for i in order if (name, j, i) not in self._seen][:AT_ONCE]
        self._seen |= {(name, j, i) for i in fresh}
        return fresh

    def _duty(self, mean: Mean, j: int) -> None:
        rules, t = self.task.rules, self.task.oracle.grid.times
        window, most = float(rules.duty_window[j]), float(rules.duty_time[j])
        slack = self.task.oracle.grid.slack
        begins = np.unique(np.concatenate([t, t - window]))
        begins = begins[(begins >= -slack) & (begins + window <= t[-1] + slack)]
        if not len(begins):
            return
        used = np.concatenate([[0.0], np.cumsum(np.diff(t) * mean.on[:, j])])
        excess = (np.interp(begins + window, t, used) - np.interp(begins, t, used) - most) / max(most, 1e-300)
        for i in self._worst("duty", j, excess):
            overlap = np.minimum(t[1:], begins[i] + window) - np.maximum(t[:-1], begins[i])
            self._add("duty_time", j, {"on": (slice(None), np.maximum(overlap, 0.0))}, most + slack)

    def _min_off(self, mean: Mean, j: int) -> None:
        N = len(mean.on)
        last = np.minimum(np.arange(N) + self._counts.off[:, j], N)  # stops at e rest the sensor on e .. last - 1
        resting = np.zeros(N + 1)
        np.add.at(resting, np.arange(N), mean.stops[:, j])
        np.add.at(resting, last, -mean.stops[:, j])
        excess = np.cumsum(resting)[:N] + mean.on[:, j] - 1.0
        for k in self._worst("min_off", j, excess):
            stops = np.flatnonzero((np.arange(N) <= k) & (last > k))
            self._add("min_off", j, {"stop": (stops, 1.0), "on": (np.array([k]), 1.0)}, 1.0)

    def _revisit(self, mean: Mean, j: int) -> None:
        N, gap = len(mean.on), self._counts.gap[:, j]
        ends = np.arange(N) + gap
        inside = (gap != NEVER) & (ends <= N)
        used = np.concatenate([[0.0], np.cumsum(mean.on[:, j])])
        lacking = np.where(inside, 1.0 - (used[np.where(inside, ends, 0)] - used[:N]), -1.0)
        for a in self._worst("revisit", j, lacking):
            self._add("revisit", j, {"on": (slice(a, int(ends[a])), -1.0)}, -1.0)


def priced(rows: list[Row], multipliers: np.ndarray, intervals: int, sensors: int) -> tuple[Prices, float]:
    """The prices that rows with multipliers (R,) make, and the sum of multiplier times limit."""
    total = Prices.none(intervals, sensors)
    for row, mu in zip(rows, multipliers, strict=True):
        if mu > 0:
            for sums, part in ((total.on, row.u.on), (total.start, row.u.start), (total.stop, row.u.stop)):
                sums += mu * part
    return total, float(sum(mu * row.limit for row, mu in zip(rows, multipliers, strict=True)))

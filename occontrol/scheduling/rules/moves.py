"""Better schedules from a good one: whole blocks of it are moved, on the true cost, as long as that helps.

A schedule is a list of segments (set of sensors, end); a segment begins where the one before it ends, after the delay
between them. Moves shift an end, drop a segment to either side or between both, give a segment to another set, swap
two neighbours, and insert a segment where the gradient promises most. What breaks a rule is not scored.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.scheduling.rules.block_cost import BlockCost
from occontrol.scheduling.rules.check import RELATIVE as RELATIVE_CAP
from occontrol.scheduling.rules.check import keeps, segments, switching_cost, uses
from occontrol.scheduling.rules.grid import counts
from occontrol.scheduling.rules.plan import Plan
from occontrol.scheduling.rules.task import Task

SHIFTS = (1, 2, 3, 5, 8, 13, 21, 34)
INSERTED = 12  # places at which a segment is tried
TOGETHER = 40  # moves that are made at once where they do not touch
RELATIVE = 1e-12
Segments = tuple[tuple[int, int], ...]


@dataclass
class Scored:
    """A schedule and what it costs.

    Parameters
    ----------
    plan : Plan
    value : F
    settled : whether no move betters it
    """

    plan: Plan
    value: float
    settled: bool = False


class Mover:
    """Moves on the schedules of one task.

    Parameters
    ----------
    task : Task
    """

    def __init__(self, task: Task):
        self.task, self.rules = task, task.rules
        sets = task.oracle.sets
        self.slews = task.rules.select == 1
        self._delayed = self.slews and task.rules.slews()
        self.labels = [g for g in range(len(sets)) if not self.slews or np.any(sets[g])]
        self._label = {sets[g].tobytes(): g for g in range(len(sets))}
        self._counts = counts(task.rules, task.oracle.grid)
        self._warmers = [int(j) for j in np.flatnonzero(task.rules.warm_up > 0)]
        self._costs = BlockCost(task.sweep)
        upper = task.oracle.open
        group = task.oracle.group
        self._open = np.zeros((len(upper), len(sets)), dtype=bool)
        for g in range(len(sets)):
            self._open[:, g] = np.any(upper[:, group == g], axis=1)
        shortest = int(np.min(self._counts.need, where=self._counts.need > 1, initial=len(task.edges)))
        self._dwell = shortest if shortest < len(task.edges) else max(1, len(task.edges) // 100)
        self.evaluations = 0

    def segments(self, on: np.ndarray) -> Segments:
        """The segments of the schedule `on` (N, M)."""
        found = []
        for a, b in segments(on):
            label = self._label.get(on[a].tobytes())
            if label is not None and label in self.labels:
                found.append((label, b))
        return tuple(found)

    def on(self, chosen: Segments) -> np.ndarray | None:
        """(N, M) of segments; None where they do not fit or a window is closed."""
        sets, N = self.task.oracle.sets, self.task.oracle.grid.intervals
        on = np.zeros((N, self.rules.sensors), dtype=bool)
        begin, old = 0, None
        if self.rules.before is not None:
            old = self.rules.before[0]
        for label, end in chosen:
            if self._delayed:
                new = int(np.flatnonzero(sets[label])[0])
                if old is not None and old != new:
                    if begin >= N:
                        return None
                    begin += int(self._counts.delay[begin, old, new])
                old = new
            if not begin < end <= N or not np.all(self._open[begin:end, label]):
                return None
            on[begin:end] = sets[label]
            begin = end
        return on if begin == N else None

    def weights(self, on: np.ndarray) -> np.ndarray:
        """The weights (N, C) of the recursion's columns for the schedule `on` (N, M)."""
        rules, M = self.rules, self.rules.sensors
        weights = np.zeros((len(on), M + len(self._warmers)))
        weights[:, :M] = on
        if rules.select > 1 and np.any(rules.idle):
            weights[:, int(np.flatnonzero(rules.idle)[0])] = rules.select - np.sum(on, axis=1)
        for i, j in enumerate(self._warmers):
            for a, b in uses(on[:, j]):
                if a == 0 and rules.before is not None and rules.before[0] == j:
                    continue
                until = min(b, a + int(self._counts.warm[a, j]))
                weights[a:until, M + i], weights[a:until, j] = 1.0, 0.0
        return weights

    def value(self, on: np.ndarray) -> float:
        """F of the schedule `on` (N, M), inf where it breaks a rule."""
        task, rules = self.task, self.rules
        spent = float(np.vdot(task.spend, on))
        if spent > rules.max_observation * (1 + RELATIVE_CAP):
            return np.inf
        switching = task.oracle.switching(on)
        if np.isinf(switching) or (not (task.complete and np.isfinite(switching)) and not keeps(rules, task.edges, on)):
            return np.inf
        self.evaluations += 1
        weights = self.weights(on)
        linear, error = task.true_parts(weights) if task.model is not None else self._parts(weights)
        if error > rules.max_error * (1 + RELATIVE_CAP):
            return np.inf
        changing = switching if np.isfinite(switching) else switching_cost(rules, on)
        return task.goal.observation * linear + task.goal.error * error + changing

    def _parts(self, weights: np.ndarray) -> tuple[float, float]:
        """As those of the task, soon where little differs from the schedule whose promise was asked for last."""
        linear = float(np.vdot(self.task.price, weights))
        return linear, self._costs.value(weights) - linear

    def moves(self, chosen: Segments, promise: np.ndarray) -> Iterator[Segments]:
        """Segments that differ by one move.

        Parameters
        ----------
        chosen : Segments
        promise : (N, G) what an interval with a set costs to first order
        """
        count = len(chosen)
        for i in range(count - 1):
            label, end = chosen[i]
            for d in SHIFTS:
                for e in (end - d, end + d):
                    yield (*chosen[:i], (label, e), *chosen[i + 1 :])
        for i in range(count):
            label, end = chosen[i]
            begin = chosen[i - 1][1] if i else 0
            if i:
                for e in {end, (begin + end) // 2}:
                    yield (*chosen[: i - 1], (chosen[i - 1][0], e), *chosen[i + 1 :])
            if i < count - 1:
                yield (*chosen[:i], *chosen[i + 1 :])
                swapped = ((chosen[i + 1][0], begin + chosen[i + 1][1] - end), (label, chosen[i + 1][1]))
                yield (*chosen[:i], *swapped, *chosen[i + 2 :])
            for other in self.labels:
                if other != label:
                    yield (*chosen[:i], (other, end), *chosen[i + 1 :])
        yield from self._insertions(chosen, promise)

    def _insertions(self, chosen: Segments, promise: np.ndarray) -> Iterator[Segments]:
        N = len(promise)
        current = np.repeat([label for label, _ in chosen], np.diff([0, *(end for _, end in chosen)]))
        gain = promise - promise[np.arange(N), current][:, None]
        sums = np.concatenate([np.zeros((1, gain.shape[1])), np.cumsum(np.where(self._open, gain, 1e9), axis=0)])
        found = []
        for length in sorted({min(self._dwell * f, N) for f in (1, 2, 4)}):
            saved = sums[length:] - sums[:-length]
            for label in self.labels:
                order = np.argsort(saved[:, label], kind="stable")[:INSERTED]
                found += [(float(saved[a, label]), label, int(a), int(a) + length) for a in order]
        for _, label, a, b in sorted(found)[: 3 * INSERTED]:
            plain = self._put(chosen, label, a, b)
            yield plain
            if self.rules.max_switches is not None:
                for i in range(len(plain)):
                    if i < len(plain) - 1:
                        yield (*plain[:i], *plain[i + 1 :])
                    if i:
                        yield (*plain[: i - 1], (plain[i - 1][0], plain[i][1]), *plain[i + 1 :])

    @staticmethod
    def _put(chosen: Segments, label: int, a: int, b: int) -> Segments:
        result, begin = [], 0
        for old, end in chosen:
            if begin < min(end, a):
                result.append((old, min(end, a)))
            if begin <= a < end:
                result.append((label, b))
            if max(begin, b) < end:
                result.append((old, end))
            begin = end
        return tuple(result)

    def improve(self, start: Scored, budget: int, monitor: Monitor) -> Scored:
        """The schedule that the moves end at.

        Parameters
        ----------
        start : a schedule that keeps the rules
        budget : evaluations of the true cost
        monitor : Monitor
        """
        on, best = start.plan.on, start.value
        spent, seen = self.evaluations, set()
        improved = True
        while improved and self.evaluations - spent < budget and not monitor.stop:
            improved = False
            chosen = self._merged(self.segments(on))
            promise = self._promise(on)
            found: list[tuple[float, Segments]] = []
            reached: dict[Segments, np.ndarray] = {}
            for trial in self.moves(chosen, promise):
                trial = self._merged(trial)
                if trial in seen or any(trial[i][1] >= trial[i + 1][1] for i in range(len(trial) - 1)):
                    continue
                seen.add(trial)
                other = self.on(trial)
                if other is None:
                    continue
                value = self.value(other)
                if value < best - RELATIVE * abs(best):
                    found.append((value, trial))
                    reached[trial] = other
                if self.evaluations - spent >= budget or monitor.stop:
                    break
            if found:
                value, trial = min(found)
                base, others = self.on(chosen), [reached[t] for _, t in sorted(found)[1:TOGETHER]]
                on, best, improved = reached[trial], value, True
                if base is not None:
                    on, best = self._together(base, on, best, others)
        plan = start.plan if best >= start.value else self.task.oracle.follow(on)
        if plan is None or plan is start.plan:
            start.settled |= not improved
            return start
        # a plain sweep has the last word: what blocks cost has been found by another sequence of roundings
        value = self.task.value(plan)
        return Scored(plan, value, not improved) if value < start.value else start

    def _together(
        self, base: np.ndarray, on: np.ndarray, best: float, others: list[np.ndarray]
    ) -> tuple[np.ndarray, float]:
        """The best move from `base`, `on`, with `others` that do not touch it."""
        for other in others:
            changed = np.any(other != base, axis=1)
            if np.any(changed & np.any(on != base, axis=1)):
                continue
            both = np.where(changed[:, None], other, on)
            value = self.value(both)
            if value < best:
                on, best = both, value
        return on, best

    def _promise(self, on: np.ndarray) -> np.ndarray:
        """(N, G) what a set of sensors costs on an interval to first order."""
        task = self.task
        g = self._costs.begin(self.weights(on)) - task.price
        slope = task.goal.observation * task.price + max(task.goal.error, 1e-3) * g
        return slope[:, : self.rules.sensors] @ task.oracle.sets.T.astype(float)

    @staticmethod
    def _merged(chosen: Segments) -> Segments:
        """Without neighbours of the same set."""
        return tuple(s for i, s in enumerate(chosen) if i == len(chosen) - 1 or chosen[i + 1][0] != s[0])

"""Schedules that use up a cap: polished at its price, then bettered by exchanges that keep it, on the true cost.

An exchange uses sensor e instead of j on interval k. One alone is taken where it lowers F and the cap has room for it;
two together where the first buys with the cap what the second gives back. What they do is foreseen to first order and
then counted on the true cost. Where rules bind intervals together, blocks are moved at the price instead.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.scheduling.feasible_set import FeasibleSet
from occontrol.scheduling.hminimal import polish
from occontrol.scheduling.rounding import roundings
from occontrol.scheduling.rules.caps import priced, spend_of_columns
from occontrol.scheduling.rules.check import RELATIVE
from occontrol.scheduling.rules.moves import Mover, Scored
from occontrol.scheduling.rules.plan import Plan
from occontrol.scheduling.rules.pricing import Priced, begin_at, price_of
from occontrol.scheduling.rules.task import Task
from occontrol.scheduling.rules.tree import Begun, Search
from occontrol.scheduling.sweep import Sweep

CHEAPEST = 0.9  # times the price: what surely uses more than the cap
DEARER = (1.0, 1.02, 1.06, 1.15, 1.4)  # times the price: the dearer, the less of the cap is used
BETTERED = 3  # schedules that are bettered
TRIED = 100  # exchanges, pairs and swaps that are counted before one gives up
SIDES = 80  # single exchanges of either sign of which pairs are made
EVALUATIONS = 3000
POLISHED = 60  # rounds
IMPROVED = 3  # schedules that the hull met which are moved at the price


@dataclass(frozen=True, eq=False)
class _At:
    """A schedule (N, C) with F and what it uses of the cap."""

    weights: np.ndarray
    value: float
    used: float


def with_cap(
    task: Task, found: Priced, allowed: FeasibleSet, plans: list[Plan], moves: int, monitor: Monitor
) -> list[Plan]:
    """Schedules of a task with one cap that use little more than it, or keep it.

    Parameters
    ----------
    task : with the cap
    found : Priced of it
    allowed : FeasibleSet without rules, of the recursion's columns
    plans : that the search for the price met
    moves : evaluations of block moves, where other rules bind the intervals together
    monitor : Monitor
    """
    if not found.plain:
        return _moved(task, found, plans, moves, monitor)
    exchanges = _Exchanges(task, found.cap, allowed, monitor)
    results, low, factors = [], CHEAPEST, list(DEARER)
    while factors and not monitor.stop:
        factor = factors.pop(0)
        at = exchanges.at(_polished(task, found, factor, allowed, monitor))
        kept = exchanges.kept(at)
        results += [] if kept is None else [kept]
        if at.used > exchanges.limit:
            low = factor
        elif factor > low:
            # the price at which the cap is just kept: schedules jump, so both sides of it are worth a look
            factors = [0.5 * (low + factor)] if factor - low > 2e-3 else []
        else:
            break
    done = [exchanges.bettered(at) for at in sorted(results, key=lambda at: at.value)[:BETTERED]]
    followed = [task.oracle.follow(_on(task, at.weights)) for at in done]
    return [plan for plan in followed if plan is not None]


def begun_at_price(search: Search, cap: str, start: np.ndarray, allowed: FeasibleSet) -> Begun | None:
    """Where a search with one cap begins: at its price, with schedules that keep it; None where nothing has a price.

    Parameters
    ----------
    search : of a task with the cap, which scores what is found
    cap : "max_observation" or "max_error"
    start : (N, C) policy to begin at
    allowed : FeasibleSet without rules
    """
    task, plans = search.task, []

    def seen(plan: Plan) -> None:
        plans.append(plan)
        search.score(plan, improve=False)

    found = price_of(task, cap, start, allowed, seen, search.monitor)
    if found is None:
        return None
    for plan in with_cap(task, found, allowed, plans, search.options.moves, search.monitor):
        search.score(plan)
    weights, multipliers, columns = begin_at(task, found, search.rows)
    return Begun(found.mixture, multipliers, columns, (weights, multipliers, found.best.bound), found.value)


def _on(task: Task, weights: np.ndarray) -> np.ndarray:
    """(N, M) what is on in a schedule (N, C); idle counts where one sensor is used at a time."""
    on = weights[:, : task.rules.sensors] > 0.5
    if task.rules.select > 1:
        on[:, task.rules.idle] = False
    return on


def _moved(task: Task, found: Priced, plans: list[Plan], moves: int, monitor: Monitor) -> list[Plan]:
    """The best schedules at the price and at dearer ones, their blocks moved."""
    results = []
    for factor in DEARER:
        problem = priced(task, found.cap, factor * found.best.price)
        mover = Mover(problem)
        scored = sorted((Scored(plan, problem.value(plan)) for plan in plans), key=lambda s: s.value)
        best = [mover.improve(s, moves // IMPROVED, monitor) for s in scored[:IMPROVED] if np.isfinite(s.value)]
        results += [s.plan for s in best]
        if any(np.isfinite(task.value(s.plan)) for s in best) or monitor.stop:
            break
    return results


def _polished(task: Task, found: Priced, factor: float, allowed: FeasibleSet, monitor: Monitor) -> np.ndarray:
    """The best rounding (N, C) of the mixture, polished with the cap at `factor` times its price."""
    problem = priced(task, found.cap, factor * found.best.price)
    r, share = problem.sweep.recursion, problem.goal.error
    if problem.model is not None:
        return min(roundings(found.mixture, allowed), key=problem.model.true_cost)
    # F over the factor of the error is the cost of a recursion, for which exchanges are foreseen exactly
    sweep = Sweep(replace(r, cost=r.cost / share)) if share > 0 else Sweep(r)
    start = min(roundings(found.mixture, allowed), key=sweep.cost)
    return start if r.owner is not None else polish(sweep, allowed, start, POLISHED, monitor).weights


class _Exchanges:
    """Exchanges on one interval, or on two at once, that keep the cap of a task."""

    def __init__(self, task: Task, cap: str, allowed: FeasibleSet, monitor: Monitor):
        self.task, self.cap, self.allowed, self.monitor = task, cap, allowed, monitor
        self.spend = spend_of_columns(task)
        self.limit = float(getattr(task.rules, cap)) * (1 + RELATIVE)
        self.spent = 0

    def at(self, weights: np.ndarray) -> _At:
        """F and use of a schedule (N, C)."""
        self.spent += 1
        goal = self.task.goal
        linear, error = self.task.true_parts(weights)
        used = float(np.vdot(self.spend, weights)) if self.cap == "max_observation" else error
        return _At(weights, goal.observation * linear + goal.error * error, used)

    @property
    def over(self) -> bool:
        """Whether enough has been tried."""
        return self.spent >= EVALUATIONS or self.monitor.stop

    def _foreseen(self, at: _At) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(E, 3) exchanges (k, j, e), and to first order what each does to F and to the use, (E,) both."""
        task = self.task
        _, g = task.sweep.cost_and_gradient(at.weights)
        slope = g - task.price
        value = task.goal.observation * task.price + task.goal.error * slope
        used = self.spend if self.cap == "max_observation" else slope
        leaves, enters = self.allowed.exchange_masks(at.weights)
        k, j, e = np.nonzero(leaves[:, :, None] & enters[:, None, :] & ~np.eye(leaves.shape[1], dtype=bool))
        return np.stack([k, j, e], axis=1), value[k, e] - value[k, j], used[k, e] - used[k, j]

    @staticmethod
    def _exchanged(at: _At, chosen: np.ndarray) -> np.ndarray:
        weights = at.weights.copy()
        for k, j, e in chosen:
            weights[k, j] -= 1.0
            weights[k, e] += 1.0
        return weights

    def kept(self, at: _At) -> _At | None:
        """The schedule made to keep the cap by exchanges that give back most for what they cost; None if none do."""
        while at.used > self.limit:
            moves, value, used = self._foreseen(at)
            back = np.flatnonzero(used < 0)
            if not len(back) or self.over:
                return None
            order = back[np.argsort(value[back] / -used[back], kind="stable")]
            better = None
            # as many at once as still leave it above, then one by one
            for count in (16, 4, 1):
                several = self._apart(moves, order[: 4 * count])[:count]
                trial = self.at(self._exchanged(at, moves[several]))
                if trial.used < at.used and (trial.used > self.limit or count == 1):
                    better = trial
                    break
            if better is None:
                return None
            at = better
        return at

    @staticmethod
    def _apart(moves: np.ndarray, order: np.ndarray) -> np.ndarray:
        """The first exchange of every interval among those of `order`."""
        _, first = np.unique(moves[order, 0], return_index=True)
        return order[np.sort(first)]

    def bettered(self, at: _At) -> _At:
        """The schedule at which no exchange that was tried helps any more."""
        while not self.over:
            better = self._better(at)
            if better is None:
                return at
            at = better
        return at

    def _better(self, at: _At) -> _At | None:
        moves, value, used = self._foreseen(at)
        room = self.limit - at.used
        single = np.flatnonzero((value < 0) & (used <= room))
        single = single[np.argsort(value[single], kind="stable")][:TRIED]
        for chosen in (*([i] for i in single), *self._pairs(moves, value, used, room)):
            trial = self.at(self._exchanged(at, moves[list(chosen)]))
            if trial.used <= self.limit and trial.value < at.value * (1 - 1e-12 * np.sign(at.value)):
                return trial
            if self.over:
                return None
        return None

    @staticmethod
    def _pairs(moves: np.ndarray, value: np.ndarray, used: np.ndarray, room: float) -> list[tuple[int, int]]:
        """Pairs of exchanges, one of which lowers F, that lower F together and have room: best first.

        The pairs are made of one that uses more and one that gives back, and of neighbours that change places.
        """
        buys, gives = np.flatnonzero((value < 0) & (used > 0)), np.flatnonzero((value > 0) & (used < 0))
        buys = buys[np.argsort(value[buys] / used[buys], kind="stable")][:SIDES]
        gives = gives[np.argsort(value[gives] / -used[gives], kind="stable")][:SIDES]
        change, more = value[buys][:, None] + value[gives], used[buys][:, None] + used[gives]
        good = (change < 0) & (more <= room) & (moves[buys, 0][:, None] != moves[gives, 0])
        i, j = np.nonzero(good)
        found = list(zip(change[i, j].tolist(), buys[i].tolist(), gives[j].tolist(), strict=True))
        place = {(int(k), int(a), int(b)): x for x, (k, a, b) in enumerate(moves)}
        for (k, a, b), x in place.items():
            y = place.get((k + 1, b, a))
            if y is not None and value[x] + value[y] < 0 and used[x] + used[y] <= room:
                found.append((float(value[x] + value[y]), x, y))
        return [(x, y) for _, x, y in sorted(found)[:TRIED]]

"""Bounds of many nodes from few sweeps: tangents of F that were ever taken hold for every node.

For weights mu of tangents l_i(w) = F(v_i) + g_i.(w - v_i), F convex, and every schedule w of a node

    F(w) + switching(w) >= sum_i mu_i (F(v_i) - g_i.v_i) + min over w of [ sum_i mu_i g_i.w + switching(w) ]

The oracle has the minimum. Which weights are best follows from the schedules that are known: a matrix game. Its other
side is a mixture, at which the next tangent is taken. (Cutting planes, Kelley 1960, on the hull of columns; the next
point lies between the mixture of the game and the best one met: Ben-Ameur and Neto 2007.)
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import njit

from occontrol.core.monitor import Monitor
from occontrol.scheduling.rules.game import play
from occontrol.scheduling.rules.hull import Hull, HullOptions
from occontrol.scheduling.rules.master import Multipliers, Tangent
from occontrol.scheduling.rules.plan import Plan
from occontrol.scheduling.rules.task import Task

TANGENTS, PLANS = 60, 120  # that are kept
LEFT = 0.6  # of what a node lacks of the best schedule: what its own gap may be when it is left
BALANCE = 0.5  # of a node's gap: what columns may lack before they are worth more than tangents
TOWARDS = 0.5  # of the way from the best mixture to that of the game
FEW = 10  # rounds without a better bound after which a node is left


class Bundle:
    """Tangents and schedules of one task, and the value of every tangent at every schedule.

    Parameters
    ----------
    task : without caps and priced rows
    """

    def __init__(self, task: Task):
        self.task = task
        N, C = task.oracle.shape
        self.plans: list[Plan] = []
        self._keys: set[bytes] = set()
        self._clock = self._tangents = 0
        # rooms for tangents and schedules, doubled where they are full
        rooms = 64
        self._constant, self._used, self._slope = np.empty(rooms), np.empty(rooms), np.empty((rooms, N * C))
        self._actions, self._met = np.empty((rooms, N), dtype=np.int64), np.empty(rooms)
        self._value, self._switching = np.empty((rooms, rooms)), np.empty(rooms)

    @property
    def value(self) -> np.ndarray:
        """(I, P) of every tangent at every schedule."""
        return self._value[: self._tangents, : len(self.plans)]

    def take(self, at: Tangent) -> None:
        """Add a tangent."""
        task, goal, i, P = self.task, self.task.goal, self._tangents, len(self.plans)
        if i == len(self._constant):
            self._constant, self._used, self._slope, self._value = (
                _doubled(x) for x in (self._constant, self._used, self._slope, self._value)
            )
        g = goal.observation * task.price + goal.error * at.slope
        self._constant[i] = goal.observation * at.linear + goal.error * at.error - float(np.vdot(g, at.weights))
        self._slope[i], self._used[i] = g.ravel(), self._clock
        worth = g @ task.oracle.automaton.columns.T
        _gathered(worth, self._actions[:P], self._value[i, :P])
        self._value[i, :P] += self._constant[i] + self._switching[:P]
        self._tangents += 1

    def add(self, plan: Plan) -> bool:
        """Add a schedule; whether it is new."""
        if plan.key in self._keys:
            return False
        p, count = len(self.plans), self._tangents
        if p == len(self._met):
            self._met, self._actions = _doubled(self._met), _doubled(self._actions)
            self._switching = _doubled(self._switching)
            self._value = np.concatenate([self._value, np.empty_like(self._value)], axis=1)
        self._keys.add(plan.key)
        self.plans.append(plan)
        self._actions[p], self._met[p], self._switching[p] = plan.actions, self._clock, plan.switching
        self._value[:count, p] = self._constant[:count] + self._slope[:count] @ plan.weights.ravel() + plan.switching
        return True

    def tidy(self) -> None:
        """Forget what was of no use for longest."""
        self._clock += 1
        count, P = self._tangents, len(self.plans)
        if count > TANGENTS:
            kept = np.sort(np.argsort(-self._used[:count], kind="stable")[: TANGENTS * 3 // 4])
            for x in (self._constant, self._used, self._slope, self._value):
                x[: len(kept)] = x[kept]
            self._tangents = len(kept)
        if P > PLANS:
            kept = np.sort(np.argsort(-self._met[:P], kind="stable")[: PLANS * 3 // 4])
            for x in (self._met, self._actions, self._switching, self._value.T):
                x[: len(kept)] = x[kept]
            self.plans = [self.plans[i] for i in kept]
            self._keys = {plan.key for plan in self.plans}

    def inside(self, mask: np.ndarray) -> np.ndarray:
        """Which schedules a mask (N, A) allows."""
        return np.flatnonzero(np.all(mask[np.arange(len(mask)), self._actions[: len(self.plans)]], axis=1))

    def best(self, chosen: np.ndarray) -> tuple[np.ndarray, float, np.ndarray, float]:
        """Shares of the `chosen` (Q,) schedules, and constant, gradient (N, C) and value of the best line for them."""
        shares, weights, value = play(self.value[:, chosen])
        held = np.flatnonzero(weights > 0)
        self._used[held] = self._met[chosen[shares > 0]] = self._clock
        g = (weights[held] @ self._slope[held]).reshape(self.task.oracle.shape)
        return shares, float(weights[held] @ self._constant[held]), g, value

    def newest(self) -> tuple[float, np.ndarray]:
        """Constant and gradient (N, C) of the last tangent."""
        i = self._tangents - 1
        return float(self._constant[i]), self._slope[i].reshape(self.task.oracle.shape).copy()

    def mixture(self, chosen: np.ndarray, shares: np.ndarray) -> tuple[np.ndarray, float]:
        """The policy (N, C) of `shares` (Q,) of the `chosen` (Q,) schedules, and what its changes cost on average."""
        held = [(self.plans[i], s) for i, s in zip(chosen, shares, strict=True) if s > 0]
        return sum(s * plan.weights for plan, s in held), float(sum(s * plan.switching for plan, s in held))  # type: ignore[return-value]


@njit(cache=True, nogil=True)
def _gathered(worth, actions, found):
    """found[p] = sum over k of worth[k, actions[p, k]]"""
    for p in range(actions.shape[0]):
        total = 0.0
        for k in range(actions.shape[1]):
            total += worth[k, actions[p, k]]
        found[p] = total


def _doubled(x: np.ndarray) -> np.ndarray:
    return np.concatenate([x, np.empty_like(x)])


def solve(
    bundle: Bundle, mask: np.ndarray, options: HullOptions, seen: Callable[[Plan], None], monitor: Monitor
) -> Hull:
    """The hull of a node by the tangents that are known, and as many more as it takes.

    Parameters
    ----------
    bundle : Bundle, which grows
    mask : (N, A) allowed actions
    options : HullOptions
    seen : called with every new plan of the oracle
    monitor : Monitor
    """
    task = bundle.task
    bundle.tidy()
    found = Hull(-np.inf, None, None, Multipliers(np.empty(0)))  # type: ignore[arg-type]
    chosen, value, at, idle = bundle.inside(mask), np.inf, None, 0
    held: dict[bytes, float] = {}
    while True:
        found.rounds += 1
        if len(chosen):
            shares, constant, g, level = bundle.best(chosen)
        else:
            shares, level = np.empty(0), np.inf
            constant, g = bundle.newest()
        least, plan = task.oracle.minimise(g, None, mask)
        if plan is None:
            found.lower_bound = np.inf
            return found
        idle += 1
        if constant + least > found.lower_bound:
            idle = 0 if constant + least > found.lower_bound + 0.01 * (value - found.lower_bound) else idle
            found.lower_bound, found.line = constant + least, (constant, g)
        fresh = bundle.add(plan)
        if fresh:
            seen(plan)
            chosen = np.append(chosen, len(bundle.plans) - 1)
        cutoff = options.cutoff()
        missing = min(value, cutoff) - found.lower_bound
        if missing <= 0 or monitor.stop:
            break
        if np.isfinite(value):
            enough = max(options.gap * task.size(value), LEFT * (cutoff - value))
            if value - found.lower_bound <= enough or found.rounds >= options.most or idle > FEW:
                break
        if fresh and (not len(shares) or level - (constant + least) > BALANCE * missing):
            continue
        if not len(shares):
            shares = np.ones(len(chosen)) / len(chosen)
        shares = np.pad(shares, (0, len(chosen) - len(shares)))
        if at is not None:
            old = np.array([held.get(bundle.plans[i].key, 0.0) for i in chosen])
            shares = old + TOWARDS * (shares - old)
        policy, switching = bundle.mixture(chosen, shares)
        trial = Tangent.at(task, policy)
        bundle.take(trial)
        cost = task.goal.observation * trial.linear + task.goal.error * trial.error + switching
        if cost < value:
            value, at = cost, trial
            held = {bundle.plans[i].key: s for i, s in zip(chosen, shares, strict=True) if s > 0}
    found.plans = [bundle.plans[i] for i in chosen]
    found.shares = np.array([held.get(plan.key, 0.0) for plan in found.plans])
    return found

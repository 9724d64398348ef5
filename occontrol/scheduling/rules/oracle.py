"""The schedule that minimises a linear function, and changes, among all that keep the rules: a dynamic program.

min over w of  sum_k g_k.w_k + switching(w) + sum of prices on use, starts and stops
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from occontrol.scheduling.rules.builder import build
from occontrol.scheduling.rules.grid import Grid
from occontrol.scheduling.rules.kernels import along, cheapest, least_through, walk
from occontrol.scheduling.rules.plan import Plan
from occontrol.scheduling.rules.rules import Rules


@dataclass(frozen=True, eq=False)
class Prices:
    """What use, starts and stops cost beside the gradient, in units of the cost.

    Parameters
    ----------
    on, start, stop : (N, M)
    """

    on: np.ndarray
    start: np.ndarray
    stop: np.ndarray

    @classmethod
    def none(cls, intervals: int, sensors: int) -> Prices:
        """No price on anything."""
        return cls(*(np.zeros((intervals, sensors)) for _ in range(3)))

    def of(self, plan: Plan) -> float:
        """What a plan pays."""
        parts = ((self.on, plan.on), (self.start, plan.starts), (self.stop, plan.stops))
        return float(sum(np.vdot(price, what) for price, what in parts))


class Oracle:
    """Cheapest schedules among those that keep the rules which the automaton tracks.

    Parameters
    ----------
    rules : Rules
    edges : (N+1,) times of the decisions
    upper : (N, M) positive where a sensor may be used

    Raises TooManyStates where the rules need more states than it can hold, ValueError for too many sets of sensors.
    """

    def __init__(self, rules: Rules, edges: np.ndarray, upper: np.ndarray):
        self.rules, self.grid = rules, Grid(edges)
        a = self.automaton = build(rules, self.grid)
        N = self.grid.intervals
        closed = (np.asarray(upper) <= 0.0).astype(float)
        self.open = closed @ a.on.T.astype(float) == 0.0
        self._event_cost = np.array([e.cost for e in a.events])
        started, stopped = np.zeros((2, len(a.events), rules.sensors))
        for i, event in enumerate(a.events):
            started[i, list(event.started)] = 1.0
            stopped[i, list(event.stopped)] = 1.0
        self._started, self._stopped = started, stopped
        self._value = np.empty((N + 1, a.states))
        self._before = np.empty((N + 1, a.states), dtype=np.int64)
        # sets of sensors in use, by which one branches: actions that differ in warming only belong together
        self.sets, self.group = np.unique(a.on, axis=0, return_inverse=True)
        self.group = self.group.ravel()
        self._label = {chosen.tobytes(): g for g, chosen in enumerate(self.sets)}
        states = np.arange(a.states + 1)
        self._begin = np.array([f + np.searchsorted(a.tail[f:to], states) for f, to in pairwise(a.first.tolist())])

    def after(self, done: np.ndarray, upper: np.ndarray) -> Oracle:
        """The same rules where the first K intervals are over: cheapest among schedules that begin with what was done.

        Parameters
        ----------
        done : (K, M) whether a sensor was in use; 'idle' counts where select is 1
        upper : (N, M) positive where a sensor may be used from K on
        """
        other, past = copy(self), len(done)
        other.open = (np.asarray(upper) <= 0.0).astype(float) @ self.automaton.on.T.astype(float) == 0.0
        other.open[:past] = np.all(np.asarray(done)[:, None, :] == self.automaton.on[None], axis=2)
        return other

    @property
    def shape(self) -> tuple[int, int]:
        """(N, C) of the weights."""
        return self.grid.intervals, self.automaton.columns.shape[1]

    def _run(self, price: np.ndarray, entry: np.ndarray) -> tuple[float, int]:
        """The cheapest value at the end and the state of it."""
        a = self.automaton
        self._value[:] = np.inf
        self._value[0, a.start] = 0.0
        arrays = (a.table, a.first, a.tail, a.head, a.action, a.event)
        cheapest(*arrays, price, entry, self._value, self._before)
        ends = np.where(a.final, self._value[-1], np.inf)
        last = int(np.argmin(ends))
        return float(ends[last]), last

    def minimise(
        self, gradient: np.ndarray, prices: Prices | None = None, mask: np.ndarray | None = None
    ) -> tuple[float, Plan | None]:
        """The smallest value and a plan that has it; inf and None where no schedule keeps the rules.

        Parameters
        ----------
        gradient : (N, C) g
        prices : Prices, or None
        mask : (N, A) actions that are allowed beside what windows allow, or None for all
        """
        a, N = self.automaton, self.grid.intervals
        value, last = self._run(*self._costs(gradient, prices, mask))
        if not np.isfinite(value):
            return np.inf, None
        path = np.empty(N, dtype=np.int64)
        along(self._before, a.tail, last, path)
        return value, self.plan(path)

    def _costs(
        self, gradient: np.ndarray, prices: Prices | None, mask: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray]:
        """What actions (N, A) and events (N, V) cost."""
        a = self.automaton
        price = gradient @ a.columns.T
        entry = np.repeat(self._event_cost[None], self.grid.intervals, axis=0)
        if prices is not None:
            price = price + prices.on @ a.on.T
            entry += prices.start @ self._started.T + prices.stop @ self._stopped.T
        allowed = self.open if mask is None else self.open & mask
        return np.where(allowed, price, np.inf), entry

    def least_through(
        self, gradient: np.ndarray, prices: Prices | None = None, mask: np.ndarray | None = None
    ) -> np.ndarray:
        """(N, A) the smallest value of a schedule that does action a on interval k; inf where there is none.

        Parameters
        ----------
        gradient : (N, C) g
        prices : Prices, or None
        mask : (N, A) actions that are allowed beside what windows allow, or None for all
        """
        a, N = self.automaton, self.grid.intervals
        price, entry = self._costs(gradient, prices, mask)
        self._run(price, entry)
        rest, least = np.full_like(self._value, np.inf), np.full((N, a.actions), np.inf)
        rest[-1, a.final] = 0.0
        least_through(a.table, a.first, a.tail, a.head, a.action, a.event, price, entry, self._value, rest, least)
        return least

    def nearest(self, price: np.ndarray) -> Plan | None:
        """The plan whose actions cost least by price (N, A), whatever its changes cost; None where there is none."""
        a, N = self.automaton, self.grid.intervals
        value, last = self._run(np.where(self.open, price, np.inf), np.zeros((N, len(a.events))))
        if not np.isfinite(value):
            return None
        path = np.empty(N, dtype=np.int64)
        along(self._before, a.tail, last, path)
        return self.plan(path)

    def plan(self, path: np.ndarray) -> Plan:
        """The plan of a path of transitions (N,)."""
        a = self.automaton
        actions, events = a.action[path], a.event[path]
        starts, stops = self._started[events] > 0, self._stopped[events] > 0
        return Plan(actions, a.columns[actions], a.on[actions], starts, stops, float(np.sum(self._event_cost[events])))

    def follow(self, on: np.ndarray) -> Plan | None:
        """The plan that uses exactly the sensors `on` (N, M), or None where that breaks a rule which is tracked."""
        same = np.all(on[:, None, :] == self.automaton.on[None, :, :], axis=2)
        return self.minimise(np.zeros(self.shape), None, same)[1]

    def switching(self, on: np.ndarray) -> float:
        """What changes cost in the schedule that uses exactly the sensors `on` (N, M); inf where a tracked rule breaks.

        Windows are not looked at. NaN where the states cannot tell from the sensors alone: while one slews.
        """
        a, cuts = self.automaton, np.flatnonzero(np.any(on[1:] != on[:-1], axis=1)) + 1
        begins = [0, *cuts.tolist()]
        found = [self._label.get(on[b].tobytes(), -1) for b in begins]
        labels = np.repeat(np.array(found), np.diff([*begins, len(on)]))
        cost = self._event_cost[a.event]
        return walk(a.table, self._begin, a.head, self.group[a.action], cost, labels, a.start, a.final)

    def first_impossible(self) -> int | None:
        """The first interval that no schedule which keeps the rules reaches the end of, N where all fail at the end."""
        a, N = self.automaton, self.grid.intervals
        price = np.where(self.open, 0.0, np.inf)
        value, _ = self._run(price, np.zeros((N, len(a.events))))
        if np.isfinite(value):
            return None
        dead = ~np.any(np.isfinite(self._value), axis=1)
        return int(np.argmax(dead)) - 1 if np.any(dead) else N

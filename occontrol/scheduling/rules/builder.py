"""All schedules that keep the rules, as paths through states that say what is still owed.

A state at an edge holds, as numbers of intervals: for every sensor in use how long it must still last, may still last
and still warms up; for every other how long it must stay off and within how many intervals it must be used; and how
many changes and uses are left. A transition is what one interval does: which sensors are on, which of them only warm
up, which started and which stopped at its left edge. Transitions depend on the interval only through the numbers that
`grid.py` gives for its left edge, so intervals with equal numbers share one table.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from occontrol.scheduling.rules.automaton import Automaton, Event
from occontrol.scheduling.rules.grid import NEVER, Counts, Grid, counts, history
from occontrol.scheduling.rules.rules import Rules

MOST_STATES = 20_000
MOST_TRANSITIONS = 150_000  # of all tables together
MOST_WORK = 40_000_000  # transitions times intervals
OPTIONAL = ("revisit", "min_off", "max_uses")  # dropped in this order where there are too many states


class TooManyStates(Exception):
    """The rules need more states than the oracle can hold."""


class _State(NamedTuple):
    """on: (sensor, need, most, warm); off, gaps: (sensor, intervals); uses: left; slew: (sensor, intervals) or ()."""

    on: tuple = ()
    off: tuple = ()
    gaps: tuple = ()
    changes: int = 0
    uses: tuple = ()
    slew: tuple = ()
    begun: bool = True


def build(rules: Rules, grid: Grid) -> Automaton:
    """The automaton that keeps as many of the rules as fit; the others are for priced rows.

    Parameters
    ----------
    rules : Rules
    grid : Grid

    Raises TooManyStates where even the rules that cannot be priced do not fit.
    """
    dropped: set[str] = set()
    for drop in (*OPTIONAL, None):
        try:
            return _Builder(rules, grid, frozenset(OPTIONAL) - dropped).automaton()
        except TooManyStates:
            if drop is None:
                raise
            dropped.add(drop)
    raise TooManyStates


class _Builder:
    def __init__(self, rules: Rules, grid: Grid, optional: frozenset[str]):
        self.rules, self.grid, self.counts = rules, grid, counts(rules, grid)
        finite = {
            "max_uses": rules.reads is None and np.any(np.isfinite(rules.max_uses)),  # readings are counted by a row
            "min_off": np.any(rules.min_off > 0),
            "revisit": np.any(np.isfinite(rules.revisit)),
        }
        self.tracked = frozenset(name for name in optional if finite[name])
        times = np.any(rules.min_on > 0) or np.any(np.isfinite(rules.max_on)) or np.any(rules.warm_up > 0)
        changes = rules.max_switches is not None or rules.costs_changes() or rules.slews() or rules.before is not None
        # without any of these the intervals have nothing to do with each other
        self.linked = bool(times or changes or finite["max_uses"] or finite["min_off"])
        self.sets = rules.sets
        self.warmers = [int(j) for j in np.flatnonzero(rules.warm_up > 0)]
        self.revisited = np.flatnonzero(np.isfinite(rules.revisit)) if "revisit" in self.tracked else np.empty(0, int)
        self.counted = np.flatnonzero(np.isfinite(rules.max_uses)) if "max_uses" in self.tracked else np.empty(0, int)
        self.actions: dict[tuple, int] = {}
        self.events: dict[Event, int] = {Event((), (), 0.0): 0}
        self.states: dict[_State, int] = {}

    def automaton(self) -> Automaton:
        table, places = self._tables()
        first, parts, total = [0], [], 0
        rows = [_Row(self.counts, k) for k in places]
        begin = self._begin()
        self._number(begin)
        expanded: dict[tuple[_State, int], list] = {}
        waiting = [begin]
        while waiting:
            state = waiting.pop()
            for t in range(len(places)):
                if not state.begun and t != table[0]:
                    continue
                found = expanded[state, t] = self._successors(state, rows[t])
                total += len(found)
                for _, _, after in found:
                    if after not in self.states:
                        self._number(after)
                        waiting.append(after)
            if total > MOST_TRANSITIONS:
                raise TooManyStates
        by_table: list[list] = [[] for _ in places]
        for (state, t), found in expanded.items():
            tail = self.states[state]
            by_table[t] += [(tail, self.states[after], action, event) for action, event, after in found]
        for transitions in by_table:
            parts += sorted(transitions)
            first.append(len(parts))
        sizes = np.diff(first)[table]
        if int(np.sum(sizes)) > MOST_WORK or len(self.states) * self.grid.intervals > MOST_WORK / 4:
            raise TooManyStates
        tail, head, action, event = np.array(parts, dtype=np.int64).reshape(-1, 4).T.copy()
        on, columns = self._columns()
        final = np.array([self._may_end(state) for state in self.states])
        return Automaton(
            columns, on, tuple(self.events), table, np.array(first), tail, head, action, event,
            self.states[begin], final, self.tracked,
        )  # fmt: skip

    def _number(self, state: _State) -> None:
        if len(self.states) >= MOST_STATES:
            raise TooManyStates
        self.states[state] = len(self.states)

    def _tables(self) -> tuple[np.ndarray, list[int]]:
        """(N,) the table of every interval, and one interval of each table."""
        c, N = self.counts, self.grid.intervals
        if not self.linked and not len(self.revisited):
            return np.zeros(N, dtype=np.int64), [0]
        rows = np.column_stack([x.reshape(N, -1) for x in (c.need, c.most, c.off, c.warm, c.delay, c.gap)])
        _, places, table = np.unique(rows, axis=0, return_index=True, return_inverse=True)
        return table.ravel().astype(np.int64), [int(k) for k in places]

    def _begin(self) -> _State:
        uses = tuple(int(self.rules.max_uses[j]) for j in self.counted)
        gaps = tuple((int(j), int(self.counts.gap[0, j])) for j in self.revisited)
        changes = 0 if self.rules.max_switches is None else self.rules.max_switches
        past = history(self.rules, self.grid)
        if past is None:
            return _State(gaps=gaps, changes=changes, uses=uses, begun=False)
        on = ((past.sensor, past.need, past.most, 0),)
        return _State(on, (), gaps, changes, uses)

    def _may_end(self, state: _State) -> bool:
        if state.slew or not state.begun:
            return False
        return not (self.rules.enforce and any(need > 0 for _, need, _, _ in state.on))

    def _successors(self, state: _State, row: _Row) -> list[tuple[int, int, _State]]:
        rules, found = self.rules, []
        if state.slew:
            target, left = state.slew
            if left > 0:
                return self._slewing(state, row, Event((), (), 0.0), (target, left))
            after = self._used(state, row, (target,), (), (target,), 0.0, state.changes)
            return [] if after is None else [after]
        here = tuple(j for j, _, _, _ in state.on)
        owed = {j for j, need, _, _ in state.on if need > 0}
        for chosen in self.sets:
            if not self.linked:
                stopped: tuple = ()
                started: tuple = ()
            else:
                stopped = tuple(j for j in here if j not in chosen)
                started = tuple(j for j in chosen if j not in here)
            if any(j in owed for j in stopped):
                continue
            changed = state.begun and self.linked and (stopped or started)
            changes = state.changes
            if changed and rules.max_switches is not None:
                changes -= 1
                if changes < 0:
                    continue
            cost = self._price(stopped, started) if changed else 0.0
            if changed and rules.slews() and stopped and started:
                delay = int(row.delay[stopped[0], started[0]])
                if delay > 0:
                    found += self._slewing(state, row, Event(stopped, (), cost), (started[0], delay), changes)
                    continue
            after = self._used(state, row, chosen, stopped, started, cost, changes)
            found += [] if after is None else [after]
        return found

    def _price(self, stopped: tuple, started: tuple) -> float:
        rules = self.rules
        if rules.select > 1:
            return rules.start_cost * len(started)
        return float(rules.switch_cost[stopped[0], started[0]])

    def _slewing(self, state: _State, row: _Row, event: Event, slew: tuple, changes: int | None = None) -> list:
        """One interval without any sensor on the way to another."""
        target, left = slew
        aged = self._aged(state, row, (), event.stopped)
        if aged is None:
            return []
        off, gaps = aged
        changes = state.changes if changes is None else changes
        after = _State((), off, gaps, changes, state.uses, (target, left - 1))
        return [(self._action((), ()), self._event(event), after)]

    def _used(
        self, state: _State, row: _Row, chosen: tuple, stopped: tuple, started: tuple, cost: float, changes: int
    ) -> tuple[int, int, _State] | None:
        """One interval with the chosen sensors on; None where a rule forbids it."""
        known, resting = {j: rest for j, *rest in state.on}, dict(state.off)
        uses, on, warming = state.uses, [], []
        if any(resting.get(j, 0) > 0 for j in started):
            return None
        for j in chosen:
            if not self.linked:
                break
            if j in known:
                need, most, warm = known[j]
            else:
                need, most, warm = int(row.need[j]), int(row.most[j]), int(row.warm[j])
            if most <= 0:
                return None
            if warm > 0:
                warming.append(j)
            on.append((j, max(need - 1, 0), most if most == NEVER else most - 1, max(warm - 1, 0)))
        if uses and started:
            left = [n - (int(j) in started) for j, n in zip(self.counted, uses, strict=True)]
            if min(left) < 0:
                return None
            uses = tuple(left)
        aged = self._aged(state, row, chosen, stopped)
        if aged is None:
            return None
        off, gaps = aged
        after = _State(tuple(on), off, gaps, changes, uses)
        return self._action(chosen, tuple(warming)), self._event(Event(stopped, started, cost)), after

    def _aged(self, state: _State, row: _Row, chosen: tuple, stopped: tuple) -> tuple[tuple, tuple] | None:
        """Times off and gaps after one more interval; None where a gap becomes too long."""
        off: tuple = ()
        if "min_off" in self.tracked:
            rest = {j: n - 1 for j, n in state.off if n > 1}
            rest |= {j: int(row.off[j]) - 1 for j in stopped if row.off[j] > 1}
            off = tuple(sorted(rest.items()))
        gaps = []
        before = dict(state.gaps)
        for j in map(int, self.revisited):
            if j in chosen:
                continue
            left = before.get(j, int(row.gap[j]))
            if left != NEVER:
                left -= 1
                if left <= 0:
                    return None
            gaps.append((j, left))
        return off, tuple(gaps)

    def _action(self, on: tuple, warming: tuple) -> int:
        return self.actions.setdefault((on, warming), len(self.actions))

    def _event(self, event: Event) -> int:
        return self.events.setdefault(event, len(self.events))

    def _columns(self) -> tuple[np.ndarray, np.ndarray]:
        """(A, M) what is on, and (A, C) the weights of the recursion's columns."""
        M, rules = self.rules.sensors, self.rules
        on = np.zeros((len(self.actions), M), dtype=bool)
        columns = np.zeros((len(self.actions), M + len(self.warmers)))
        for (chosen, warming), a in self.actions.items():
            for j in chosen:
                on[a, j] = True
                columns[a, M + self.warmers.index(j) if j in warming else j] = 1.0
            if rules.select > 1 and np.any(rules.idle):
                columns[a, int(np.flatnonzero(rules.idle)[0])] = rules.select - len(chosen)
        return on, columns


class _Row:
    """The numbers of one edge."""

    def __init__(self, c: Counts, k: int):
        self.need, self.most, self.off, self.warm, self.delay, self.gap = (
            x[k] for x in (c.need, c.most, c.off, c.warm, c.delay, c.gap)
        )

"""The rules that a schedule has to keep, as data: which sensor how long, how often, in what order.

Times are real times; `grid.py` says what they become on edges. A sensor is in use on the intervals on which its weight
is 1; a use is a maximal run of them. With `select` = 1 every interval has one sensor ('idle' counts as one) or none
while slewing; with more, 'idle' only fills places and no rule is ever about it.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from itertools import combinations
from math import comb

import numpy as np

from occontrol.core.kinds import PlainDict

MOST_SETS = 400  # sets of sensors that may be in use together

EACH = {
    "min_on": 0.0,
    "max_on": np.inf,
    "min_off": 0.0,
    "warm_up": 0.0,
    "max_uses": np.inf,
    "max_time": np.inf,
    "duty_window": np.inf,
    "duty_time": np.inf,
    "revisit": np.inf,
}


@dataclass(frozen=True, eq=False)
class Rules:
    """What a schedule of M sensors has to keep.

    Parameters
    ----------
    names : (M,) of the sensors
    idle : (M,) whether a sensor is 'idle'
    select : how many are used at a time; with idle among several, up to so many
    min_on, max_on : (M,) shortest and longest use
    min_off : (M,) shortest time between the end of a use and the start of the next
    warm_up : (M,) time at the start of a use during which it is on and measures nothing
    max_uses : (M,) number of uses
    max_time : (M,) time in use in all
    duty_window, duty_time : (M,) at most so much time in use in every window of that length inside the horizon
    revisit : (M,) longest gap between uses, those at the start and at the end included
    max_switches : most changes of the set of sensors, None for any number
    switch_cost : (M, M) price of a change from i to j where select is 1
    start_cost : price of every start of a sensor but idle where select is above 1; start and end of the horizon are no
        change and cost nothing
    switch_delay : (M, M) time between the end of i and the start of j, in which nothing is measured; select 1 only
    before : (sensor, time) that has been on for that time when the horizon starts, or None
    enforce : whether the last uses must be long enough too; otherwise the end of the horizon may cut them
    max_observation : cap on the observation cost, int sum_j q_j v_j dt
    max_error : cap on what is left of the cost without observation and changes
    least : how many sensors at least, where idle may fill the other places
    reads : (N,) readings of every interval, which max_uses counts; None: it counts uses
    variable : what the times are called, "t" or "k"
    """

    names: tuple[str, ...]
    idle: np.ndarray
    select: int
    min_on: np.ndarray
    max_on: np.ndarray
    min_off: np.ndarray
    warm_up: np.ndarray
    max_uses: np.ndarray
    max_time: np.ndarray
    duty_window: np.ndarray
    duty_time: np.ndarray
    revisit: np.ndarray
    switch_cost: np.ndarray
    switch_delay: np.ndarray
    max_switches: int | None = None
    start_cost: float = 0.0
    before: tuple[int, float] | None = None
    enforce: bool = False
    max_observation: float = np.inf
    max_error: float = np.inf
    least: int = 0
    reads: np.ndarray | None = None
    variable: str = "t"

    @classmethod
    def none(cls, names: tuple[str, ...], idle: np.ndarray, select: int = 1) -> Rules:
        """No rule at all.

        Parameters
        ----------
        names : (M,) of the sensors
        idle : (M,) whether a sensor is 'idle'
        select : how many are used at a time
        """
        M = len(names)
        each: PlainDict = {name: np.full(M, value) for name, value in EACH.items()}
        idle = np.asarray(idle, dtype=bool)
        return cls(names, idle, select, **each, switch_cost=np.zeros((M, M)), switch_delay=np.zeros((M, M)))

    @property
    def sensors(self) -> int:
        """M"""
        return len(self.names)

    @property
    def sets(self) -> list[tuple[int, ...]]:
        """The sets of sensors that one interval may use, idle only where select is 1; slewing not among them.

        Raises ValueError where there are more than MOST_SETS.
        """
        if self.select == 1:
            return [(j,) for j in range(self.sensors)]
        real = [j for j in range(self.sensors) if not self.idle[j]]
        least = self.least if np.any(self.idle) else self.select
        sizes = range(least, min(self.select, len(real)) + 1)
        if sum(comb(len(real), size) for size in sizes) > MOST_SETS:
            raise ValueError(f"more than {MOST_SETS} sets of sensors")
        return [chosen for size in sizes for chosen in combinations(real, size)]

    def costs_changes(self) -> bool:
        """Whether a change costs anything."""
        return bool(np.any(self.switch_cost) or self.start_cost)

    def slews(self) -> bool:
        """Whether a change takes time."""
        return bool(np.any(self.switch_delay > 0))

    def stated(self) -> list[tuple[str, int | None]]:
        """(rule, sensor) of every limit that is stated, sensor None where it is about all of them."""
        found: list[tuple[str, int | None]] = []
        for name, default in EACH.items():
            if name != "duty_window":
                values = getattr(self, name)
                found += [(name, int(j)) for j in np.flatnonzero(values != default)]
        found += [("max_switches", None)] if self.max_switches is not None else []
        found += [("switch_delay", None)] if self.slews() else []
        found += [("before", None)] if self.before is not None else []
        found += [("after", None)] if self.enforce else []
        found += [(name, None) for name in ("max_observation", "max_error") if np.isfinite(getattr(self, name))]
        return found

    def without(self, rule: str, sensor: int | None = None) -> Rules:
        """The same with one limit taken away.

        Parameters
        ----------
        rule, sensor : as `stated` lists them
        """
        if sensor is not None:
            values = getattr(self, rule).copy()
            values[sensor] = EACH[rule]
            return replace(self, **{rule: values})
        values = {"switch_delay": np.zeros_like(self.switch_delay), "after": False}
        values |= {f.name: f.default for f in fields(self) if f.name in ("max_switches", "before")}
        values |= {"max_observation": np.inf, "max_error": np.inf}
        return replace(self, **{"enforce" if rule == "after" else rule: values[rule]})

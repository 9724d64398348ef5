"""Rules as a user states them, checked, and resolved to numbers for every sensor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np

from occontrol.core.errors import Collector, Mistake, suggest
from occontrol.core.kinds import Plain, PlainDict
from occontrol.core.sensor import Sensor
from occontrol.scheduling.rules.rules import EACH, Rules

SHARED = ("min_on", "min_off", "max_uses", "max_time", "max_share")
GOALS = ("cost", "error", "observation")
ABOVE = {"max_on", "revisit"}  # must be above 0, the others at least 0


@dataclass(frozen=True)
class SensorRules:
    """The rules of one sensor; None is left out.

    Parameters
    ----------
    min_on, max_on : shortest and longest use, time
    min_off : shortest time between two uses
    warm_up : time at the start of a use in which nothing is measured
    max_uses : number of uses
    max_time, max_share : time in use in all, and as a share of the horizon; the tighter one counts
    duty : (window, time): at most `time` in use in every window of that length
    revisit : longest time without use
    """

    min_on: float | None = None
    max_on: float | None = None
    min_off: float | None = None
    warm_up: float | None = None
    max_uses: int | None = None
    max_time: float | None = None
    max_share: float | None = None
    duty: tuple[float, float] | None = None
    revisit: float | None = None

    def document(self) -> PlainDict:
        """The keys of a sensor in a problem file."""
        found = {f.name: getattr(self, f.name) for f in fields(self) if getattr(self, f.name) is not None}
        if self.duty is not None:
            found["duty"] = {"window": self.duty[0], "time": self.duty[1]}
        return found


@dataclass(frozen=True)
class Constraints:
    """Rules and budgets of a schedule.

    Parameters
    ----------
    sensors : {name: SensorRules}
    min_on, min_off, max_uses, max_time, max_share : for every sensor but idle that does not state its own
    max_switches : most changes of the set of sensors in use
    switch_cost : price of a change, or {from: {to: price}}
    switch_delay : {from: {to: time}} in which nothing is measured
    before : "free", or (sensor, time) that it has been on when the horizon starts
    after : "free": the end may cut the last uses; "enforce": they must be long enough
    max_observation_cost : cap on int sum_j q_j v_j dt
    max_error : cap on tr(W Sigma(T)) and the running cost together
    """

    sensors: Mapping[str, SensorRules] = field(default_factory=dict)
    min_on: float | None = None
    min_off: float | None = None
    max_uses: int | None = None
    max_time: float | None = None
    max_share: float | None = None
    max_switches: int | None = None
    switch_cost: float | Mapping[str, Mapping[str, float]] | None = None
    switch_delay: Mapping[str, Mapping[str, float]] | None = None
    before: str | tuple[str, float] = "free"
    after: str = "free"
    max_observation_cost: float | None = None
    max_error: float | None = None

    @property
    def slews(self) -> bool:
        """Whether a change may take time."""
        return any(t > 0 for row in (self.switch_delay or {}).values() for t in row.values())

    def document(self) -> PlainDict:
        """The key `constraints` of a problem file."""
        names = [f.name for f in fields(self) if f.name not in ("sensors", "before")]
        found = {name: getattr(self, name) for name in names if getattr(self, name) is not None}
        before = self.before if isinstance(self.before, str) else {"sensor": self.before[0], "for": self.before[1]}
        return {name: _plain(value) for name, value in {**found, "before": before}.items()}


def _plain(value: Plain) -> Plain:
    return {k: _plain(v) for k, v in value.items()} if isinstance(value, Mapping) else value


def mistakes(rules: Constraints | None, minimise: str, sensors: Sequence[Sensor], select: int) -> list[Mistake]:
    """What is wrong with the rules of a problem, by their places in its file.

    Parameters
    ----------
    rules : Constraints, or None
    minimise : what is minimised
    sensors : of the problem
    select : how many at a time
    """
    found = Collector()
    where = ("objective", "minimise")
    if minimise not in GOALS:
        found.add(where, f"objective.minimise is '{minimise}'", suggest(minimise, GOALS))
    for goal, limit in (("error", "max_observation_cost"), ("observation", "max_error")):
        if minimise == goal and (rules is None or getattr(rules, limit) is None):
            found.add(where, f"minimise: {goal} needs constraints.{limit}", f"constraints: {{{limit}: ..}}")
    if rules is None:
        return found.mistakes
    names = [s.name for s in sensors]
    for name, own in rules.sensors.items():
        if name not in names:
            found.add(("constraints",), f"there are rules for '{name}', which is no sensor", suggest(name, names))
            continue
        _values(found, own, ("sensors", names.index(name)), f" of sensor '{name}'")
    _values(found, rules, ("constraints",), "")
    _tables(found, rules, names, select)
    if isinstance(rules.before, tuple):
        sensor, elapsed = rules.before
        place = ("constraints", "before")
        if sensor not in names:
            found.add((*place, "sensor"), f"there is no sensor '{sensor}'", suggest(sensor, names))
        if not _number(elapsed):
            found.add((*place, "for"), f"constraints.before.for is {elapsed}", "a time of at least 0")
        if select > 1:
            found.add(place, "before: {sensor, for} is not possible with select above 1", "before: free")
    return found.mistakes


def _values(found: Collector, rules: Constraints | SensorRules, place: tuple, of: str) -> None:
    for f in fields(rules):
        value, name = getattr(rules, f.name), f.name
        if value is None or isinstance(value, Mapping | str) or name == "before":
            continue
        if name == "duty":
            if not (_number(value[0]) and value[0] > 0 and _number(value[1])):
                found.add((*place, name), f"duty{of} is {list(value)}", "duty: {window: above 0, time: at least 0}")
        elif not _number(value) or (name in ABOVE and not value > 0) or (name == "max_share" and value > 1):
            hint = "at most 1" if name == "max_share" else "a number above 0" if name in ABOVE else "at least 0"
            found.add((*place, name), f"{name}{of} is {value}", hint)


def _number(value: float) -> bool:
    return bool(np.isfinite(value)) and value >= 0


def _tables(found: Collector, rules: Constraints, names: list[str], select: int) -> None:
    for key in ("switch_cost", "switch_delay"):
        table = getattr(rules, key)
        if not isinstance(table, Mapping):
            continue
        place = ("constraints", key)
        if select > 1:
            hint = "a number: it is charged for every sensor that starts" if key == "switch_cost" else "select: 1"
            found.add(place, f"{key} as a table is not possible with select above 1", hint)
        for one, row in table.items():
            for other, value in row.items():
                for name in (one, other):
                    if name not in names:
                        found.add((*place, one), f"there is no sensor '{name}'", suggest(name, names))
                if not _number(value):
                    found.add((*place, one, other), f"{key} from '{one}' to '{other}' is {value}", "at least 0")


def resolve(rules: Constraints | None, sensors: Sequence[Sensor], select: int, horizon: float) -> Rules:
    """The rules as numbers for every sensor.

    Parameters
    ----------
    rules : Constraints, or None
    sensors : of the problem
    select : how many at a time
    horizon : its length
    """
    names = tuple(s.name for s in sensors)
    idle = np.array([s.is_idle for s in sensors])
    plain = Rules.none(names, idle, select)
    if rules is None:
        return plain
    each = {name: getattr(plain, name).copy() for name in EACH}
    for j, name in enumerate(names):
        if idle[j]:
            continue
        own = rules.sensors.get(name, SensorRules())
        stated = {k: getattr(own, k) if getattr(own, k) is not None else getattr(rules, k, None) for k in _OWN}
        for key in ("min_on", "max_on", "min_off", "warm_up", "max_uses", "max_time", "revisit"):
            if stated[key] is not None:
                each[key][j] = stated[key]
        if stated["max_share"] is not None:
            each["max_time"][j] = min(each["max_time"][j], stated["max_share"] * horizon)
        if own.duty is not None:
            each["duty_window"][j], each["duty_time"][j] = own.duty
    more: PlainDict = {"max_switches": rules.max_switches, "enforce": rules.after == "enforce"}
    if isinstance(rules.switch_cost, Mapping):
        more["switch_cost"] = _table(rules.switch_cost, names)
    elif rules.switch_cost is not None:
        M = len(names)
        more["switch_cost"] = (rules.switch_cost if select == 1 else 0.0) * (1.0 - np.eye(M))
        more["start_cost"] = float(rules.switch_cost) if select > 1 else 0.0
    if rules.switch_delay is not None:
        more["switch_delay"] = _table(rules.switch_delay, names)
    if isinstance(rules.before, tuple):
        more["before"] = (names.index(rules.before[0]), float(rules.before[1]))
    for key, cap in (("max_observation", rules.max_observation_cost), ("max_error", rules.max_error)):
        if cap is not None:
            more[key] = float(cap)
    return replace(plain, **each, **more)


_OWN = [f.name for f in fields(SensorRules) if f.name != "duty"]


def _table(rows: Mapping[str, Mapping[str, float]], names: tuple[str, ...]) -> np.ndarray:
    """(M, M) of {from: {to: value}}; a missing pair is 0."""
    found = np.zeros((len(names), len(names)))
    for one, row in rows.items():
        for other, value in row.items():
            if one != other:
                found[names.index(one), names.index(other)] = float(value)
    return found

"""The keys of a problem file that are about rules, and the rules from them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

from occontrol.families.athans.rules.statement import Constraints, SensorRules
from occontrol.files.schema.common import Strict, Whole

SENSOR = ("min_on", "max_on", "min_off", "warm_up", "max_uses", "max_time", "max_share", "revisit")


class Duty(Strict):
    window: float = Field(description="window: a length of time")
    time: float = Field(description="time: at most so much of it in use")


class SensorKeys(Strict):
    min_on: float | None = Field(None, description="min_on: shortest use")
    max_on: float | None = Field(None, description="max_on: longest use")
    min_off: float | None = Field(None, description="min_off: shortest time between two uses")
    warm_up: float | None = Field(None, description="warm_up: time at the start of a use that measures nothing")
    max_uses: Whole | None = Field(None, description="max_uses: number of uses")
    max_time: float | None = Field(None, description="max_time: time in use in all")
    max_share: float | None = Field(None, description="max_share: of the horizon, in use in all")
    duty: Duty | None = Field(None, description="duty: {window: .., time: ..}")
    revisit: float | None = Field(None, description="revisit: longest time without use")


class Before(Strict):
    sensor: str = Field(description="sensor: that is on when the horizon starts")
    elapsed: float = Field(alias="for", description="for: the time that it has been on")


def _kind(value: object) -> str:
    return "word" if isinstance(value, str) else "table" if isinstance(value, dict) else "number"


Table = dict[str, dict[str, float]]
Price = Annotated[Annotated[float, Tag("number")] | Annotated[Table, Tag("table")], Discriminator(_kind)]
History = Annotated[Annotated[Literal["free"], Tag("word")] | Annotated[Before, Tag("table")], Discriminator(_kind)]


class ConstraintKeys(Strict):
    min_on: float | None = None
    min_off: float | None = None
    max_uses: Whole | None = None
    max_time: float | None = None
    max_share: float | None = None
    max_switches: Whole | None = Field(None, description="max_switches: changes of the set of sensors in use")
    switch_cost: Price | None = Field(None, description="switch_cost: a number or {from: {to: price}}")
    switch_delay: Table | None = Field(None, description="switch_delay: {from: {to: time}}")
    before: History = Field("free", description="before: free or {sensor: .., for: ..}")
    after: Literal["free", "enforce"] = "free"
    max_observation_cost: float | None = None
    max_error: float | None = None


def constraints(keys: ConstraintKeys | None, sensors: Sequence[object]) -> Constraints | None:
    """The rules that a document states; None where it states none.

    Parameters
    ----------
    keys : of `constraints`, or None
    sensors : the entries of `sensors`, words or SensorKeys
    """
    own = {}
    for entry in sensors:
        if isinstance(entry, SensorKeys):
            values = {key: getattr(entry, key) for key in SENSOR}
            duty = None if entry.duty is None else (entry.duty.window, entry.duty.time)
            rules = SensorRules(**values, duty=duty)
            if rules != SensorRules():
                own[entry.name] = rules  # type: ignore[attr-defined]
    if keys is None:
        return Constraints(own) if own else None
    values = {name: getattr(keys, name) for name in type(keys).model_fields if name != "before"}
    before = keys.before if isinstance(keys.before, str) else (keys.before.sensor, keys.before.elapsed)
    return Constraints(own, **values, before=before)

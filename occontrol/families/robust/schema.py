"""Problem files of the family robust: the document, the problem from it, and the document from a problem."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag, WithJsonSchema

from occontrol.core.clock import tolerance
from occontrol.core.errors import Path
from occontrol.core.kinds import PlainDict
from occontrol.core.sensor import IDLE, Sensor, idle_sensor
from occontrol.core.signal import ConstantSignal
from occontrol.families.robust.plant import UncertainPlant
from occontrol.families.robust.problem import MOST_SLOTS, Problem
from occontrol.files.schema.common import (
    Context,
    DatedHorizon,
    Expect,
    Labels,
    Matrix,
    Method,
    ProblemDocument,
    Strict,
    Vector,
    Whole,
    dates_document,
    options_document,
    plain,
    prune,
)


class Horizon(DatedHorizon):
    start: float | None = None
    end: float | None = None
    slots: Whole | None = None
    switch_times: list[float] | None = None
    samples: Whole = 20


class Initial(Strict):
    center: Vector = None
    weight: Matrix = Field(description="weight: {diag: [..]} or rows, the inverse of the initial shape")
    level: float = 1.0


class Plant(Strict):
    states: Labels = None
    units: Labels = None
    A: Matrix = Field(description="A: a list of rows")
    B: Matrix = Field(description="B: a list of rows, how the unknown input enters")
    K: Matrix = Field(description="K: a list of rows, the uncertainty output")
    initial: Initial = Field(description="initial: {center: .., weight: .., level: ..}")


class SensorEntry(Strict):
    name: str = Field(description="name: a word")
    C: Matrix = Field(description="C: a list of rows, one entry per state")


def _sensor_kind(value: object) -> str:
    return "word" if isinstance(value, str) else "sensor"


AnySensor = Annotated[
    Annotated[SensorEntry, Tag("sensor")] | Annotated[Literal["idle"], Tag("word")], Discriminator(_sensor_kind)
]
AnySize = Annotated[
    Any,
    WithJsonSchema(
        {"anyOf": [{"type": "string"}, {"type": "object", "additionalProperties": {"type": "number", "minimum": 0}}]}
    ),
]


class Document(ProblemDocument):
    """A problem file of the family robust."""

    family: Literal["robust"]
    horizon: Horizon = Field(description="horizon: {end: .., slots: ..}")
    plant: Plant = Field(description="plant: {A: .., B: .., K: .., initial: {..}}")
    sensors: list[AnySensor] = Field(description="sensors: a list of {name: .., C: ..}", min_length=1)
    size: AnySize = "trace"
    method: Method = None
    expect: Expect = None


def build(document: Document, context: Context) -> Problem:
    """The problem that the document describes; ProblemError with every mistake."""
    from occontrol.families.robust.family import FAMILY

    found = context.found
    name = context.title(document.name)
    edges = _edges(document.horizon, context)
    method = context.method(document.method, FAMILY.methods)
    expect = context.expect(document.expect)
    plant = _plant(document, context)
    sensors = [_sensor(entry, j, plant.states, context) for j, entry in enumerate(document.sensors)]
    # stand-ins for what is already known to be wrong let the problem look at all the rest
    before = len(found.mistakes)
    problem = context.attempt(
        Problem,
        name=name,
        plant=plant,
        sensors=sensors,
        edges=edges,
        size=document.size,
        samples=document.horizon.samples,
        method=method,
        expect=expect,
        calendar=context.calendar,
    )
    if edges is None:  # what is wrong with the horizon has been said in its own words
        found.mistakes[before:] = [m for m in found.mistakes[before:] if m.path != ("horizon",)]
    found.raise_if_any()
    return problem


def _edges(horizon: Horizon, context: Context) -> np.ndarray | None:
    """The edges of the slots, or None after a mistake."""
    wrong, before = context.found.add, len(context.found.mistakes)
    start, end = 0.0 if horizon.start is None else horizon.start, horizon.end
    if {("horizon", key) for key in ("start", "end", "slots", "switch_times")} & {
        m.path[:2] for m in context.found.mistakes
    }:
        return None  # one of them was unreadable and left out
    if horizon.switch_times is not None:
        return _switching(horizon, start, context)
    if end is None or horizon.slots is None:
        lacking = "no 'end'" if end is None else "neither 'slots' nor 'switch_times'"
        wrong(("horizon",), f"horizon has {lacking}", "{end: 2.0, slots: 5}", True)
        return None
    if not 1 <= horizon.slots <= MOST_SLOTS:
        hint = f"at least 1 and at most {MOST_SLOTS}"
        wrong(("horizon", "slots"), f"horizon.slots is {horizon.slots}, it must be {hint}")
    if end <= start:
        what = f"the horizon ends at {end:g}, which is not after its start {start:g}"
        wrong(("horizon", "end"), what, "end must lie after the start")
    return np.linspace(start, end, horizon.slots + 1) if len(context.found.mistakes) == before else None


def _switching(horizon: Horizon, start: float, context: Context) -> np.ndarray | None:
    """Edges from switch_times; start and end are added where the list leaves them out."""
    wrong, times, end = context.found.add, list(horizon.switch_times or []), horizon.end
    if horizon.slots is not None:
        wrong(("horizon", "slots"), "horizon has both 'switch_times' and 'slots'", "give one of them", True)
        return None
    if not times and end is None:
        wrong(("horizon", "switch_times"), "horizon.switch_times is empty", "switch_times: [0, .., end]")
        return None
    for k, t in enumerate(times):
        if k and t <= times[k - 1]:
            what = f"horizon.switch_times must increase: {t:g} comes after {times[k - 1]:g}"
            wrong(("horizon", "switch_times", k), what)
            return None
    if horizon.start is None and times and times[0] < 0:
        start = times[0]
    last = end if end is not None else times[-1]
    if last <= start:
        wrong(("horizon", "switch_times"), f"the horizon ends at {last:g}, which is not after its start {start:g}")
        return None
    slack = tolerance(last - start, start, last)
    for k, t in enumerate(times):
        if t < start - slack or t > last + slack:
            what = f"the switching time {t:g} lies outside the horizon [{start:g}, {last:g}]"
            wrong(("horizon", "switch_times", k), what)
            return None
    inner = [t for t in times if start + slack < t < last - slack]
    if len(inner) >= MOST_SLOTS:
        wrong(("horizon", "switch_times"), f"there are {len(inner) + 1} slots", f"at most {MOST_SLOTS}")
        return None
    return np.array([start, *inner, last])


def _plant(document: Document, context: Context) -> UncertainPlant:
    """The plant, with stand-ins for what is wrong (that is noted)."""
    entry = document.plant
    parts: PlainDict = {key: context.signal(getattr(entry, key), "plant", key) for key in ("A", "B", "K")}
    parts["weight"] = context.constant(entry.initial.weight, "plant", "initial", "weight")
    center = entry.initial.center
    parts["center"] = None if center is None else context.vector(center, "plant", "initial", "center")
    parts["level"] = entry.initial.level
    parts["names"], parts["units"] = tuple(entry.states or ()), tuple(entry.units or ())
    n = _states(parts, document)
    stand_in: PlainDict = {"A": np.zeros((n, n)), "B": np.zeros((n, 1)), "K": np.zeros((1, n))}
    stand_in |= {"weight": np.eye(n), "center": None, "level": 1.0, "names": (), "units": ()}
    values = {key: stand_in[key] if value is None else value for key, value in parts.items()}
    known = len(context.found.mistakes)
    plant = context.attempt(UncertainPlant, "plant", **values)
    if plant is None:
        fresh = context.found.mistakes[known:]
        initial: dict[Path, Path] = {("plant", key): ("plant", "initial", key) for key in ("weight", "center", "level")}
        context.found.mistakes[known:] = [m.moved(initial.get(m.path[:2], m.path[:2])) for m in fresh]
        bad = {"names" if m.path[1] == "states" else m.path[1] for m in fresh if len(m.path) > 1}
        plant = UncertainPlant(**{key: stand_in[key] if key in bad else value for key, value in values.items()})
    return plant


def _states(parts: PlainDict, document: Document) -> int:
    """The number of states: what A says; where A cannot be read, what most of the other parts agree on."""
    if parts["A"] is not None:
        return parts["A"].shape[0]
    rows = document.plant.A
    said = [len(rows)] if isinstance(rows, list) and rows else []
    said += [parts[key].shape[axis] for key, axis in (("weight", 0), ("B", 0), ("K", 1)) if parts[key] is not None]
    said += [] if parts["center"] is None else [len(parts["center"])]
    return max(said, key=said.count) if said else 1


def _sensor(entry: SensorEntry | str, index: int, states: int, context: Context) -> Sensor:
    if isinstance(entry, str):
        return idle_sensor(states)
    if entry.name == IDLE:
        what = f"the name '{IDLE}' is kept for the sensor that measures nothing"
        context.found.add(("sensors", index, "name"), what, "another name; or write - idle")
    C = context.signal(entry.C, "sensors", index, "C")
    C = ConstantSignal(np.zeros((1, states))) if C is None else C
    sensor = context.attempt(Sensor, "sensors", index, name=entry.name, C=C, noise=np.eye(C.shape[0]))
    return sensor or Sensor(f"sensor {index + 1}", ConstantSignal(np.zeros((1, states))), np.eye(1))


def document(problem: Problem) -> PlainDict:
    """The plain document of a problem, tables embedded; `build` makes the identical problem of it.

    Parameters
    ----------
    problem : Problem
    """
    p = problem.plant
    labels = prune({"states": list(p.names) or None, "units": list(p.units) or None})
    initial = {"center": p.center.tolist(), "weight": p.weight.tolist(), "level": p.level}
    content = {
        "family": "robust",
        "name": problem.name,
        "horizon": {
            "start": float(problem.edges[0]),
            "switch_times": problem.edges.tolist(),
            "samples": int(problem.samples),
            **dates_document(problem),
        },
        "plant": {**labels, "A": p.A.document(), "B": p.B.document(), "K": p.K.document(), "initial": initial},
        "sensors": [IDLE if s.is_idle else {"name": s.name, "C": s.C.document()} for s in problem.sensors],
        "size": plain(problem.size),
        "method": options_document(problem.method),
        "expect": plain(problem.expect),
    }
    return prune(content)

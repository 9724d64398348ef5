"""Problem files of the family athans: the document, the problem from it, and the document from a problem."""

from __future__ import annotations

from dataclasses import fields
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag

from occontrol.core.clock import tolerance
from occontrol.core.errors import Path, ProblemError
from occontrol.core.plant import LinearPlant
from occontrol.core.sensor import IDLE, Sensor, idle_sensor
from occontrol.core.signal import ConstantSignal, Signal
from occontrol.families.athans.growth import beyond_numbers
from occontrol.families.athans.integration.options import Integration
from occontrol.families.athans.methods import METHODS
from occontrol.families.athans.problem import SchedulingProblem, uniform_edges
from occontrol.families.athans.sensor_noise import sensor_noise
from occontrol.files.schema.common import (
    Context,
    Entries,
    Expect,
    Matrix,
    Method,
    Strict,
    Vector,
    Whole,
    options_document,
    plain,
    prune,
)

MAX_INTERVALS = 1_000_000


class Horizon(Strict):
    start: float | None = None
    end: float | None = None
    intervals: Whole | None = None
    edges: list[float] | None = None
    predict_at: float | None = None
    accuracy: float | None = Field(None, description="accuracy: relative, of the cost against continuous time")
    substeps: Whole | None = Field(None, description="substeps: equal steps of integration on every interval")
    windows: Literal["edges", "cover"] = Field(
        "edges", description="windows: edges (their ends become edges) or cover (only intervals that they cover)"
    )
    refine: bool = Field(True, description="refine: whether intervals that one choice spoils may be cut")


class Initial(Strict):
    mean: Vector = None
    covariance: Matrix = Field(description="covariance: {diag: [..]} or rows")


class Plant(Strict):
    A: Matrix = Field(description="A: a list of rows")
    B: Matrix = None
    input: Entries = None
    noise: Matrix = Field(description="noise: the intensity Xi of the plant noise")
    initial: Initial = Field(description="initial: {mean: .., covariance: ..}")


class SensorEntry(Strict):
    name: str = Field(description="name: a word")
    C: Matrix = Field(description="C: a list of rows, one entry per state")
    noise: Matrix = Field(None, description="noise: the intensity Theta of the sensor noise: variance times spacing")
    variance: Matrix = Field(None, description="variance: of one reading, with `every`, in place of noise")
    every: float | None = Field(None, description="every: time between two readings")
    cost: Matrix = 0.0
    windows: list[list[float]] | None = Field(None, description="windows: [[start, end], ..]")


def _sensor_kind(value: Any) -> str:
    return "word" if isinstance(value, str) else "sensor"


AnySensor = Annotated[
    Annotated[SensorEntry, Tag("sensor")] | Annotated[Literal["idle"], Tag("word")], Discriminator(_sensor_kind)
]


class Objective(Strict):
    cost_weight: float = 1.0
    output: Matrix = Field(description="output: the rows D of what is to be predicted")
    running: Matrix = None


class Document(Strict):
    """A problem file of the family athans."""

    family: Literal["athans"]
    name: str | None = None
    horizon: Horizon = Field(description="horizon: {end: .., intervals: ..}")
    plant: Plant = Field(description="plant: {A: .., noise: .., initial: {..}}")
    sensors: list[AnySensor] = Field(
        description="sensors: a list of {name: .., C: .., noise: .., cost: ..} and idle", min_length=1
    )
    select: Whole = 1
    objective: Objective = Field(description="objective: {cost_weight: .., output: ..}")
    method: Method = None
    expect: Expect = None


def build(document: Document, context: Context) -> SchedulingProblem:
    """The problem that the document describes; ProblemError with every mistake."""
    found, objective = context.found, document.objective
    name = context.title(document.name)
    edges = _edges(document.horizon, context)
    method = None if document.method is None else context.method(document.method, METHODS)
    expect = context.expect(document.expect)
    output = context.signal(objective.output, "objective", "output")
    running = None if objective.running is None else context.signal(objective.running, "objective", "running")
    plant = _plant(document.plant, context)
    states = 1 if plant is None else plant.states
    sensors = [_sensor(entry, j, states, context) for j, entry in enumerate(document.sensors)]
    if plant is None:
        raise ProblemError(found.mistakes)
    # stand-ins for what is already known to be wrong let the problem look at all the rest
    known = len(found.mistakes)
    problem = context.attempt(
        SchedulingProblem,
        name=name,
        plant=plant,
        sensors=sensors,
        edges=[] if edges is None else edges,
        output=ConstantSignal(np.zeros((1, states))) if output is None else output,
        predict_at=document.horizon.predict_at,
        cost_weight=objective.cost_weight,
        running=running,
        select=document.select,
        method=method,
        expect=expect,
        integration=Integration(**{f.name: getattr(document.horizon, f.name) for f in fields(Integration)}),
    )
    if edges is None:
        found.mistakes[known:] = [m for m in found.mistakes[known:] if m.path[:1] != ("horizon",)]
    found.raise_if_any()
    found.mistakes += beyond_numbers(problem.plant, problem.edges)
    found.raise_if_any()
    return problem


def _edges(horizon: Horizon, context: Context) -> Any:
    """The edges, or None after a mistake."""
    wrong = context.found.add
    if horizon.edges is not None:
        edges, before = horizon.edges, len(context.found.mistakes)
        if len(edges) < 2:
            wrong(
                ("horizon", "edges"),
                f"horizon.edges has {len(edges)} entries, it needs at least 2",
                "edges: [start, .., end]",
            )
            return None
        for k in range(1, len(edges)):
            if edges[k] <= edges[k - 1]:
                what = f"horizon.edges must increase: {edges[k]:g} comes after {edges[k - 1]:g}"
                wrong(("horizon", "edges", k), what)
                break
        if horizon.intervals is not None:
            wrong(("horizon", "intervals"), "horizon has both 'edges' and 'intervals'", "give one of them", True)
        for key, value, edge in (("start", horizon.start, edges[0]), ("end", horizon.end, edges[-1])):
            if value is not None and abs(value - edge) > tolerance(edges[-1] - edges[0], edge):
                wrong(("horizon", key), f"horizon.{key} is {value:g}, but the edges {key} at {edge:g}", "leave it out")
        return edges if len(context.found.mistakes) == before else None
    start = 0.0 if horizon.start is None else horizon.start
    unreadable = {m.path[1] for m in context.found.mistakes if len(m.path) > 1 and m.path[0] == "horizon"}
    if unreadable & {"start", "end", "intervals", "edges"}:
        return None  # one of them was left out
    if horizon.end is None or horizon.intervals is None:
        lacking = "'end'" if horizon.end is None else "neither 'intervals' nor 'edges'"
        wrong(
            ("horizon",),
            f"horizon has {'no ' if horizon.end is None else ''}{lacking}",
            "{start: 0, end: 10, intervals: 400}",
            True,
        )
        return None
    if not 1 <= horizon.intervals <= MAX_INTERVALS:
        hint = f"at least 1 and at most {MAX_INTERVALS}"
        wrong(("horizon", "intervals"), f"horizon.intervals is {horizon.intervals}, it must be {hint}")
    if horizon.end <= start:
        what = f"the horizon ends at {horizon.end:g}, which is not after its start {start:g}"
        wrong(("horizon", "end"), what, "end must lie after start")
    elif 1 <= horizon.intervals <= MAX_INTERVALS:
        return uniform_edges(start, horizon.end, horizon.intervals)
    return None


def _plant(entry: Plant, context: Context) -> LinearPlant | None:
    """The plant, with stand-ins for wrong parts, which are noted, as long as A can be read."""
    A = context.signal(entry.A, "plant", "A")
    parts: dict[str, Any] = {
        "noise": context.signal(entry.noise, "plant", "noise"),
        "covariance": context.constant(entry.initial.covariance, "plant", "initial", "covariance"),
        "mean": None if entry.initial.mean is None else context.vector(entry.initial.mean, "plant", "initial", "mean"),
        "B": None if entry.B is None else context.signal(entry.B, "plant", "B"),
        "input": None if entry.input is None else context.entries(entry.input, "plant", "input"),
    }
    lost = (entry.B is not None and parts["B"] is None) or (entry.input is not None and parts["input"] is None)
    if A is None:
        others = [part.shape[0] for part in (parts["noise"], parts["covariance"]) if part is not None]
        if not isinstance(entry.A, list) or len(entry.A) not in others:
            return None
        n = len(entry.A)  # an entry is wrong, but the rows tell the number of states
        A = ConstantSignal(np.zeros((n, n)))
    n = A.shape[0]
    stand_in = {"noise": np.zeros((n, n)), "covariance": np.zeros((n, n)), "mean": None, "B": None, "input": None}
    if lost:
        parts["B"] = parts["input"] = None
    for key in ("noise", "covariance"):
        parts[key] = stand_in[key] if parts[key] is None else parts[key]
    known = len(context.found.mistakes)
    plant = context.attempt(LinearPlant, "plant", A=A, **parts)
    if plant is None:
        fresh = context.found.mistakes[known:]
        bad = {m.path[1] for m in fresh if len(m.path) > 1}
        initial: dict[Path, Path] = {("plant", key): ("plant", "initial", key) for key in ("covariance", "mean")}
        context.found.mistakes[known:] = [m.moved(initial.get(m.path[:2], m.path[:2])) for m in fresh]
        if "A" in bad:
            return None
        bad |= {"B", "input"} if bad & {"B", "input"} else set()
        plant = LinearPlant(A=A, **{key: stand_in[key] if key in bad else value for key, value in parts.items()})
    return plant


def _sensor(entry: SensorEntry | str, j: int, states: int, context: Context) -> Sensor:
    """The sensor; one that measures nothing in its place when there is a mistake (that is noted)."""
    if isinstance(entry, str):
        return idle_sensor(states)
    C = context.signal(entry.C, "sensors", j, "C")
    noise = sensor_noise(entry.noise, entry.variance, entry.every, entry.name, ("sensors", j), context)
    cost = context.signal(entry.cost, "sensors", j, "cost")
    sensor = None
    if C is not None and noise is not None and cost is not None:
        arguments: dict[str, Any] = {"C": C, "noise": noise, "cost": cost, "windows": entry.windows}
        sensor = context.attempt(Sensor, "sensors", j, name=entry.name, **arguments)
    return sensor or Sensor(
        f"sensor {j + 1}" if sensor is None else entry.name, np.zeros((0, states)), np.zeros((0, 0))
    )


def document(problem: SchedulingProblem) -> dict[str, Any]:
    """The problem as a JSON-able document with everything in it; `build` of it gives the identical problem."""
    plant = problem.plant
    horizon = {"edges": problem.edges.tolist(), "predict_at": problem.predict_at, **problem.integration.as_dict()}
    result = {
        "family": "athans",
        "name": problem.name,
        "horizon": horizon,
        "plant": prune(
            {
                "A": plant.A.document(),
                "B": _or_none(plant.B),
                "input": _input(plant.input),
                "noise": plant.noise.document(),
                "initial": {"mean": plant.mean.tolist(), "covariance": plant.covariance.tolist()},
            }
        ),
        "sensors": [_sensor_document(sensor) for sensor in problem.sensors],
        "select": int(problem.select),
        "objective": prune(
            {
                "cost_weight": float(problem.cost_weight),
                "output": problem.output.document(),
                "running": _or_none(problem.running),
            }
        ),
        "method": options_document(problem.method),
        "expect": None if problem.expect is None else plain(problem.expect),
    }
    return prune(result)


def _or_none(signal: Signal | None) -> Any:
    return None if signal is None else signal.document()


def _input(signal: Signal | None) -> Any:
    value = _or_none(signal)
    return [row[0] for row in value] if isinstance(value, list) else value


def _sensor_document(sensor: Sensor) -> Any:
    if sensor.name == IDLE and sensor.is_idle:
        return IDLE
    windows = None if sensor.windows is None else [list(window) for window in sensor.windows]
    values = {"name": sensor.name, "C": sensor.C.document(), "noise": sensor.noise.document()}
    return prune({**values, "cost": sensor.cost.document(), "windows": windows})

"""Problem files of the family vlambda: the document, the problem from it, and the document from a problem."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag, WithJsonSchema

from occontrol.core.errors import Path
from occontrol.core.kinds import PlainDict
from occontrol.core.plant import DiscretePlant
from occontrol.core.signal import Signal
from occontrol.families.vlambda.methods import METHODS
from occontrol.families.vlambda.problem import CRITERIA, Problem
from occontrol.families.vlambda.sensor import DiscreteSensor, LocatedMatrix, Region
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
    steps: Whole = Field(description="steps: how many k there are")
    epoch: Whole = 1


class Initial(Strict):
    mean: Vector = None
    covariance: Matrix = Field(description="covariance: {diag: [..]} or rows")


class Plant(Strict):
    states: Labels = None
    units: Labels = None
    F: Matrix = Field(description="F: a list of rows")
    G: Matrix = None
    Q: Matrix = Field(description="Q: the covariance of the plant noise")
    initial: Initial = Field(description="initial: {mean: .., covariance: ..}")


class Location(Strict):
    bounds: Annotated[
        Any, WithJsonSchema({"type": "array", "items": {"type": "array", "items": {"type": "number"}}})
    ] = Field(description="bounds: [[low, high], ..]")
    constraints: Annotated[
        Any, WithJsonSchema({"anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}}]})
    ] = None


class SensorEntry(Strict):
    name: str = Field(description="name: a word")
    H: Matrix = Field(description="H: a list of rows, one entry per state")
    R: Matrix = Field(description="R: the covariance of the sensor noise")
    location: Location | None = None


class Criterion(Strict):
    name: str = CRITERIA[0]


def _criterion_kind(value: object) -> str:
    return "word" if isinstance(value, str) else "mapping"


AnyCriterion = Annotated[
    Annotated[Criterion, Tag("mapping")] | Annotated[str, Tag("word")], Discriminator(_criterion_kind)
]


class Document(ProblemDocument):
    """A problem file of the family vlambda."""

    family: Literal["vlambda"]
    horizon: Horizon = Field(description="horizon: {steps: .., epoch: ..}")
    plant: Plant = Field(description="plant: {F: .., Q: .., initial: {..}}")
    sensors: list[SensorEntry] = Field(description="sensors: a list of {name: .., H: .., R: ..}", min_length=1)
    select: Whole = 1
    scales: Vector = None
    criterion: AnyCriterion = CRITERIA[0]
    method: Method = None
    expect: Expect = None


def build(document: Document, context: Context) -> Problem:
    """The problem that the document describes; ProblemError with every mistake."""
    found, criterion = context.found, document.criterion
    name = context.title(document.name)
    method = context.method(document.method, METHODS)
    expect = context.expect(document.expect)
    scales = None if document.scales is None else context.vector(document.scales, "scales")
    plant = _plant(document.plant, context)
    sensors = [_sensor(entry, j, plant, context) for j, entry in enumerate(document.sensors)]
    steps, epoch, select = document.horizon.steps, document.horizon.epoch, document.select
    word = criterion if isinstance(criterion, str) else criterion.name
    if word not in CRITERIA:
        path = ("criterion",) if isinstance(criterion, str) else ("criterion", "name")
        found.add(path, f"unknown criterion '{word}'", "known: " + ", ".join(CRITERIA))
        word = CRITERIA[0]
    if plant is None:
        found.raise_if_any()
    # stand-ins for what is already known to be wrong let the problem look at all the rest
    problem = context.attempt(
        Problem,
        name=name,
        plant=plant,
        sensors=sensors,
        steps=steps,
        epoch=epoch,
        select=select,
        criterion=word,
        scales=scales,
        method=method,
        expect=expect,
        calendar=context.calendar,
    )
    found.raise_if_any()
    return problem


def _plant(entry: Plant, context: Context) -> DiscretePlant | None:
    """The plant, with stand-ins for wrong parts, which are noted, as long as F can be read."""
    F = context.signal(entry.F, "plant", "F", variable="k")
    G = None if entry.G is None else context.signal(entry.G, "plant", "G", variable="k")
    Q = context.signal(entry.Q, "plant", "Q", variable="k")
    covariance = context.constant(entry.initial.covariance, "plant", "initial", "covariance")
    mean = None if entry.initial.mean is None else context.vector(entry.initial.mean, "plant", "initial", "mean")
    if F is None or F.shape[0] != F.shape[1]:
        if F is not None:
            rows, columns = F.shape
            hint = "F is square: one row and one column per state"
            context.found.add(("plant", "F"), f"F is {rows}x{columns}, it must be square", hint)
        return None
    n = F.shape[0]
    stand_in: PlainDict = {"G": None, "Q": np.zeros((n, n)), "covariance": np.zeros((n, n)), "mean": None}
    given = {"G": G, "Q": Q, "covariance": covariance, "mean": mean}
    if Q is None or (entry.G is not None and G is None):
        given |= {"G": None, "Q": None}
    known = len(context.found.mistakes)
    values = {key: stand_in[key] if value is None else value for key, value in given.items()}
    labels = {"names": tuple(entry.states or ()), "units": tuple(entry.units or ())}
    plant = context.attempt(DiscretePlant, "plant", F=F, **values, **labels)
    if plant is None:
        fresh = context.found.mistakes[known:]
        bad = {m.path[1] for m in fresh if len(m.path) > 1}
        initial: dict[Path, Path] = {("plant", key): ("plant", "initial", key) for key in ("covariance", "mean")}
        context.found.mistakes[known:] = [m.moved(initial.get(m.path[:2], m.path[:2])) for m in fresh]
        bad |= {"G", "Q"} if bad & {"G", "Q"} else set()
        plant = DiscretePlant(F=F, **{key: stand_in[key] if key in bad else value for key, value in values.items()})
    return plant


def _sensor(entry: SensorEntry, j: int, plant: DiscretePlant | None, context: Context) -> DiscreteSensor:
    """The sensor; one that measures next to nothing in its place when there is a mistake (that is noted)."""
    region = None if entry.location is None else _region(entry.location, j, context)
    lost = entry.location is not None and region is None
    H, R = (None if lost else _matrix(getattr(entry, key), region, context, "sensors", j, key) for key in ("H", "R"))
    if not lost and H is not None and R is not None:
        sensor = context.attempt(DiscreteSensor, "sensors", j, name=entry.name, H=H, R=R, location=region)
        if sensor is not None:
            return sensor
    n = 1 if plant is None else plant.states
    return DiscreteSensor(entry.name, np.ones((1, n)), np.ones((1, 1)))


def _region(location: Location, j: int, context: Context) -> Region | None:
    arguments = {"bounds": location.bounds, "constraints": location.constraints or ()}
    return context.attempt(Region, "sensors", j, "location", **arguments)


def _matrix(value: object, region: Region | None, context: Context, *path: str | int) -> Signal | LocatedMatrix | None:
    if region is None:
        return context.signal(value, *path, variable="k")
    if isinstance(value, dict) and ("times" in value or "file" in value):
        context.found.add(
            path, f"{context.name(path)} is a table, but the sensor can be moved", "formulas of k, p1, .."
        )
        return None
    variables = ("k", *(f"p{i + 1}" for i in range(region.coordinates)))
    rows = context.rows(value, *path, variables=variables)
    return None if rows is None else LocatedMatrix(tuple(map(tuple, rows)), region.coordinates)


def document(problem: Problem) -> PlainDict:
    """The problem as a JSON-able document with everything in it; `build` of it gives the identical problem."""
    plant = problem.plant
    result = {
        "family": "vlambda",
        "name": problem.name,
        "horizon": {"steps": problem.steps, "epoch": problem.epoch, **dates_document(problem)},
        "plant": prune(
            {
                "states": list(plant.names) or None,
                "units": list(plant.units) or None,
                "F": plant.F.document(),
                "G": None if plant.G is None else plant.G.document(),
                "Q": plant.Q.document(),
                "initial": {"mean": plant.mean.tolist(), "covariance": plant.covariance.tolist()},
            }
        ),
        "sensors": [_sensor_document(sensor) for sensor in problem.sensors],
        "select": int(problem.select),
        "scales": problem.scales.tolist() if np.any(problem.scales != 1.0) else None,
        "criterion": {"name": problem.criterion},
        "method": options_document(problem.method),
        "expect": None if problem.expect is None else plain(problem.expect),
    }
    return prune(result)


def _sensor_document(sensor: DiscreteSensor) -> PlainDict:
    values = {"name": sensor.name, "H": sensor.H.document(), "R": sensor.R.document()}
    if sensor.location is None:
        return values
    region = sensor.location
    where = {"bounds": np.asarray(region.bounds).tolist(), "constraints": list(region.constraints) or None}
    return {**values, "location": prune(where)}

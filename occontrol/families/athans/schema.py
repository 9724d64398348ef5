"""Problem files of the family athans: the document, the problem from it, and the document from a problem."""

from __future__ import annotations

from dataclasses import fields
from typing import Annotated, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag

from occontrol.core.errors import ProblemError
from occontrol.core.kinds import PlainDict, PlainMapping
from occontrol.core.sensor import IDLE, Sensor, idle_sensor
from occontrol.core.signal import ConstantSignal
from occontrol.families.athans.criteria.schema import CriterionKeys, choice_of
from occontrol.families.athans.endless import schema as endless
from occontrol.families.athans.endless.problem import EndlessTargetsProblem
from occontrol.families.athans.endless.schema import EndlessTargetsDocument, is_endless
from occontrol.families.athans.growth import beyond_numbers
from occontrol.families.athans.integration.options import Integration
from occontrol.families.athans.methods import ALL_METHODS
from occontrol.families.athans.nonlinear import documents as forms
from occontrol.families.athans.nonlinear import schema as formulas
from occontrol.families.athans.nonlinear import written
from occontrol.families.athans.nonlinear.linearise import linearisation_of
from occontrol.families.athans.periodic import schema as periodic
from occontrol.families.athans.periodic.documents import DOCUMENTS as ENDLESS
from occontrol.families.athans.periodic.documents import EndlessDocument
from occontrol.families.athans.periodic.documents import document_for as endless_for
from occontrol.families.athans.periodic.problem import PeriodicProblem
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.families.athans.readings import schema as readings
from occontrol.families.athans.readings.documents import DOCUMENTS as READINGS
from occontrol.families.athans.readings.documents import SamplesDocument, StepsDocument, document_for
from occontrol.families.athans.readings.problem import ReadingsProblem
from occontrol.families.athans.rules.schema import ConstraintKeys, SensorKeys, constraints
from occontrol.families.athans.schema_parts import (
    NONE,
    Plant,
    Select,
    edges_of,
    has_prior,
    or_none,
    plant_document,
    plant_of,
    select_of,
    sensor_kind,
)
from occontrol.families.athans.sensor_noise import sensor_noise
from occontrol.families.athans.targets import schema as targets
from occontrol.families.athans.targets.documents import TargetsDocument, is_targets
from occontrol.families.athans.targets.problem import TargetsProblem
from occontrol.files.schema.common import (
    Context,
    DatedHorizon,
    Expect,
    Matrix,
    Method,
    ProblemDocument,
    Strict,
    Whole,
    options_document,
    plain,
    prune,
)


class Horizon(DatedHorizon):
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


class SensorEntry(SensorKeys):
    name: str = Field(description="name: a word")
    C: Matrix = Field(description="C: a list of rows, one entry per state")
    noise: Matrix = Field(None, description="noise: the intensity Theta of the sensor noise: variance times spacing")
    variance: Matrix = Field(None, description="variance: of one reading, with `every`, in place of noise")
    every: float | None = Field(None, description="every: time between two readings")
    cost: Matrix = 0.0
    windows: list[list[float]] | None = Field(None, description="windows: [[start, end], ..]")


AnySensor = Annotated[
    Annotated[SensorEntry, Tag("sensor")] | Annotated[Literal["idle"], Tag("word")], Discriminator(sensor_kind)
]


class Objective(Strict):
    cost_weight: float = 1.0
    output: Matrix = Field(description="output: the rows D of what is to be predicted")
    running: Matrix = None
    minimise: Literal["cost", "error", "observation"] = "cost"
    criterion: CriterionKeys | None = None


class Document(ProblemDocument):
    """A problem file of the family athans."""

    family: Literal["athans"]
    horizon: Horizon = Field(description="horizon: {end: .., intervals: ..}")
    plant: Plant = Field(description="plant: {A: .., noise: .., initial: {..}}")
    sensors: list[AnySensor] = Field(
        description="sensors: a list of {name: .., C: .., noise: .., cost: ..} and idle", min_length=1
    )
    sensing: Literal["rate"] = "rate"
    select: Select = 1
    constraints: ConstraintKeys | None = None
    objective: Objective = Field(description="objective: {cost_weight: .., output: ..}")
    method: Method = None
    expect: Expect = None


class FormulaDocument(Document):
    """A problem file of the family athans with continuous sensing of a nonlinear plant."""

    plant: forms.FormulaPlantEntry = Field(description=forms.PLANT)  # type: ignore[assignment]
    sensors: list[forms.AnyFormulaSensor] = Field(description=forms.SENSORS, min_length=1)  # type: ignore[assignment]
    integrator: forms.Integrator | None = None
    replan: forms.Replan | None = None


OF_TARGETS = (TargetsDocument, EndlessTargetsDocument)
DOCUMENTS = (Document, *READINGS, FormulaDocument, *forms.OF_READINGS.values(), *OF_TARGETS, *ENDLESS)


def model_for(data: PlainMapping) -> type[Strict]:
    """Which of DOCUMENTS a file is, by its horizon, its plant and `sensing`.

    Parameters
    ----------
    data : the plain content of the file
    """
    if is_targets(data):
        return EndlessTargetsDocument if is_endless(data) else TargetsDocument
    if (endless := endless_for(data)) is not None:
        return endless
    found = document_for(data) or Document
    return forms.OF_READINGS.get(found, FormulaDocument) if forms.given_by_formulas(data) else found


def build(
    document: Document | StepsDocument | SamplesDocument | TargetsDocument | EndlessDocument, context: Context
) -> SchedulingProblem | ReadingsProblem | TargetsProblem | PeriodicProblem:
    """The problem that the document describes; ProblemError with every mistake."""
    if isinstance(document, EndlessTargetsDocument):
        return endless.build(document, context)
    if isinstance(document, TargetsDocument):
        return targets.build(document, context)
    if isinstance(document, EndlessDocument):
        return periodic.build(document, context)
    if not isinstance(document, Document):
        return readings.build(document, context)
    found, objective = context.found, document.objective
    name = context.title(document.name)
    edges = edges_of(document.horizon, context)
    method = None if document.method is None else context.method(document.method, ALL_METHODS)
    expect = context.expect(document.expect)
    # first: what follows may name its states
    if isinstance(document, FormulaDocument):
        plant, sensors = formulas.read_rate_system(document, edges, document.horizon.predict_at, context)
    else:
        plant = plant_of(document.plant, context)
    output = context.signal(objective.output, "objective", "output")
    running = None if objective.running is None else context.signal(objective.running, "objective", "running")
    states = 1 if plant is None else plant.states
    if not isinstance(document, FormulaDocument):
        sensors = [_sensor(entry, j, states, context) for j, entry in enumerate(document.sensors)]
    select = select_of(document.select, context)
    least, most = select if isinstance(select, tuple) else (0, 1 if select is None else select)
    if isinstance(select, tuple) and IDLE not in document.sensors:
        sensors.append(idle_sensor(states))
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
        select=most,
        least=least,
        method=method,
        expect=expect,
        rules=constraints(document.constraints, document.sensors),
        minimise=objective.minimise,
        calendar=context.calendar,
        criterion=choice_of(objective.criterion),
        prior=has_prior(document.plant.initial, getattr(document.plant, "parameters", None)),
        integration=Integration(**{f.name: getattr(document.horizon, f.name) for f in fields(Integration)}),
    )
    if edges is None:
        found.mistakes[known:] = [m for m in found.mistakes[known:] if m.path[:1] != ("horizon",)]
    found.raise_if_any()
    found.mistakes += beyond_numbers(problem.plant, problem.edges)
    found.raise_if_any()
    return problem


def _sensor(entry: SensorEntry | str, j: int, states: int, context: Context) -> Sensor:
    """The sensor; one that measures nothing in its place when there is a mistake (that is noted)."""
    if isinstance(entry, str):
        return idle_sensor(states)
    C = context.signal(entry.C, "sensors", j, "C")
    noise = sensor_noise(entry.noise, entry.variance, entry.every, entry.name, ("sensors", j), context)
    cost = context.signal(entry.cost, "sensors", j, "cost")
    sensor = None
    if C is not None and noise is not None and cost is not None:
        arguments: PlainDict = {"C": C, "noise": noise, "cost": cost, "windows": entry.windows}
        sensor = context.attempt(Sensor, "sensors", j, name=entry.name, **arguments)
    return sensor or Sensor(
        f"sensor {j + 1}" if sensor is None else entry.name, np.zeros((0, states)), np.zeros((0, 0))
    )


def document(problem: SchedulingProblem | ReadingsProblem | TargetsProblem | PeriodicProblem) -> PlainDict:
    """The problem as a JSON-able document with everything in it; `build` of it gives the identical problem."""
    if isinstance(problem, EndlessTargetsProblem):
        return endless.document(problem)
    if isinstance(problem, TargetsProblem):
        return targets.document(problem)
    if isinstance(problem, PeriodicProblem):
        return periodic.document(problem)
    if isinstance(problem, ReadingsProblem):
        return readings.document(problem)
    plant, linearised = problem.plant, linearisation_of(problem)
    horizon = {"edges": problem.edges.tolist(), "predict_at": problem.predict_at, **problem.integration.as_dict()}
    horizon |= {} if problem.calendar is None else problem.calendar.document()
    system = plant_document(plant) if linearised is None else written.plant_document(linearised)
    if not problem.prior and linearised is None:
        system["initial"] = {"mean": plant.mean.tolist(), "covariance": NONE}
    result = {
        "family": "athans",
        "name": problem.name,
        "horizon": horizon,
        "plant": system,
        "sensors": [_sensor_document(sensor, problem) for sensor in problem.sensors],
        "select": [int(problem.least), int(problem.select)] if problem.least else int(problem.select),
        "constraints": None if problem.rules is None else problem.rules.document(),
        "objective": prune(
            {
                "cost_weight": float(problem.cost_weight),
                "output": problem.output.document(),
                "running": or_none(problem.running),
                "minimise": None if problem.minimise == "cost" else problem.minimise,
                "criterion": None if problem.criterion is None else problem.criterion.document(),
            }
        ),
        "method": options_document(problem.method),
        "expect": None if problem.expect is None else plain(problem.expect),
        **({} if linearised is None else written.options_documents(linearised)),
    }
    return prune(result)


def _sensor_document(sensor: Sensor, problem: SchedulingProblem) -> PlainDict | str:
    if sensor.name == IDLE and sensor.is_idle:
        return IDLE
    windows = None if sensor.windows is None else [list(window) for window in sensor.windows]
    own = None if problem.rules is None else problem.rules.sensors.get(sensor.name)
    rules = {} if own is None else own.document()
    if (linearised := linearisation_of(problem)) is not None:
        return {**written.sensor_document(linearised.sensors[sensor.name]), **rules}
    values = {"name": sensor.name, "C": sensor.C.document(), "noise": sensor.noise.document()}
    return prune({**values, "cost": sensor.cost.document(), "windows": windows, **rules})

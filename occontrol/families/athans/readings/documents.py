"""The documents of problem files with readings: discrete time (`horizon: {steps: ..}`), and `sensing: samples`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag

from occontrol.core.kinds import PlainMapping
from occontrol.families.athans.criteria.schema import CriterionKeys
from occontrol.families.athans.rules.schema import ConstraintKeys, SensorKeys
from occontrol.families.athans.schema_parts import Initial, Plant, Select, sensor_kind
from occontrol.files.schema.common import DatedHorizon, Expect, Labels, Matrix, Method, ProblemDocument, Strict, Whole


class StepsHorizon(DatedHorizon):
    """When, in discrete time."""

    steps: Whole = Field(description="steps: how many k there are")
    epoch: Whole = 1


class SamplesHorizon(DatedHorizon):
    """When a continuous plant is read."""

    start: float = 0.0
    end: float = Field(description="end: a time")
    sample_times: list[float] | None = None
    samples: Whole | None = None
    first: float | None = Field(None, description="first: time of the first of `samples`; the start if left out")
    predict_at: float | None = None


class StepsPlant(Strict):
    """x(k+1) = F x + G w."""

    states: Labels = None
    units: Labels = None
    F: Matrix = Field(description="F: a list of rows")
    G: Matrix = None
    Q: Matrix = Field(description="Q: the covariance of the plant noise")
    initial: Initial = Field(description="initial: {mean: .., covariance: ..}, covariance: none for no prior")


class StepsSensor(SensorKeys):
    """One sensor that is read at steps."""

    name: str = Field(description="name: a word")
    H: Matrix = Field(description="H: a list of rows, one entry per state")
    R: Matrix = Field(description="R: the covariance of one reading")
    cost: Matrix = 0.0
    windows: list[list[float]] | None = Field(None, description="windows: [[first k, last k], ..]")


class SamplesSensor(SensorKeys):
    """One sensor that is read at sample times."""

    name: str = Field(description="name: a word")
    C: Matrix = Field(description="C: a list of rows, one entry per state")
    noise: Matrix = Field(None, description="noise: the covariance of one reading")
    variance: Matrix = Field(None, description="variance: the same as noise")
    every: Any = None
    cost: Matrix = 0.0
    windows: list[list[float]] | None = Field(None, description="windows: [[start, end], ..]")


AnyStepsSensor = Annotated[
    Annotated[StepsSensor, Tag("sensor")] | Annotated[Literal["idle"], Tag("word")], Discriminator(sensor_kind)
]
AnySamplesSensor = Annotated[
    Annotated[SamplesSensor, Tag("sensor")] | Annotated[Literal["idle"], Tag("word")], Discriminator(sensor_kind)
]


class ReadingsObjective(Strict):
    """What counts."""

    cost_weight: float = 1.0
    output: Matrix = None
    at: str | None = Field(None, description="at: predicted (before the reading at N) or posterior")
    running: Matrix = None
    running_at: str | None = Field(None, description="running_at: posterior, prior, or integral (samples)")
    minimise: Literal["cost", "error", "observation"] = "cost"
    criterion: CriterionKeys | None = None


class ReadingsDocument(ProblemDocument):
    """What both documents of readings have in common."""

    family: Literal["athans"]
    select: Select = 1
    budget: dict[str, Whole] | None = Field(None, description="budget: {total: 6} or {radar: 3}")
    constraints: ConstraintKeys | None = None
    objective: ReadingsObjective = Field(description="objective: {cost_weight: .., output: ..}")
    method: Method = None
    expect: Expect = None


class StepsDocument(ReadingsDocument):
    """A problem file of the family athans in discrete time."""

    horizon: StepsHorizon = Field(description="horizon: {steps: .., epoch: ..}")
    sensing: Literal["samples"] = "samples"
    plant: StepsPlant = Field(description="plant: {F: .., Q: .., initial: {..}}")
    sensors: list[AnyStepsSensor] = Field(
        description="sensors: a list of {name: .., H: .., R: .., cost: ..} and idle", min_length=1
    )


class SamplesDocument(ReadingsDocument):
    """A problem file of the family athans with readings of a continuous plant."""

    horizon: SamplesHorizon = Field(description="horizon: {start: .., end: .., sample_times: [..]}")
    sensing: Literal["samples"] = Field(description="sensing: samples")
    plant: Plant = Field(description="plant: {A: .., noise: .., initial: {..}}")
    sensors: list[AnySamplesSensor] = Field(
        description="sensors: a list of {name: .., C: .., noise: .., cost: ..} and idle", min_length=1
    )


DOCUMENTS = (StepsDocument, SamplesDocument)


def document_for(data: PlainMapping) -> type[Strict] | None:
    """Which of the two documents a file is; None for continuous sensing.

    Parameters
    ----------
    data : the plain content of the file
    """
    horizon, plant = (data.get(key) for key in ("horizon", "plant"))
    keys = set(horizon) if isinstance(horizon, Mapping) else set()
    stated = set(plant) if isinstance(plant, Mapping) else set()
    if keys & {"steps", "epoch"} or (stated & {"F", "Q", "G"} and "A" not in stated):
        return StepsDocument
    return SamplesDocument if data.get("sensing") == "samples" or keys & {"sample_times", "samples"} else None

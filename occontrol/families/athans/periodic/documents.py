"""The documents of problem files without an end: `horizon: {infinite: true}`, with a step in continuous time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

from occontrol.core.kinds import PlainMapping
from occontrol.families.athans.readings.documents import StepsPlant
from occontrol.families.athans.schema_parts import Plant, Select, sensor_kind
from occontrol.files.schema.common import Expect, Matrix, Method, ProblemDocument, Strict, Whole


class EndlessHorizon(Strict):
    """No end, in discrete time."""

    infinite: Literal[True] = Field(description="infinite: true")
    repeat: float | None = Field(None, description="repeat: time after which windows come again")


class SteppedHorizon(EndlessHorizon):
    """No end, in continuous time."""

    step: float = Field(description="step: time between readings, or the shortest time between changes")


class EndlessObjective(Strict):
    """What counts for ever."""

    cost_weight: float = 1.0
    running: Matrix = Field(description="running: the weight R of what counts at every time")
    running_at: str | None = Field(None, description="running_at: posterior, prior, or integral (samples)")
    output: Matrix = None
    at: str | None = None


class EndlessRules(Strict):
    """Rules of a cycle for all sensors."""

    min_on: float | None = Field(None, description="min_on: how long every sensor stays on at least")
    max_uses: Whole | None = Field(None, description="max_uses: of every sensor, steps of one cycle")
    max_switches: Whole | None = Field(None, description="max_switches: changes of one cycle")


class CycleSensor(Strict):
    """Rules of a cycle for one sensor."""

    min_on: float | None = Field(None, description="min_on: how long it stays on at least")
    max_uses: Whole | None = Field(None, description="max_uses: steps of one cycle at which it is used")


class EndlessStepsSensor(CycleSensor):
    """One sensor that is read at steps."""

    name: str = Field(description="name: a word")
    H: Matrix = Field(description="H: a list of rows, one entry per state")
    R: Matrix = Field(description="R: the covariance of one reading")
    cost: Matrix = 0.0
    windows: list[list[float]] | None = Field(None, description="windows: [[first k, last k], ..] of one round")


class EndlessSensor(CycleSensor):
    """One sensor of a continuous plant."""

    name: str = Field(description="name: a word")
    C: Matrix = Field(description="C: a list of rows, one entry per state")
    noise: Matrix = Field(None, description="noise: covariance of one reading, or the intensity of continuous sensing")
    variance: Matrix = Field(None, description="variance: of one reading; for continuous sensing with `every`")
    every: float | None = Field(None, description="every: time between two readings, of continuous sensing")
    cost: Matrix = 0.0
    windows: list[list[float]] | None = Field(None, description="windows: [[start, end], ..] of one round")


AnyStepsSensor = Annotated[
    Annotated[EndlessStepsSensor, Tag("sensor")] | Annotated[Literal["idle"], Tag("word")], Discriminator(sensor_kind)
]
AnySensor = Annotated[
    Annotated[EndlessSensor, Tag("sensor")] | Annotated[Literal["idle"], Tag("word")], Discriminator(sensor_kind)
]


class EndlessDocument(ProblemDocument):
    """What all documents without an end have in common."""

    family: Literal["athans"]
    select: Select = 1
    constraints: EndlessRules | None = None
    objective: EndlessObjective = Field(description="objective: {cost_weight: .., running: ..}")
    method: Method = None
    expect: Expect = None


class EndlessStepsDocument(EndlessDocument):
    """A problem file of the family athans in discrete time, for ever."""

    horizon: EndlessHorizon = Field(description="horizon: {infinite: true}")
    sensing: Literal["samples"] = "samples"
    plant: StepsPlant = Field(description="plant: {F: .., Q: .., initial: {..}}")
    sensors: list[AnyStepsSensor] = Field(
        description="sensors: a list of {name: .., H: .., R: .., cost: ..} and idle", min_length=1
    )


class EndlessContinuousDocument(EndlessDocument):
    """A problem file of the family athans for a continuous plant, for ever."""

    horizon: SteppedHorizon = Field(description="horizon: {infinite: true, step: ..}")
    sensing: Literal["rate", "samples"] = "rate"
    plant: Plant = Field(description="plant: {A: .., noise: .., initial: {..}}")
    sensors: list[AnySensor] = Field(
        description="sensors: a list of {name: .., C: .., noise: .., cost: ..} and idle", min_length=1
    )


DOCUMENTS = (EndlessStepsDocument, EndlessContinuousDocument)


def document_for(data: PlainMapping) -> type[Strict] | None:
    """Which of the two documents a file is; None for a horizon that ends.

    Parameters
    ----------
    data : the plain content of the file
    """
    horizon, plant = (data.get(key) for key in ("horizon", "plant"))
    if not isinstance(horizon, Mapping) or "infinite" not in horizon:
        return None
    stated = set(plant) if isinstance(plant, Mapping) else set()
    return EndlessStepsDocument if stated & {"F", "Q", "G"} and "A" not in stated else EndlessContinuousDocument

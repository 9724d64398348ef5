"""The parts of problem files with nonlinear plants: formulas of named states in place of matrices."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag, WithJsonSchema

from occontrol.core.kinds import Plain, PlainDict, PlainMapping
from occontrol.families.athans.readings.documents import SamplesDocument, StepsDocument
from occontrol.families.athans.rules.schema import SensorKeys
from occontrol.families.athans.schema_parts import Initial, sensor_kind
from occontrol.files.schema.common import Entries, Labels, Matrix, Strict, Whole

_FORMULA: PlainDict = {"type": ["number", "string"]}
_FLAGS: PlainDict = {"anyOf": [{"type": "boolean"}, {"type": "array", "items": {"type": "boolean"}}]}
Formula = Annotated[Plain, WithJsonSchema(_FORMULA)]
Flags = Annotated[Plain, WithJsonSchema(_FLAGS)]


class Parameter(Strict):
    """A state that does not move."""

    mean: float = Field(description="mean: what it is thought to be")
    sd: float | Literal["none"] = Field(
        description="sd: its standard deviation, 0 where it is known, none where nothing is known beforehand"
    )


class FormulaPlantEntry(Strict):
    """dx/dt = f, or in discrete time the next state."""

    f: Entries = Field(None, description="f: [formulas of dx/dt, one per state]")
    next: Entries = Field(None, description="next: [formulas of the state one step later], in discrete time")
    states: Labels = None
    units: Labels = None
    parameters: dict[str, Parameter] | None = Field(None, description="parameters: {p: {mean: 0.5, sd: 0.1}}")
    noise: Matrix = Field(description="noise: the intensity Xi of the plant noise, or the covariance of a step")
    initial: Initial = Field(description="initial: {mean: .., covariance: ..}")
    nominal: Matrix = Field(None, description="nominal: a column of formulas of t, or a table, to linearise along")


class FormulaSensorEntry(SensorKeys):
    """One sensor by formulas."""

    name: str = Field(description="name: a word")
    h: Entries = Field(None, description="h: [formulas of the states]")
    C: Matrix = Field(None, description="C: a list of rows, in place of h")
    angle: Flags = Field(False, description="angle: true where values are angles in rad, or one answer per value")
    noise: Matrix = Field(None, description="noise: intensity, or covariance of one reading; may hold states")
    variance: Matrix = Field(None, description="variance: of one reading, with `every` for continuous sensing")
    every: float | None = Field(None, description="every: time between two readings, for continuous sensing")
    visible: Formula = Field(None, description="visible: a formula that is above 0 where the sensor can be used")
    cost: Matrix = 0.0
    windows: list[list[float]] | None = Field(None, description="windows: [[start, end], ..]")


class Integrator(Strict):
    """How the path is integrated."""

    substeps: Whole | None = Field(None, description="substeps: of every span between two readings")
    accuracy: float | None = Field(None, description="accuracy: relative, where substeps are chosen by it")


class Replan(Strict):
    """How a loop plans anew."""

    every: Whole = 1
    horizon: Whole | None = None
    gap: float = 1.0e-3
    estimator: str = Field("ekf", description="estimator: ekf, iterated or ukf")
    deadline: float | None = None


AnyFormulaSensor = Annotated[
    Annotated[FormulaSensorEntry, Tag("sensor")] | Annotated[str, Tag("word")], Discriminator(sensor_kind)
]
PLANT = "plant: {f: [..], noise: .., initial: {..}}"
SENSORS = "sensors: a list of {name: .., h: [..], noise: .., cost: ..} and idle"


class FormulaStepsDocument(StepsDocument):
    """A problem file of the family athans with a nonlinear plant in discrete time."""

    plant: FormulaPlantEntry = Field(description=PLANT)  # type: ignore[assignment]
    sensors: list[AnyFormulaSensor] = Field(description=SENSORS, min_length=1)  # type: ignore[assignment]
    integrator: Integrator | None = None
    replan: Replan | None = None


class FormulaSamplesDocument(SamplesDocument):
    """A problem file of the family athans with readings of a nonlinear plant."""

    plant: FormulaPlantEntry = Field(description=PLANT)  # type: ignore[assignment]
    sensors: list[AnyFormulaSensor] = Field(description=SENSORS, min_length=1)  # type: ignore[assignment]
    integrator: Integrator | None = None
    replan: Replan | None = None


def given_by_formulas(data: PlainMapping) -> bool:
    """Whether a file states its plant by formulas, f or next.

    Parameters
    ----------
    data : the plain content of the file
    """
    plant = data.get("plant")
    stated = set(plant) if isinstance(plant, Mapping) else set()
    return bool(stated & {"f", "next", "parameters"}) and not stated & {"A", "F"}


OF_READINGS: Mapping[type[Strict], type[Strict]] = {
    StepsDocument: FormulaStepsDocument,
    SamplesDocument: FormulaSamplesDocument,
}
"""The document with formulas, for each document of readings."""

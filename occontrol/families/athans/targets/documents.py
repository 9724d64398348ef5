"""The document of a problem file with many targets."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, WithJsonSchema

from occontrol.core.kinds import PlainMapping
from occontrol.files.schema.common import Entries, Expect, Matrix, Method, ProblemDocument, Strict, Whole

KEYS = {"targets", "target_models", "looks"}

Table = Annotated[
    Any,
    WithJsonSchema(
        {
            "anyOf": [
                {"type": "string"},
                {"type": "object", "additionalProperties": {"type": "array"}},
            ]
        }
    ),
]
"""The name of a CSV or .npz file, or its columns as {name: [..]}."""


class TargetsHorizon(Strict):
    """When."""

    start: float | None = None
    end: float | None = None
    intervals: Whole | None = None
    edges: list[float] | None = None
    accuracy: float | None = Field(None, description="accuracy: relative, of the cost against continuous time")
    substeps: Whole | None = Field(None, description="substeps: equal steps of integration on every interval")
    windows: Literal["cover"] = Field("cover", description="windows: cover (only intervals that they cover)")


class ResourceEntry(Strict):
    """What looks at targets."""

    name: str = Field(description="name: a word")
    capacity: Matrix = Field(1, description="capacity: looks on one interval, a number, a formula of t or a table")
    windows: list[list[float]] | None = Field(None, description="windows: [[start, end], ..]")
    slew: float | None = Field(None, description="slew: time between looks at different targets", gt=0)


class TargetInitial(Strict):
    """Where a target is at the start."""

    mean: Entries = None
    covariance: Matrix = Field(description="covariance: {diag: [..]} or rows")


class OwnInitial(Strict):
    """What one target has in the place of its model's."""

    mean: Entries = None
    covariance: Matrix = None


class TargetModel(Strict):
    """What targets have in common; entries may be formulas of the columns of their table."""

    A: Matrix = Field(description="A: a list of rows")
    noise: Matrix = Field(description="noise: the intensity Xi of the plant noise")
    initial: TargetInitial = Field(description="initial: {mean: .., covariance: ..}")
    output: Matrix = Field(None, description="output: rows D, weighted at the end")
    running: Matrix = Field(None, description="running: weight R of the covariance, all the time")


class TargetEntry(Strict):
    """One target, or a table of many."""

    name: str | None = None
    model: str = Field(description="model: the name of one of target_models")
    weight: Matrix = Field(1.0, description="weight: what this target counts")
    revisit: float | None = Field(None, description="revisit: longest time without a look", gt=0)
    initial: OwnInitial | None = None
    noise: dict[str, Matrix] | None = Field(None, description="noise: {RESOURCE: ..} of its looks")
    C: dict[str, Matrix] | None = Field(None, description="C: {RESOURCE: rows} of its looks")
    windows: dict[str, list[list[float]]] | None = Field(None, description="windows: {RESOURCE: [[start, end], ..]}")
    table: Table = Field(None, description="table: FILE.csv, FILE.npz or {column: [..]}, one row per target")
    rows: Whole | None = Field(None, description="rows: how many rows of the table, from the first")
    passes: Table = Field(None, description="passes: a table with target, resource, start, end and more columns")


class LookEntry(Strict):
    """How a resource sees targets."""

    resource: str | list[str] = Field(description="resource: a name, or a list of names")
    C: Matrix = Field(description="C: a list of rows, one entry per state of the model")
    noise: Matrix = Field(None, description="noise: the intensity Theta: variance of one look times its length")
    variance: Matrix = Field(None, description="variance: of one look that lasts one interval, in place of noise")
    cost: Matrix = 0.0
    model: str | None = Field(None, description="model: of the targets that are seen like this; all if left out")
    dwell: Whole = Field(1, description="dwell: intervals that a look lasts at least")


class TargetsObjective(Strict):
    """What counts: running and output of the models, times the weights of the targets."""

    cost_weight: float = 1.0
    running: Literal["per-target"] | None = None
    output: Literal["per-target"] | None = None


class TargetsDocument(ProblemDocument):
    """A problem file of the family athans with many targets."""

    family: Literal["athans"]
    horizon: TargetsHorizon = Field(description="horizon: {end: .., intervals: ..}")
    resources: list[ResourceEntry] = Field(description="resources: a list of {name: .., capacity: ..}", min_length=1)
    target_models: dict[str, TargetModel] = Field(description="target_models: {NAME: {A: .., noise: ..}}", min_length=1)
    targets: list[TargetEntry] = Field(description="targets: a list of {name: .., model: ..}", min_length=1)
    looks: list[LookEntry] = Field(description="looks: a list of {resource: .., C: .., noise: ..}", min_length=1)
    objective: TargetsObjective = Field(default_factory=TargetsObjective)
    method: Method = None
    expect: Expect = None


def is_targets(data: PlainMapping) -> bool:
    """Whether a file is of many targets.

    Parameters
    ----------
    data : the plain content of the file
    """
    return bool(KEYS & set(data))

"""What the problem files of both kinds, continuous sensing and readings, have in common: plant, select, idle."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Annotated, Any, Protocol, TypeGuard

import numpy as np
from pydantic import Field, WithJsonSchema

from occontrol.core.clock import tolerance
from occontrol.core.errors import Path
from occontrol.core.kinds import Plain, PlainDict
from occontrol.core.plant import DiscretePlant, LinearPlant
from occontrol.core.signal import ConstantSignal, Signal
from occontrol.families.athans.problem import uniform_edges
from occontrol.files.schema.common import Context, Entries, Labels, Matrix, Strict, Vector, prune
from occontrol.files.schema.words import shown

MAX_INTERVALS = 1_000_000
MOST_STATES = 2000  # of one matrix
RANGE = re.compile(r"\s*([0-9]{1,9})\s*\.\.\s*([0-9]{1,9})\s*", re.ASCII)

NONE = "none"

Select = Annotated[
    Any,
    WithJsonSchema(
        {
            "anyOf": [
                {"type": "integer"},
                {"type": "string", "pattern": r"^\s*[0-9]+\s*\.\.\s*[0-9]+\s*$"},
                {"type": "array", "items": {"type": "integer"}, "minItems": 2, "maxItems": 2},
            ]
        }
    ),
]
"""How many sensors at a time: a number, "a..b", or [a, b]; `select_of` reads it."""


class Initial(Strict):
    mean: Vector = None
    covariance: Matrix = Field(description="covariance: {diag: [..]}, rows, or none")


class Plant(Strict):
    states: Labels = None
    units: Labels = None
    A: Matrix = Field(description="A: a list of rows")
    B: Matrix = None
    input: Entries = None
    noise: Matrix = Field(description="noise: the intensity Xi of the plant noise")
    initial: Initial = Field(description="initial: {mean: .., covariance: ..}")


def sensor_kind(value: object) -> str:
    """Which of the two forms an entry of `sensors` has."""
    return "word" if isinstance(value, str) else "sensor"


def select_of(value: object, context: Context) -> int | tuple[int, int] | None:
    """A number, or (least, most); None after a mistake.

    Parameters
    ----------
    value : as in the file
    context : where mistakes are noted
    """
    if isinstance(value, str) and (match := RANGE.fullmatch(value)):
        value = [int(match[1]), int(match[2])]
    if isinstance(value, list) and len(value) == 2 and all(map(_whole, value)):
        least, most = (int(x) for x in value)
        return most if least == most else (least, most)
    if _whole(value):
        return int(value)
    what = f"select is {shown(value)}, it must be a whole number or a range"
    context.found.add(("select",), what, "for example 1, 0..2 or [0, 2]")
    return None


def _whole(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and float(value).is_integer()


class Spread(Protocol):
    """What a file says of a parameter.

    Attributes
    ----------
    sd : its standard deviation, or none
    """

    @property
    def sd(self) -> float | str: ...


def has_prior(initial: Initial, parameters: Mapping[str, Spread] | None = None) -> bool:
    """Whether a file states an initial covariance, and not `none`.

    Parameters
    ----------
    initial : as read
    parameters : of a plant given by formulas, if it has any
    """
    return initial.covariance != NONE and not any(p.sd == NONE for p in (parameters or {}).values())


def initial_covariance(initial: Initial, context: Context) -> np.ndarray | None:
    """The initial covariance (n, n); None after a mistake, and where the file says that there is none.

    Parameters
    ----------
    initial : as read
    context : where mistakes are noted
    """
    if not has_prior(initial):
        return None
    return context.constant(initial.covariance, "plant", "initial", "covariance")


def plant_of(entry: Plant, context: Context) -> LinearPlant | None:
    """The plant, with stand-ins for wrong parts, which are noted, as long as A can be read."""
    A = context.signal(entry.A, "plant", "A")
    if A is not None and max(A.shape) > MOST_STATES:
        what = f"the plant has {A.shape[0]} states, more than {MOST_STATES} in one matrix"
        context.found.add(("plant", "A"), what, "write what is independent as resources, target_models, targets, looks")
    parts: PlainDict = {
        "noise": context.signal(entry.noise, "plant", "noise"),
        "covariance": initial_covariance(entry.initial, context),
        "mean": None if entry.initial.mean is None else context.vector(entry.initial.mean, "plant", "initial", "mean"),
        "B": None if entry.B is None else context.signal(entry.B, "plant", "B"),
        "input": None if entry.input is None else context.entries(entry.input, "plant", "input"),
    }
    labels = {"names": tuple(entry.states or ()), "units": tuple(entry.units or ())}
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
    plant = context.attempt(LinearPlant, "plant", A=A, **parts, **labels)
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


def plant_document(plant: LinearPlant) -> PlainDict:
    """The plant as it stands in a problem file."""
    return prune(
        {
            **labels_document(plant),
            "A": plant.A.document(),
            "B": or_none(plant.B),
            "input": _input(plant.input),
            "noise": plant.noise.document(),
            "initial": {"mean": plant.mean.tolist(), "covariance": plant.covariance.tolist()},
        }
    )


def labels_document(plant: LinearPlant | DiscretePlant) -> PlainDict:
    """Names and units of the states as they stand in a problem file.

    Parameters
    ----------
    plant : whose states are named, or not
    """
    return {"states": list(plant.names) or None, "units": list(plant.units) or None}


def or_none(signal: Signal | None) -> Plain:
    """What stands for a signal in a problem file; None for none."""
    return None if signal is None else signal.document()


def _input(signal: Signal | None) -> Plain:
    value = or_none(signal)
    return [row[0] for row in value] if isinstance(value, list) else value


class StatedHorizon(Protocol):
    """How a problem file gives edges: a list of them, or start, end and a number of intervals."""

    start: float | None
    end: float | None
    intervals: int | None
    edges: list[float] | None


def edges_of(horizon: StatedHorizon, context: Context) -> np.ndarray | list[float] | None:
    """The edges (N+1,), or None after a mistake.

    Parameters
    ----------
    horizon : of the document
    context : where mistakes are noted
    """
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

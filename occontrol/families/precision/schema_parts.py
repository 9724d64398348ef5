"""The parts of a precision document, and the readers that turn them into plants, filters and moments."""

from __future__ import annotations

import dataclasses
from typing import Annotated, Any

import numpy as np
from pydantic import Discriminator, Field, Tag, WithJsonSchema

from occontrol.core.kinds import Plain
from occontrol.families.precision.ensemble import EnsembleFilter
from occontrol.families.precision.measurement import NonlinearMeasurement
from occontrol.families.precision.moments import Moments
from occontrol.families.precision.plant import LARGEST_SIZE, NonlinearPlant
from occontrol.families.precision.unscented import UnscentedFilter
from occontrol.files.schema.common import Context, Entries, Matrix, Strict, Whole
from occontrol.files.schema.matrix_forms import ENTRY, MATRIX_SCHEMA
from occontrol.files.schema.words import shown, suggest

FILTERS = {"enkf": EnsembleFilter, "ukf": UnscentedFilter}
_NUMBERS = {"anyOf": [{"type": "number"}, {"type": "array", "items": {"type": ["number", "null"]}}]}
Numbers = Annotated[Any, WithJsonSchema(_NUMBERS)]
"""A number for every sensor, or a list; null in a list: no cap, not fixed."""

_RANGE = {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}
_UNIFORM = {"type": "object", "properties": {"uniform": _RANGE, "seed": {"type": "integer"}}, "required": ["uniform"]}
_RANDOM = {
    "type": "object",
    "properties": {"random": {"type": "integer"}, "eigenvalues": _RANGE, "seed": {"type": "integer"}},
    "required": ["random"],
}
Mean = Annotated[Any, WithJsonSchema({"anyOf": [{"type": "array", "items": {"type": "number"}}, ENTRY, _UNIFORM]})]
Covariance = Annotated[Any, WithJsonSchema({"anyOf": [MATRIX_SCHEMA, _RANDOM]})]


class Plant(Strict):
    model: str | None = Field(None, description="model: lorenz96")
    size: Whole | None = None
    forcing: float | None = None
    f: Entries = Field(None, description="f: [formulas of x1 .. xn, t]")
    step: float | None = Field(None, description="with step: dx/dt = f; without: f is the next state")
    substeps: Whole = 1


class Measurement(Strict):
    model: str | None = Field(None, description="model: sigmoid")
    h: Entries = Field(None, description="h: [formulas of x1 .. xn], one per sensor")
    names: list[str] | None = None


class Initial(Strict):
    mean: Mean = None
    covariance: Covariance = Field(description="covariance: {diag: [..]} or rows")


class Filter(Strict):
    name: str = Field(description="name: enkf | ukf")
    members: Whole | None = None
    inflation: float | None = None
    update: str | None = None
    centring: str | None = None
    seed: Whole | None = None
    alpha: float | None = None
    beta: float | None = None
    kappa: float | None = None


class Bound(Strict):
    factor: float | None = None
    matrix: Matrix = None


class Prune(Strict):
    sensors: Whole | None = None
    by: str = "use"
    together: Whole = 1
    rise: float | None = None
    exact: bool = False


class MomentsEntry(Strict):
    state: Matrix = Field(description="state: covariance of the bounded states")
    cross: Matrix = Field(description="cross: covariance of states and measurements")
    measurement: Matrix = Field(description="measurement: covariance of the noise-free measurements")


class Truth(Strict):
    seed: Whole = 0


def by_name(value: object) -> object:
    """A bare word stands for {name: word}."""
    return {"name": value} if isinstance(value, str) else value


def _prune_kind(value: object) -> str:
    return "options" if isinstance(value, dict) else "flag"


AnyPrune = Annotated[Annotated[Prune, Tag("options")] | Annotated[bool, Tag("flag")], Discriminator(_prune_kind)]


def read_numbers(value: object, key: str, context: Context) -> Plain:
    """A number, or a list of numbers and null; what is wrong is noted."""
    if value is None:
        return None
    items, before = value if isinstance(value, list) else [value], len(context.found.mistakes)
    if not items:
        context.found.add((key,), f"{key} is an empty list", "leave it out, or give one entry per sensor")
    for i, item in enumerate(items):
        path, where = ((key, i), f" entry {i + 1}") if isinstance(value, list) else ((key,), "")
        if item is None and isinstance(value, list) and key != "prices":
            continue
        if isinstance(item, bool) or not isinstance(item, int | float) or not np.isfinite(item):
            hint = "null in a list: none for this sensor" if key != "prices" else ""
            context.found.add(path, f"{key}{where} is {shown(item)}, it must be a number", hint)
    return None if len(context.found.mistakes) > before else value


def read_filter(entry: Filter, context: Context) -> EnsembleFilter | UnscentedFilter | None:
    """The options of the named filter; keys of the other one are mistakes."""
    if entry.name not in FILTERS:
        context.found.add(("filter", "name"), f"unknown filter '{entry.name}'", suggest(entry.name, FILTERS))
        return None
    kind = FILTERS[entry.name]
    options = {f.name for f in dataclasses.fields(kind) if f.init}
    given = {key: value for key, value in entry.model_dump().items() if value is not None and key != "name"}
    wrong = [key for key in given if key not in options]
    for key in wrong:
        context.found.add(("filter", key), f"'{key}' is no option of {entry.name}", suggest(key, options), key=True)
    filter_ = context.attempt(kind, "filter", **{key: given[key] for key in given if key not in wrong})
    return None if wrong else filter_


def read_moments(entry: MomentsEntry, context: Context) -> Moments | None:
    """Plain moments, with square covariances."""
    parts = {key: context.constant(getattr(entry, key), "moments", key) for key in ("state", "cross", "measurement")}
    if any(value is None for value in parts.values()):
        return None
    known = len(context.found.mistakes)
    for key in ("state", "measurement"):
        rows, columns = parts[key].shape  # type: ignore[union-attr]
        if rows != columns:
            context.found.add(("moments", key), f"{key} is {rows}x{columns}, it must be square")
    return None if len(context.found.mistakes) > known else Moments(**parts)  # type: ignore[arg-type]


def read_plant(document: Any, context: Context) -> NonlinearPlant | None:
    """The plant; its mistakes are moved to where the document holds the thing."""
    entry, initial, found = document.plant, document.initial, context.found
    assert entry is not None
    before = len(found.mistakes)
    covariance = None if initial is None else _covariance(initial.covariance, context)
    # where something cannot be read, a stand-in lets the rest be looked at
    n = covariance.shape[0] if covariance is not None else state_count(document)
    mean = None if initial is None or initial.mean is None else _mean(initial.mean, n, context)
    noise = None if document.noise is None else context.constant(document.noise, "noise")
    entries = None
    if entry.f is not None:
        entries = context.entries(entry.f, "plant", "f", variables=(*[f"x{i + 1}" for i in range(n)], "t"))
        entries = [0.0] * count_of(entry.f) if entries is None else entries
    if covariance is not None and entry.size is not None and entry.size != n:
        what = f"covariance is {covariance.shape[0]}x{covariance.shape[1]}, but the plant's size is {entry.size}"
        found.add(("initial", "covariance"), what, f"for example {{identity: {entry.size}, scale: 1.0}}")
    parameters = {} if entry.forcing is None else {"forcing": entry.forcing}
    if parameters and entry.model is None:
        found.add(("plant", "forcing"), "'forcing' belongs to a model, not to f", "write it into f", key=True)
        parameters = {}
    known = len(found.mistakes)
    plant = context.attempt(
        NonlinearPlant,
        "plant",
        covariance=np.eye(n) if covariance is None else covariance,
        mean=mean,
        f=entries,
        model=entry.model,
        parameters=parameters,
        step=entry.step,
        substeps=entry.substeps,
        noise=noise,
    )
    moved = {"covariance": ("initial", "covariance"), "mean": ("initial", "mean"), "noise": ("noise",)}
    found.mistakes[known:] = [
        m.moved((*moved[str(m.path[1])], *m.path[2:])) if len(m.path) > 1 and m.path[1] in moved else m
        for m in found.mistakes[known:]
    ]
    return plant if len(found.mistakes) == before else None


def read_measurement(entry: Measurement, states: int, context: Context) -> NonlinearMeasurement | None:
    """The sensors of a plant with so many states."""
    before, entries = len(context.found.mistakes), None
    if entry.h is not None:
        names = (*[f"x{i + 1}" for i in range(states)], "t")
        entries = context.entries(entry.h, "measurement", "h", variables=names)
        entries = [0.0] * count_of(entry.h) if entries is None else entries
    measurement = context.attempt(
        NonlinearMeasurement, "measurement", states=states, h=entries, model=entry.model, names=entry.names
    )
    return measurement if len(context.found.mistakes) == before else None


def count_of(value: object) -> int:
    """How many entries a list has that could not be read; a bare entry is one."""
    return len(value) if isinstance(value, list) and value else 1


def state_count(document: Any) -> int:
    """The number of states that a document means whose initial covariance cannot be read."""
    plant, initial = document.plant, document.initial
    given = None if initial is None else initial.covariance
    mean = None if initial is None else initial.mean
    if isinstance(given, dict):
        given = given.get("diag") or [0] * (given["random"] if type(given.get("random")) is int else 0)
    said = [len(item) for item in (given, plant.f, mean) if isinstance(item, list) and item]
    said += [plant.size] if plant.size else []
    return min(max(said, key=said.count), LARGEST_SIZE) if said else 1


def _spread(
    value: dict, key: str, allowed: tuple[str, ...], path: tuple[str, ...], context: Context
) -> tuple[float, float, int] | None:
    """(low, high, seed) of a random shorthand, or None after a mistake."""
    known = len(context.found.mistakes)
    for other in value:
        if other not in allowed:
            context.found.add((*path, other), f"unknown key '{other}'", suggest(str(other), allowed), key=True)
    span, seed = value.get(key, [0.5, 1.5]), value.get("seed", 0)
    numbers = isinstance(span, list) and len(span) == 2 and all(type(e) in (int, float) for e in span)
    if not numbers or not np.all(np.isfinite(span)) or not span[0] <= span[1]:
        said = f"[{span[0]:g}, {span[1]:g}]" if numbers else shown(span)
        context.found.add((*path, key), f"{key} is {said}, it must be [low, high]", f"for example {key}: [0.5, 1.5]")
    if isinstance(seed, bool) or not isinstance(seed, int) or seed < 0:
        context.found.add((*path, "seed"), f"seed is {shown(seed)}", "a whole number, at least 0")
    return None if len(context.found.mistakes) > known else (float(span[0]), float(span[1]), seed)


def _mean(value: object, n: int, context: Context) -> np.ndarray | None:
    if isinstance(value, dict):
        spread = _spread(value, "uniform", ("uniform", "seed"), ("initial", "mean"), context)
        return None if spread is None else np.random.default_rng(spread[2]).uniform(spread[0], spread[1], n)
    return context.vector(value, "initial", "mean")


def _covariance(value: object, context: Context) -> np.ndarray | None:
    """A matrix, or a random one with eigenvalues spread evenly over a range and random directions."""
    if not (isinstance(value, dict) and "random" in value):
        return context.constant(value, "initial", "covariance")
    path, n = ("initial", "covariance"), value["random"]
    spread = _spread(value, "eigenvalues", ("random", "eigenvalues", "seed"), path, context)
    if isinstance(n, bool) or not isinstance(n, int) or not 1 <= n <= LARGEST_SIZE:
        context.found.add((*path, "random"), f"random is {shown(n)}", f"the number of states, 1 to {LARGEST_SIZE}")
        return None
    if spread is None:
        return None
    directions, upper = np.linalg.qr(np.random.default_rng(spread[2]).standard_normal((n, n)))
    directions = directions * np.sign(np.diag(upper))
    matrix = (directions * np.linspace(spread[0], spread[1], n)) @ directions.T
    return (matrix + matrix.T) / 2

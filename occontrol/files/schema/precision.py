"""Problem files of the family precision: the document, the problem from it, and the document from a problem."""

from __future__ import annotations

import dataclasses
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Discriminator, Field, Tag, WithJsonSchema

from occontrol.core.nonlinear_measurement import NonlinearMeasurement
from occontrol.core.nonlinear_plant import LARGEST_SIZE, NonlinearPlant
from occontrol.equations.moments import Moments
from occontrol.families.precision_problem import Problem
from occontrol.files.plain_json import plain
from occontrol.files.schema.common import (
    Context,
    Entries,
    Expect,
    Matrix,
    Method,
    Strict,
    Whole,
    options_document,
    prune,
)
from occontrol.files.schema.matrices import ENTRY, MATRIX_SCHEMA
from occontrol.files.schema.words import shown, suggest
from occontrol.filtering.ensemble import EnsembleFilter
from occontrol.filtering.unscented import UnscentedFilter
from occontrol.solvers.pruning import Pruning

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


def _word(value: Any) -> Any:
    return {"name": value} if isinstance(value, str) else value


def _prune_kind(value: Any) -> str:
    return "options" if isinstance(value, dict) else "flag"


AnyPrune = Annotated[Annotated[Prune, Tag("options")] | Annotated[bool, Tag("flag")], Discriminator(_prune_kind)]


class Document(Strict):
    """A problem file of the family precision."""

    family: Literal["precision"]
    name: str | None = None
    plant: Plant | None = None
    measurement: Measurement | None = None
    initial: Initial | None = None
    noise: Matrix = None
    filter: Annotated[Filter, BeforeValidator(_word)] | None = None
    moments: MomentsEntry | None = None
    bound: Bound = Field(description="bound: {factor: 0.6} or bound: {matrix: ..}")
    batch: Whole = 1
    batches: Whole = 1
    caps: Numbers = None
    prices: Numbers = None
    fixed: Numbers = None
    prune: AnyPrune = False
    truth: Truth | None = None
    method: Method = None
    expect: Expect = None


def build(document: Document, context: Context) -> Problem:
    """The problem that the document describes; ProblemError with every mistake."""
    from occontrol.families import family_module

    found = context.found
    name, expect = context.title(document.name), context.expect(document.expect)
    methods = family_module("precision").METHODS
    method = None if document.method is None else context.method(document.method, methods)
    numbers = {key: _numbers(getattr(document, key), key, context) for key in ("caps", "prices", "fixed")}
    matrix = None if document.bound.matrix is None else context.constant(document.bound.matrix, "bound", "matrix")
    pruning = None
    if isinstance(document.prune, Prune):
        pruning = context.attempt(Pruning, "prune", **document.prune.model_dump())
    elif document.prune:
        pruning = Pruning()
    plant = measurement = moments = None
    filter_ = None if document.filter is None else _filter(document.filter, context)
    if document.moments is not None:
        moments = _moments(document.moments, context)
        for key in ("plant", "initial", "noise", "measurement", "filter", "truth"):
            if getattr(document, key) is not None:
                found.add((key,), f"'{key}' does not go with moments", "moments stand for all of them", key=True)
    elif document.plant is None:
        found.add(
            (), "the problem has neither 'plant' nor 'moments'", "plant, measurement, initial, filter; or moments"
        )
    else:
        hints = {
            "measurement": "measurement: {model: sigmoid} or {h: [..]}",
            "initial": "initial: {mean: .., covariance: ..}",
            "filter": "filter: {name: enkf, members: 41} or {name: ukf}",
        }
        for key, hint in hints.items():
            if getattr(document, key) is None:
                found.add((), f"the problem has no '{key}'", hint, key=True)
        plant = _plant(document, context)
        if document.measurement is not None and plant is not None:
            entries = None
            if document.measurement.h is not None:
                names = (*[f"x{i + 1}" for i in range(plant.states)], "t")
                entries = context.entries(document.measurement.h, "measurement", "h", variables=names)
            if document.measurement.h is None or entries is not None:
                measurement = context.attempt(
                    NonlinearMeasurement,
                    "measurement",
                    states=plant.states,
                    h=entries,
                    model=document.measurement.model,
                    names=document.measurement.names,
                )
    found.raise_if_any()
    problem = context.attempt(
        Problem,
        name=name,
        moments=moments,
        plant=plant,
        measurement=measurement,
        filter=filter_,
        bound_factor=document.bound.factor,
        bound_matrix=matrix,
        batch=document.batch,
        batches=document.batches,
        prune=pruning,
        truth_seed=document.truth.seed if document.truth is not None else 0,
        method=method,
        expect=expect,
        **numbers,
    )
    found.raise_if_any()
    return problem


def _numbers(value: Any, key: str, context: Context) -> Any:
    """A number, or a list of numbers and null; what is wrong is noted."""
    if value is None:
        return None
    items = value if isinstance(value, list) else [value]
    if not items:
        context.found.add((key,), f"{key} is an empty list", "leave it out, or give one entry per sensor")
    for i, item in enumerate(items):
        path, where = ((key, i), f" entry {i + 1}") if isinstance(value, list) else ((key,), "")
        if item is None and isinstance(value, list) and key != "prices":
            continue
        if isinstance(item, bool) or not isinstance(item, int | float) or not np.isfinite(item):
            hint = "null in a list: none for this sensor" if key != "prices" else ""
            context.found.add(path, f"{key}{where} is {shown(item)}, it must be a number", hint)
    return None if context.found.mistakes else value


def _filter(entry: Filter, context: Context) -> Any:
    if entry.name not in FILTERS:
        context.found.add(("filter", "name"), f"unknown filter '{entry.name}'", suggest(entry.name, FILTERS))
        return None
    kind = FILTERS[entry.name]
    options = {f.name for f in dataclasses.fields(kind) if f.init}
    given = {key: value for key, value in entry.model_dump().items() if value is not None and key != "name"}
    wrong = [key for key in given if key not in options]
    for key in wrong:
        context.found.add(("filter", key), f"'{key}' is no option of {entry.name}", suggest(key, options), key=True)
    return None if wrong else context.attempt(kind, "filter", **given)


def _moments(entry: MomentsEntry, context: Context) -> Moments | None:
    parts = {key: context.constant(getattr(entry, key), "moments", key) for key in ("state", "cross", "measurement")}
    if any(value is None for value in parts.values()):
        return None
    known = len(context.found.mistakes)
    for key in ("state", "measurement"):
        rows, columns = parts[key].shape  # type: ignore[union-attr]
        if rows != columns:
            context.found.add(("moments", key), f"{key} is {rows}x{columns}, it must be square")
    return None if len(context.found.mistakes) > known else Moments(**parts)  # type: ignore[arg-type]


def _plant(document: Document, context: Context) -> NonlinearPlant | None:
    """The plant; its mistakes are moved to where the document holds the thing."""
    entry, initial = document.plant, document.initial
    assert entry is not None
    covariance = None if initial is None else _covariance(initial.covariance, context)
    if covariance is None:
        return None
    n = covariance.shape[0]
    mean = None if initial is None or initial.mean is None else _mean(initial.mean, n, context)
    noise = None if document.noise is None else context.constant(document.noise, "noise")
    entries = None
    if entry.f is not None:
        entries = context.entries(entry.f, "plant", "f", variables=(*[f"x{i + 1}" for i in range(n)], "t"))
        if entries is None:
            return None
    if entry.size is not None and entry.size != n:
        what = f"covariance is {covariance.shape[0]}x{covariance.shape[1]}, but the plant's size is {entry.size}"
        context.found.add(("initial", "covariance"), what, f"for example {{identity: {entry.size}, scale: 1.0}}")
        return None
    parameters = {} if entry.forcing is None else {"forcing": entry.forcing}
    if parameters and entry.model is None:
        context.found.add(("plant", "forcing"), "'forcing' belongs to a model, not to f", "write it into f", key=True)
    known = len(context.found.mistakes)
    plant = context.attempt(
        NonlinearPlant,
        "plant",
        covariance=covariance,
        mean=mean,
        f=entries,
        model=entry.model,
        parameters=parameters,
        step=entry.step,
        substeps=entry.substeps,
        noise=noise,
    )
    moved = {"covariance": ("initial", "covariance"), "mean": ("initial", "mean"), "noise": ("noise",)}
    context.found.mistakes[known:] = [
        m.moved((*moved[str(m.path[1])], *m.path[2:])) if len(m.path) > 1 and m.path[1] in moved else m
        for m in context.found.mistakes[known:]
    ]
    return plant


def _spread(value: dict, key: str, allowed: tuple[str, ...], path: tuple[str, ...], context: Context) -> Any:
    """(low, high, seed) of a random shorthand, or None after a mistake."""
    known = len(context.found.mistakes)
    for other in value:
        if other not in allowed:
            context.found.add((*path, other), f"unknown key '{other}'", suggest(str(other), allowed), key=True)
    span, seed = value.get(key, [0.5, 1.5]), value.get("seed", 0)
    numbers = isinstance(span, list) and len(span) == 2 and all(type(e) in (int, float) for e in span)
    if not numbers or not np.all(np.isfinite(span)) or not span[0] <= span[1]:
        context.found.add((*path, key), f"{key} is {shown(span)}", f"{key}: [low, high]")
    if isinstance(seed, bool) or not isinstance(seed, int) or seed < 0:
        context.found.add((*path, "seed"), f"seed is {shown(seed)}", "a whole number, at least 0")
    return None if len(context.found.mistakes) > known else (float(span[0]), float(span[1]), seed)


def _mean(value: Any, n: int, context: Context) -> np.ndarray | None:
    if isinstance(value, dict):
        spread = _spread(value, "uniform", ("uniform", "seed"), ("initial", "mean"), context)
        return None if spread is None else np.random.default_rng(spread[2]).uniform(spread[0], spread[1], n)
    return context.vector(value, "initial", "mean")


def _covariance(value: Any, context: Context) -> np.ndarray | None:
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


def document(problem: Problem) -> dict[str, Any]:
    """The problem as a JSON-able document with everything in it; `build` of it gives the identical problem."""
    result: dict[str, Any] = {"family": "precision", "name": problem.name}
    if problem.moments is not None:
        m = problem.moments
        result["moments"] = {key: getattr(m, key).tolist() for key in ("state", "cross", "measurement")}
    else:
        plant, measurement = problem.plant, problem.measurement
        assert plant is not None and measurement is not None
        entry = {"model": plant.model, "size": plant.states, **plant.parameters, "f": plain(plant.f)}
        substeps = None if plant.step is None else int(plant.substeps)
        result["plant"] = prune({**entry, "step": plant.step, "substeps": substeps})
        h = plain(measurement.h)
        result["measurement"] = prune({"model": measurement.model, "h": h, "names": list(measurement.names)})
        result["initial"] = {"mean": plant.mean.tolist(), "covariance": plant.covariance.tolist()}
        result["noise"] = plant.noise.tolist()
        result["filter"] = {"name": problem.filter.name, **options_document(problem.filter)}  # type: ignore[union-attr, dict-item]
        result["truth"] = {"seed": problem.truth_seed}
    matrix = None if problem.bound_matrix is None else np.asarray(problem.bound_matrix).tolist()
    result["bound"] = prune({"factor": problem.bound_factor, "matrix": matrix})
    result |= {"batch": int(problem.batch), "batches": int(problem.batches)}
    for key, none in (("caps", np.isinf), ("prices", np.isnan), ("fixed", np.isnan)):
        values = getattr(problem, key)
        if not np.all(none(values)):
            result[key] = [None if none(v) else float(v) for v in values]
    if problem.prune is not None:
        result["prune"] = prune(dataclasses.asdict(problem.prune))
    result["method"] = options_document(problem.method)
    result["expect"] = None if problem.expect is None else plain(problem.expect)
    return prune(result)

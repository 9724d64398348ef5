"""Problem files of the family precision: the document, the problem from it, and the document from a problem."""

from __future__ import annotations

import dataclasses
from typing import Annotated, Literal

import numpy as np
from pydantic import BeforeValidator, Field

from occontrol.core.errors import Path
from occontrol.core.kinds import PlainDict
from occontrol.families.precision.measurement import NonlinearMeasurement
from occontrol.families.precision.plant import NonlinearPlant
from occontrol.families.precision.problem import SIZE_WORDS, Problem
from occontrol.families.precision.pruning import Pruning
from occontrol.families.precision.schema_parts import (
    AnyPrune,
    Bound,
    Filter,
    Initial,
    Measurement,
    MomentsEntry,
    Numbers,
    Plant,
    Prune,
    Truth,
    by_name,
    count_of,
    read_filter,
    read_measurement,
    read_moments,
    read_numbers,
    read_plant,
    state_count,
)
from occontrol.families.precision.unscented import UnscentedFilter
from occontrol.files.plain_json import plain
from occontrol.files.schema.common import (
    Context,
    Expect,
    Matrix,
    Method,
    ProblemDocument,
    Whole,
    options_document,
    prune,
)


class Document(ProblemDocument):
    """A problem file of the family precision."""

    family: Literal["precision"]
    plant: Plant | None = None
    measurement: Measurement | None = None
    initial: Initial | None = None
    noise: Matrix = None
    filter: Annotated[Filter, BeforeValidator(by_name)] | None = None
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
    from occontrol.families.precision.family import FAMILY

    found = context.found
    name, expect = context.title(document.name), context.expect(document.expect)
    method = None if document.method is None else context.method(document.method, FAMILY.methods)
    numbers = {key: read_numbers(getattr(document, key), key, context) for key in ("caps", "prices", "fixed")}
    matrix = None if document.bound.matrix is None else context.constant(document.bound.matrix, "bound", "matrix")
    pruning = None
    if isinstance(document.prune, Prune):
        pruning = context.attempt(Pruning, "prune", **document.prune.model_dump())
    elif document.prune:
        pruning = Pruning()
    plant = measurement = moments = None
    filter_ = None if document.filter is None else read_filter(document.filter, context)
    states = 1
    if document.moments is not None:
        moments = read_moments(document.moments, context)
        for key in ("plant", "initial", "noise", "measurement", "filter", "truth"):
            if getattr(document, key) is not None:
                found.add((key,), f"'{key}' does not go with moments", "moments stand for all of them", key=True)
        filter_ = None
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
        plant = read_plant(document, context)
        states = state_count(document) if plant is None else plant.states
        if document.measurement is not None:
            measurement = read_measurement(document.measurement, states, context)
    # stand-ins for what is already known to be wrong let the problem look at all the rest
    before, parts = len(found.mistakes), {"moments": moments, "plant": plant, "measurement": measurement}
    if before and moments is None:
        parts = _stand_ins(document, plant, measurement, states)
        filter_ = filter_ or UnscentedFilter()
    problem = context.attempt(
        Problem,
        name=name,
        **parts,
        filter=filter_,
        bound_factor=1.0 if matrix is None and document.bound.matrix is not None else document.bound.factor,
        bound_matrix=matrix,
        batch=document.batch,
        batches=document.batches,
        prune=pruning,
        truth_seed=document.truth.seed if document.truth is not None else 0,
        method=method,
        expect=expect,
        **numbers,
    )
    unsure: set[Path] = set()
    if moments is None and plant is None:
        unsure.add(("bound", "matrix"))
    counted = moments is not None or plant is not None or (document.measurement and document.measurement.h)
    if not counted or (moments is None and any(m.path == ("batch",) for m in found.mistakes)):
        unsure |= {("caps",), ("prices",), ("fixed",)}
    found.mistakes[before:] = [
        m for m in found.mistakes[before:] if m.path not in unsure or not any(word in m.what for word in SIZE_WORDS)
    ]
    found.raise_if_any()
    return problem


def _stand_ins(
    document: Document, plant: NonlinearPlant | None, measurement: NonlinearMeasurement | None, states: int
) -> PlainDict:
    """A plant and sensors of the right sizes, in place of parts that cannot be built."""
    entry = document.measurement
    sensors = states if entry is None or entry.h is None else count_of(entry.h)
    return {
        "plant": plant or NonlinearPlant(np.eye(states), f=[0.0] * states),
        "measurement": measurement or NonlinearMeasurement(states, h=[0.0] * sensors),
    }


def document(problem: Problem) -> PlainDict:
    """The problem as a JSON-able document with everything in it; `build` of it gives the identical problem."""
    result: PlainDict = {"family": "precision", "name": problem.name}
    if problem.moments is not None:
        m = problem.moments
        result["moments"] = {key: getattr(m, key).tolist() for key in ("state", "cross", "measurement")}
    else:
        plant, measurement, filter_ = problem.dynamics("write")
        entry = {"model": plant.model, "size": plant.states, **plant.parameters, "f": plain(plant.f)}
        substeps = None if plant.step is None else int(plant.substeps)
        result["plant"] = prune({**entry, "step": plant.step, "substeps": substeps})
        h = plain(measurement.h)
        result["measurement"] = prune({"model": measurement.model, "h": h, "names": list(measurement.names or ())})
        result["initial"] = {"mean": plant.mean.tolist(), "covariance": plant.covariance.tolist()}
        result["noise"] = plant.noise.tolist()
        result["filter"] = {"name": filter_.name, **(options_document(filter_) or {})}
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

"""Nonlinear plants in problem files: from the document to a plant linearised along its path, and the way back."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol, cast

import numpy as np

from occontrol.core.errors import Path
from occontrol.core.plant import DiscretePlant, LinearPlant
from occontrol.core.sensor import IDLE, Sensor, idle_sensor
from occontrol.core.state_labels import default_names
from occontrol.families.athans.nonlinear.documents import (
    FormulaPlantEntry,
    FormulaSensorEntry,
    Integrator,
    Replan,
)
from occontrol.families.athans.nonlinear.linearise import Replanning, linearise
from occontrol.families.athans.nonlinear.nominal import IntegratorOptions, and_beyond
from occontrol.families.athans.nonlinear.plant import FormulaPlant, wrong_names
from occontrol.families.athans.nonlinear.sensor import FormulaSensor
from occontrol.files.schema.common import Context

if TYPE_CHECKING:
    from occontrol.families.athans.nonlinear.documents import FormulaSamplesDocument, FormulaStepsDocument


class FormulaRateDocument(Protocol):
    """What is read of a document of continuous sensing."""

    plant: FormulaPlantEntry
    sensors: list[FormulaSensorEntry | str]
    integrator: Integrator | None
    replan: Replan | None


RATE_SPANS = 100  # of a horizon of continuous sensing: `integrator.substeps` are of each of them
System = tuple[LinearPlant | DiscretePlant, list[Sensor]]


def read_system(
    document: FormulaStepsDocument | FormulaSamplesDocument | FormulaRateDocument,
    clock: str,
    origin: float,
    since: np.ndarray,
    looked: np.ndarray,
    context: Context,
) -> System | None:
    """The linear plant and sensors along the nominal path; None after a mistake, which is noted.

    Parameters
    ----------
    document : with formulas
    clock : "steps", "samples" or "rate"
    origin : a time
    since : (G+1,) times of the spans, counted from `origin`
    looked : (K,) times of readings; of continuous sensing start and end
    context : where mistakes are noted
    """
    found = context.found
    integrator = _options(IntegratorOptions, document.integrator, "integrator", context)
    replan = _options(Replanning, document.replan, "replan", context)
    plant = _plant(document.plant, clock, context)
    if plant is None:
        return None
    stated = [
        None if isinstance(entry, str) else _sensor(entry, j, plant, clock, context)
        for j, entry in enumerate(document.sensors)
    ]
    for j, entry in enumerate(document.sensors):
        if isinstance(entry, str) and entry != IDLE:
            found.add(
                ("sensors", j), f"sensor {j + 1} is the word '{entry}'", "idle, or {name: .., h: [..], noise: ..}"
            )
    names = [s.name for s in stated if s is not None]
    for j, sensor in enumerate(stated):
        if (
            sensor is not None
            and sensor.name in names[: names.index(sensor.name)] + names[names.index(sensor.name) + 1 :]
        ):
            found.add(("sensors", j, "name"), f"the name '{sensor.name}' is used twice", "sensor names must differ")
            break
    if found.mistakes or len(since) < 2:
        return None
    real = [s for s in stated if s is not None]
    before = len(found.mistakes)
    made = context.attempt(
        linearise, plant=plant, sensors=real, origin=origin, since=since, looked=looked,
        integrator=integrator, replan=replan, readings=clock != "rate",
    )  # fmt: skip
    if made is None:
        places = [j for j, s in enumerate(stated) if s is not None]
        found.mistakes[before:] = [
            m.moved(("sensors", places[int(m.path[1])], *m.path[2:])) if m.path[:1] == ("sensors",) else m
            for m in found.mistakes[before:]
        ]
        return None
    linear, by_name = made
    n = len(plant.names)
    return linear, [idle_sensor(n) if s is None else by_name[s.name] for s in stated]


def read_rate_system(
    document: FormulaRateDocument,
    edges: Sequence[float] | np.ndarray | None,
    predict_at: float | None,
    context: Context,
) -> tuple[LinearPlant | None, list[Sensor]]:
    """The same for continuous sensing; no plant and no sensors after a mistake.

    Parameters
    ----------
    document : with formulas
    edges : (N+1,) of the intervals, in the unit of time, or None after a mistake
    predict_at : as stated, or None
    context : where mistakes are noted
    """
    times = np.asarray([] if edges is None else edges, dtype=float)
    since, start = np.zeros(0), 0.0
    if len(times):
        # not the edges: a solver may add some, and the path of the run that it writes is to be the same
        start, length = float(times[0]), float(times[-1] - times[0])
        since = length * np.arange(RATE_SPANS + 1) / RATE_SPANS
        since = and_beyond(since, (times[-1] if predict_at is None else predict_at) - start)
    found = read_system(document, "rate", start, since, times[[0, -1]] if len(times) else times, context)
    return (None, []) if found is None else (cast(LinearPlant, found[0]), found[1])


def _options(kind: type, entry: Integrator | Replan | None, key: str, context: Context):
    if entry is None:
        return None
    return context.attempt(kind, key, **entry.model_dump())


def _plant(entry: FormulaPlantEntry, clock: str, context: Context) -> FormulaPlant | None:
    """The plant; its mistakes are moved to where the document holds the thing."""
    found = context.found
    before = len(found.mistakes)
    if entry.f is not None and entry.next is not None:
        found.add(
            ("plant", "next"), "the plant has both 'f' and 'next'", "f: rates of change, next: discrete time", True
        )
    elif (entry.f is not None) == (clock == "steps") or (entry.f is None and entry.next is None):
        key = "f" if entry.f is not None else "next" if entry.next is not None else None
        if key is None:
            found.add(("plant",), "the plant has neither 'f' nor 'next'", "f: [formulas of dx/dt]", True)
        elif key == "f":
            hint = "next: [..], the state one step later; or horizon: {start: .., end: .., samples: ..}"
            found.add(("plant", "f"), "f is a rate of change, and the horizon counts steps", hint, True)
        else:
            hint = "horizon: {steps: ..}, or f: [..], the rate of change"
            found.add(("plant", "next"), "next is the state one step later, and the horizon is of times", hint, True)
    if len(found.mistakes) > before:
        return None
    key = "f" if entry.f is not None else "next"
    stated = entry.f if entry.f is not None else entry.next
    count = len(stated) if isinstance(stated, list) else 1
    parameters = {name: p.model_dump() for name, p in (entry.parameters or {}).items()}
    names = tuple(entry.states) if entry.states else tuple(default_names(count))
    variable = "k" if clock == "steps" else "t"
    known = (*names, *parameters, variable)
    found.mistakes += [m.under("plant") for m in wrong_names(names, parameters)]
    if len(found.mistakes) > before:
        return None
    formulas = context.entries(stated, "plant", key, variables=known)
    noise = context.rows(entry.noise, "plant", "noise", variables=known)
    if entry.initial.covariance == "none":
        what = "covariance is none, and a nonlinear plant is linearised from what is known at the start"
        found.add(("plant", "initial", "covariance"), what, "parameters: {p: {mean: .., sd: none}}, or a wide prior")
        return None
    covariance = context.constant(entry.initial.covariance, "plant", "initial", "covariance")
    mean = entry.initial.mean
    mean = None if mean is None else context.vector(mean, "plant", "initial", "mean")
    nominal = None if entry.nominal is None else context.signal(entry.nominal, "plant", "nominal", variable=variable)
    if len(found.mistakes) > before:
        return None
    plant = context.attempt(
        FormulaPlant, "plant", noise=noise, covariance=covariance, mean=mean, states=entry.states,
        parameters=parameters, nominal=nominal, units=tuple(entry.units or ()), **{key: formulas},
    )  # fmt: skip
    moved: dict[Path, Path] = {("plant", word): ("plant", "initial", word) for word in ("covariance", "mean")}
    found.mistakes[before:] = [
        m.moved((*moved.get(m.path[:2], m.path[:2]), *m.path[2:])) for m in found.mistakes[before:]
    ]
    return plant


def _sensor(
    entry: FormulaSensorEntry, j: int, plant: FormulaPlant, clock: str, context: Context
) -> FormulaSensor | None:
    found, path = context.found, ("sensors", j)
    before = len(found.mistakes)
    known = (*plant.names, plant.variable)
    h = None
    if (entry.h is None) == (entry.C is None):
        lacking = "both h and C" if entry.h is not None else "no 'h'"
        found.add(path, f"sensor '{entry.name}' has {lacking}", "h: [formulas of the states], or C: rows", True)
    elif entry.h is not None:
        h = context.entries(entry.h, *path, "h", variables=known)
    else:
        rows = context.rows(entry.C, *path, "C", variables=(plant.variable,))
        h = None if rows is None else _products(rows, plant, entry.name, j, context)
    noise = _noise(entry, j, known, clock, context)
    cost = context.signal(entry.cost, *path, "cost", variable=plant.variable)
    if len(found.mistakes) > before:
        return None
    angle = entry.angle
    if not isinstance(angle, bool) and not (isinstance(angle, list) and all(isinstance(a, bool) for a in angle)):
        found.add((*path, "angle"), f"angle of sensor '{entry.name}' is {angle!r}", "true, false, or a list of these")
        return None
    visible = None
    if entry.visible is not None:
        read = context.entries(entry.visible, *path, "visible", variables=known)
        if read is not None and len(read) != 1:
            what = f"visible of sensor '{entry.name}' has {len(read)} entries"
            found.add((*path, "visible"), what, "one formula, above 0 where the sensor can be used")
        if len(found.mistakes) > before or read is None:
            return None
        visible = read[0]
    return context.attempt(
        FormulaSensor, *path, name=entry.name, h=h, noise=noise, plant=plant, cost=cost, angle=angle,
        visible=visible, windows=entry.windows,
    )  # fmt: skip


def _products(rows: list[list[float | str]], plant: FormulaPlant, name: str, j: int, context: Context):
    """C x as formulas."""
    n = len(plant.names)
    if len(rows[0]) != n:
        what = f"C of sensor '{name}' is {len(rows)}x{len(rows[0])}, but the plant has {n} states and parameters"
        context.found.add(("sensors", j, "C"), what, "a row of C has one entry per state")
        return None
    return [" + ".join(f"({c})*{x}" for c, x in zip(row, plant.names, strict=True)) for row in rows]


def _noise(entry: FormulaSensorEntry, j: int, known: tuple[str, ...], clock: str, context: Context):
    """Rows of the intensity, or of the covariance of one reading; None after a mistake."""
    found, path, name = context.found, ("sensors", j), entry.name
    if (entry.noise is None) == (entry.variance is None):
        what = f"sensor '{name}' has no 'noise'" if entry.noise is None else f"sensor '{name}' has noise and variance"
        found.add(path, what, "noise: [[0.1]]", True)
        return None
    key = "noise" if entry.variance is None else "variance"
    if clock != "rate" and entry.every is not None:
        what = f"sensor '{name}': every belongs to continuous sensing"
        found.add((*path, "every"), what, "a reading is taken at the sample times of the horizon", True)
        return None
    if clock == "rate" and (key == "variance") != (entry.every is not None):
        what = "the variance of one reading needs 'every'" if key == "variance" else "every belongs to a variance"
        found.add((*path, key), f"sensor '{name}': {what}", "noise: the intensity, or variance with every")
        return None
    if entry.every is not None and not entry.every > 0:
        found.add((*path, "every"), f"every is {entry.every:g}, it must be a time above 0", "the time between readings")
        return None
    rows = context.rows(getattr(entry, key), *path, key, variables=known)
    if rows is None or entry.every is None:
        return rows
    return [[e * entry.every if isinstance(e, float) else f"({e})*{entry.every!r}" for e in row] for row in rows]

"""Problem files of the family hybrid: the document, the problem from it, and the document from a problem."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from pydantic import Field, create_model

from occontrol.core.errors import ProblemError
from occontrol.core.kinds import PlainDict
from occontrol.families.hybrid.guard import Guard, Threshold
from occontrol.families.hybrid.methods import METHODS
from occontrol.families.hybrid.plant import JumpPlant, Mode
from occontrol.families.hybrid.problem import Problem
from occontrol.families.hybrid.sensor import JumpSensor
from occontrol.files.schema.common import (
    Context,
    DatedHorizon,
    Entries,
    Expect,
    Matrix,
    Method,
    ProblemDocument,
    Strict,
    Vector,
    Whole,
    dates_document,
    options_document,
    plain,
    prune,
)

CRITERION = "bhattacharyya"


class Horizon(DatedHorizon):
    steps: Whole = Field(description="steps: how many k there are")


class ModeEntry(Strict):
    name: str = Field(description="name: a word")
    A: Matrix = Field(description="A: a list of rows")
    F: Matrix = None
    W: Matrix = Field(description="W: the covariance of the noise")
    B: Matrix = None
    input: Entries = None


# made by a call because `from` cannot be written as an attribute
GuardEntry = create_model(
    "GuardEntry",
    __base__=Strict,
    **{
        "from": (str, Field(description="from: the name of a mode")),
        "to": (str, Field(description="to: the name of a mode")),
        "L": (Matrix, Field(description="L: rows with one entry per state, then one per entry of the threshold")),
        "b": (Vector, Field(description="b: one number per row of L")),
    },  # type: ignore[call-overload]
)


class ThresholdEntry(Strict):
    mean: Vector = Field(description="mean: a list of numbers")
    covariance: Matrix = None


class Transition(Strict):
    matrix: Matrix = None
    guards: list[GuardEntry] | None = None  # type: ignore[valid-type]
    threshold: ThresholdEntry | None = None


class Initial(Strict):
    mean: Vector = None
    covariance: Matrix = Field(description="covariance: {diag: [..]} or rows")
    probabilities: Entries = None


class SensorEntry(Strict):
    name: str = Field(description="name: a word")
    C: Matrix = Field(description="C: a list of rows, one entry per state")
    R: Matrix = Field(description="R: the covariance of the sensor noise")


class Criterion(Strict):
    name: str = CRITERION
    position_weight: float = 0.0
    position: list[Whole] | None = None


class TruthEntry(Strict):
    mean: Vector = None
    covariance: Matrix = None
    mode: str | None = None


class Simulation(Strict):
    runs: Whole = 100
    seed: Whole = 1
    truth: TruthEntry = TruthEntry()


class Document(ProblemDocument):
    """A problem file of the family hybrid."""

    family: Literal["hybrid"]
    horizon: Horizon = Field(description="horizon: {steps: ..}")
    modes: list[ModeEntry] = Field(description="modes: a list of {name: .., A: .., F: .., W: ..}", min_length=1)
    transition: Transition = Field(description="transition: {matrix: [[..]]} or {guards: [..], threshold: {..}}")
    initial: Initial = Field(description="initial: {mean: .., covariance: .., probabilities: ..}")
    sensors: list[SensorEntry] = Field(description="sensors: a list of {name: .., C: .., R: ..}", min_length=1)
    groups: list[list[str]] | None = None
    criterion: Criterion = Criterion()
    simulation: Simulation = Simulation()
    method: Method = None
    expect: Expect = None


def build(document: Document, context: Context) -> Problem:
    """The problem that the document describes; ProblemError with every mistake."""
    found, criterion, truth = context.found, document.criterion, document.simulation.truth
    name = context.title(document.name)
    method = context.method(document.method, METHODS)
    expect = context.expect(document.expect)
    if criterion.name != CRITERION:
        found.add(("criterion", "name"), f"unknown criterion '{criterion.name}'", f"known: {CRITERION}")
    where = ("simulation", "truth")
    mean = None if truth.mean is None else context.vector(truth.mean, *where, "mean")
    covariance = None if truth.covariance is None else context.constant(truth.covariance, *where, "covariance")
    plant = _plant(document, context)
    if plant is None:
        # a document without a usable mode always has a mistake that was noted
        raise ProblemError(found.mistakes)
    # stand-ins for what is already known to be wrong let the problem look at all the rest
    problem = context.attempt(
        Problem,
        name=name,
        plant=plant,
        sensors=[_sensor(entry, j, plant.states, context) for j, entry in enumerate(document.sensors)],
        steps=document.horizon.steps,
        groups=document.groups,
        position_weight=criterion.position_weight,
        position=criterion.position,
        runs=document.simulation.runs,
        seed=document.simulation.seed,
        truth_mean=mean,
        truth_covariance=covariance,
        truth_mode=truth.mode,
        method=method,
        expect=expect,
        calendar=context.calendar,
    )
    found.raise_if_any()
    return problem


def _plant(document: Document, context: Context) -> JumpPlant | None:
    """The plant, with stand-ins for wrong parts, which are noted; None when no mode can be built."""
    found, initial = context.found, document.initial
    modes = [_mode(entry, j, context) for j, entry in enumerate(document.modes)]
    known = next((mode for mode in modes if mode is not None), None)
    covariance = context.constant(initial.covariance, "initial", "covariance")
    mean = None if initial.mean is None else context.vector(initial.mean, "initial", "mean")
    probabilities = None if initial.probabilities is None else _row(initial.probabilities, context)
    transitions = _transitions(document.transition, context)
    if known is None:
        return None
    n = known.A.shape[0]
    complete = all(mode is not None for mode in modes) and covariance is not None and transitions is not None
    if complete:
        arguments = {"covariance": covariance, "mean": mean, "probabilities": probabilities, **(transitions or {})}
        plant = context.attempt(JumpPlant, modes=modes, **arguments)
        if plant is not None:
            return plant
    elif not found.mistakes:
        return None
    names = dict.fromkeys(entry.name for entry in document.modes)
    stand_ins = [Mode(name, np.eye(n), np.zeros((n, n))) for name in names]
    matrix = np.full((len(names), len(names)), 1.0 / len(names))
    return JumpPlant(stand_ins, np.zeros((n, n)), transition_matrix=matrix)


def _mode(entry: ModeEntry, j: int, context: Context) -> Mode | None:
    parts = {key: getattr(entry, key) for key in ("A", "F", "W", "B")}
    read = {
        key: context.signal(value, "modes", j, key, variable="k")
        for key, value in parts.items()
        if value is not None or key in ("A", "W")
    }
    if entry.input is not None:
        read["input"] = context.entries(entry.input, "modes", j, "input", variables=("k",))  # type: ignore[assignment]
    if any(value is None for value in read.values()):
        return None
    return context.attempt(Mode, "modes", j, name=entry.name, **read)


def _row(value: object, context: Context) -> np.ndarray | None:
    """Numbers and formulas without variables, such as '1/3'."""
    matrix = context.constant([value] if isinstance(value, list) else value, "initial", "probabilities")
    return None if matrix is None else matrix[0]


def _transitions(entry: Transition, context: Context) -> PlainDict | None:
    result: PlainDict = {}
    # with neither of them the plant complains, unless a mistake in `transition` is known already
    lost = (
        entry.matrix is None
        and entry.guards is None
        and any(m.path[:1] == ("transition",) for m in context.found.mistakes)
    )
    if entry.matrix is not None:
        result["transition_matrix"] = context.constant(entry.matrix, "transition", "matrix")
        lost = result["transition_matrix"] is None
    if entry.guards is not None:
        guards = [_guard(guard, g, context) for g, guard in enumerate(entry.guards)]
        lost = lost or any(guard is None for guard in guards)
        result["guards"] = guards
    if entry.threshold is not None:
        path = ("transition", "threshold")
        mean = context.vector(entry.threshold.mean, *path, "mean")
        covariance = None
        if entry.threshold.covariance is not None:
            covariance = context.constant(entry.threshold.covariance, *path, "covariance")
            lost = lost or covariance is None
        threshold = (
            None if mean is None or lost else context.attempt(Threshold, *path, mean=mean, covariance=covariance)
        )
        lost = lost or threshold is None
        result["threshold"] = threshold
    return None if lost else result


def _guard(entry: Any, g: int, context: Context) -> Guard | None:
    path = ("transition", "guards", g)
    L, b = context.constant(entry.L, *path, "L"), context.vector(entry.b, *path, "b")
    if L is None or b is None:
        return None
    return context.attempt(Guard, *path, source=getattr(entry, "from"), target=entry.to, L=L, b=b)


def _sensor(entry: SensorEntry, j: int, states: int, context: Context) -> JumpSensor:
    """The sensor; a plain one in its place when there is a mistake (that is noted)."""
    C = context.signal(entry.C, "sensors", j, "C", variable="k")
    R = context.signal(entry.R, "sensors", j, "R", variable="k")
    if C is not None and R is not None:
        sensor = context.attempt(JumpSensor, "sensors", j, name=entry.name, C=C, R=R)
        if sensor is not None:
            return sensor
    return JumpSensor(entry.name, np.ones((1, states)), np.ones((1, 1)))


def document(problem: Problem) -> PlainDict:
    """The problem as a JSON-able document with everything in it; `build` of it gives the identical problem."""
    plant = problem.plant
    if plant.guards is None:
        transition: PlainDict = {"matrix": np.asarray(plant.transition_matrix).tolist()}
    else:
        guards = [
            {"from": guard.source, "to": guard.target, "L": guard.L.tolist(), "b": guard.b.tolist()}
            for guard in plant.guards
        ]
        transition = {"guards": guards}
        if plant.threshold is not None and plant.threshold.size:
            mean, covariance = plant.threshold.mean, plant.threshold.covariance
            transition["threshold"] = {"mean": mean.tolist(), "covariance": covariance.tolist()}
    initial = {"mean": plant.mean, "covariance": plant.covariance, "probabilities": plant.probabilities}
    truth = {"mean": problem.truth_mean, "covariance": problem.truth_covariance, "mode": problem.truth_mode}
    return prune(
        {
            "family": "hybrid",
            "name": problem.name,
            "horizon": {"steps": int(problem.steps), **dates_document(problem)},
            "modes": [_mode_document(mode) for mode in plant.modes],
            "transition": transition,
            "initial": plain(initial),
            "sensors": [{"name": s.name, "C": s.C.document(), "R": s.R.document()} for s in problem.sensors],
            "groups": [list(group) for group in problem.groups or ()],
            "criterion": {
                "name": CRITERION,
                "position_weight": float(problem.position_weight),
                "position": [int(i) for i in problem.position or ()],
            },
            "simulation": {"runs": int(problem.runs), "seed": int(problem.seed), "truth": prune(plain(truth))},
            "method": options_document(problem.method),
            "expect": None if problem.expect is None else plain(problem.expect),
        }
    )


def _mode_document(mode: Mode) -> PlainDict:
    values = {name: signal.document() for name, signal in mode.signals.items()}
    if isinstance(values.get("input"), list):
        values["input"] = [row[0] for row in values["input"]]
    return {"name": mode.name, **values}

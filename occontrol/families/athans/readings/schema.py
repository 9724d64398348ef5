"""Problem files with readings at instants: discrete time (`horizon: {steps: ..}`), and `sensing: samples`."""

from __future__ import annotations

import numpy as np

from occontrol.core.errors import Path, ProblemError
from occontrol.core.kinds import PlainDict
from occontrol.core.plant import DiscretePlant, LinearPlant
from occontrol.core.sensor import IDLE, Sensor, idle_sensor
from occontrol.core.signal import ConstantSignal, Signal
from occontrol.families.athans.criteria.schema import choice_of
from occontrol.families.athans.criteria.statement import PEAK
from occontrol.families.athans.growth import beyond_numbers
from occontrol.families.athans.methods import ALL_METHODS
from occontrol.families.athans.nonlinear.documents import FormulaSamplesDocument, FormulaStepsDocument
from occontrol.families.athans.nonlinear.linearise import linearisation_of
from occontrol.families.athans.nonlinear.nominal import and_beyond
from occontrol.families.athans.nonlinear.schema import read_system
from occontrol.families.athans.nonlinear.written import options_documents, sensor_document
from occontrol.families.athans.nonlinear.written import plant_document as formula_plant_document
from occontrol.families.athans.readings.clock import SampleTimes, Steps, evenly
from occontrol.families.athans.readings.documents import (
    ReadingsObjective,
    SamplesDocument,
    SamplesHorizon,
    SamplesSensor,
    StepsDocument,
    StepsPlant,
    StepsSensor,
)
from occontrol.families.athans.readings.problem import ReadingsProblem
from occontrol.families.athans.rules.schema import constraints
from occontrol.families.athans.schema_parts import (
    NONE,
    has_prior,
    initial_covariance,
    labels_document,
    or_none,
    plant_document,
    plant_of,
    select_of,
)
from occontrol.files.schema.common import (
    Context,
    options_document,
    plain,
    prune,
)

MOST_SAMPLES = 1_000_000


def build(document: StepsDocument | SamplesDocument, context: Context) -> ReadingsProblem:
    """The problem that the document describes; ProblemError with every mistake."""
    found, objective = context.found, document.objective
    variable = "k" if isinstance(document, StepsDocument) else "t"
    if isinstance(document, StepsDocument):
        horizon = document.horizon
        clock = context.attempt(Steps, "horizon", steps=horizon.steps, epoch=horizon.epoch)
        predict_at = None
    else:
        clock = _sample_times(document.horizon, context)
        predict_at = document.horizon.predict_at
    plant, sensors = _system(document, clock, variable, context)
    states = 1 if plant is None else plant.states
    method = None if document.method is None else context.method(document.method, ALL_METHODS)
    output = _output(objective, predict_at, states, variable, context)
    running = None
    if objective.running is not None:
        running = context.signal(objective.running, "objective", "running", variable=variable)
    select = select_of(document.select, context)
    expect = context.expect(document.expect)
    if plant is None or clock is None:
        found.raise_if_any()
        raise ProblemError(found.mistakes)
    problem = context.attempt(
        ReadingsProblem,
        name=context.title(document.name),
        plant=plant,
        sensors=sensors,
        clock=clock,
        output=output,
        predict_at=predict_at,
        at=objective.at,
        cost_weight=objective.cost_weight,
        running=running,
        running_at=objective.running_at,
        select=1 if select is None else select,
        budget=document.budget,
        method=method,
        expect=expect,
        rules=constraints(document.constraints, document.sensors),
        minimise=objective.minimise,
        criterion=choice_of(objective.criterion),
        prior=has_prior(document.plant.initial, getattr(document.plant, "parameters", None)),
        calendar=context.calendar,
    )
    found.raise_if_any()
    if not problem.discrete:
        found.mistakes += beyond_numbers(problem.plant, np.array([problem.clock.start, problem.clock.end]))
        found.raise_if_any()
    return problem


def _system(
    document: StepsDocument | SamplesDocument, clock: Steps | SampleTimes | None, variable: str, context: Context
) -> tuple[LinearPlant | DiscretePlant | None, list[Sensor]]:
    """The plant and its sensors; None for the plant where nothing can be made of it."""
    if isinstance(document, FormulaStepsDocument | FormulaSamplesDocument):
        origin, since = (0.0, np.zeros(0)) if clock is None else (clock.start, clock.nodes)
        if isinstance(clock, SampleTimes):
            at = document.horizon.predict_at  # type: ignore[union-attr]
            since = and_beyond(clock.since, (clock.end if at is None else at) - clock.start)
        looked = np.zeros(0) if clock is None else clock.times
        kind = "steps" if isinstance(document, FormulaStepsDocument) else "samples"
        return read_system(document, kind, origin, since, looked, context) or (None, [])
    if isinstance(document, StepsDocument):
        plant = steps_plant(document.plant, context)
    else:
        plant = plant_of(document.plant, context)
    states = 1 if plant is None else plant.states
    return plant, [sensor_of(entry, j, states, variable, context) for j, entry in enumerate(document.sensors)]


def _output(
    objective: ReadingsObjective, predict_at: float | None, states: int, variable: str, context: Context
) -> Signal:
    """D; zero where only a running weight counts, all states where a peak does."""
    nothing = ConstantSignal(np.zeros((1, states)))
    if objective.output is not None:
        return context.signal(objective.output, "objective", "output", variable=variable) or nothing
    peak = objective.criterion is not None and objective.criterion.name == PEAK
    if objective.running is None and not peak:
        hint = "output: the rows D of what is to be predicted, or running: a weight at every reading"
        context.found.add(("objective",), "objective has neither 'output' nor 'running'", hint, True)
    elif predict_at is not None:
        what = "predict_at is given without an output that is predicted"
        context.found.add(("horizon", "predict_at"), what, "add objective.output, or leave predict_at out", True)
    return ConstantSignal(np.eye(states)) if peak else nothing


def _sample_times(horizon: SamplesHorizon, context: Context) -> SampleTimes | None:
    if (horizon.sample_times is None) == (horizon.samples is None):
        both = horizon.samples is not None
        what = "horizon has both 'samples' and 'sample_times'" if both else "horizon has no 'sample_times'"
        hint = "give one of them" if both else "sample_times: [0, 0.5, ..], or samples: 60"
        context.found.add(("horizon", "samples") if both else ("horizon",), what, hint, True)
        return None
    times = horizon.sample_times
    if times is None:
        count = horizon.samples or 0
        if not 1 <= count <= MOST_SAMPLES:
            what = f"horizon.samples is {count}"
            context.found.add(("horizon", "samples"), what, f"a whole number from 1 to {MOST_SAMPLES}")
            return None
        if not horizon.end > horizon.start:
            what = f"the horizon ends at {horizon.end:g}, which is not after its start {horizon.start:g}"
            context.found.add(("horizon", "end"), what, "end must lie after start")
            return None
        first = horizon.start if horizon.first is None else horizon.first
        times = evenly(first, first + horizon.end - horizon.start, count)
    elif horizon.first is not None:
        context.found.add(("horizon", "first"), "first belongs to samples", "leave it out beside sample_times", True)
        return None
    return context.attempt(SampleTimes, "horizon", times=times, start=horizon.start, end=horizon.end)


def steps_plant(entry: StepsPlant, context: Context) -> DiscretePlant | None:
    """The plant of discrete time; with stand-ins for what is wrong (that is noted), as long as F can be had."""
    signals = {
        key: None if value is None else context.signal(value, "plant", key, variable="k")
        for key, value in (("F", entry.F), ("G", entry.G), ("Q", entry.Q))
    }
    covariance = initial_covariance(entry.initial, context)
    mean = None if entry.initial.mean is None else context.vector(entry.initial.mean, "plant", "initial", "mean")
    if signals["F"] is None:
        return None
    n = signals["F"].shape[0]
    lost = entry.G is not None and signals["G"] is None
    Q = np.zeros((n, n)) if signals["Q"] is None or lost else signals["Q"]
    known = len(context.found.mistakes)
    plant = context.attempt(
        DiscretePlant, "plant", F=signals["F"], G=None if lost else signals["G"], Q=Q,
        covariance=np.zeros((n, n)) if covariance is None else covariance, mean=mean,
        names=tuple(entry.states or ()), units=tuple(entry.units or ()),
    )  # fmt: skip
    if plant is None:
        moved: dict[Path, Path] = {("plant", key): ("plant", "initial", key) for key in ("covariance", "mean")}
        fresh = context.found.mistakes[known:]
        context.found.mistakes[known:] = [m.moved(moved.get(m.path[:2], m.path[:2])) for m in fresh]
    return plant


def sensor_of(entry: StepsSensor | SamplesSensor | str, j: int, states: int, variable: str, context: Context) -> Sensor:
    """The sensor; one that measures nothing in its place when there is a mistake (that is noted)."""
    if isinstance(entry, str):
        return idle_sensor(states)
    if isinstance(entry, StepsSensor):
        C = context.signal(entry.H, "sensors", j, "H", variable="k")
        noise = context.signal(entry.R, "sensors", j, "R", variable="k")
    else:
        C = context.signal(entry.C, "sensors", j, "C")
        noise = _reading_noise(entry, j, context)
    cost = context.signal(entry.cost, "sensors", j, "cost", variable=variable)
    sensor, known = None, len(context.found.mistakes)
    if C is not None and noise is not None and cost is not None:
        given: PlainDict = {"C": C, "noise": noise, "cost": cost, "windows": entry.windows, "variable": variable}
        sensor = context.attempt(Sensor, "sensors", j, name=entry.name, **given)
    if isinstance(entry, StepsSensor):
        context.found.mistakes[known:] = [_in_letters(m, j) for m in context.found.mistakes[known:]]
    return sensor or Sensor(
        f"sensor {j + 1}" if sensor is None else entry.name, np.zeros((0, states)), np.zeros((0, 0)), variable=variable
    )


def _in_letters(mistake, j: int):
    """A mistake about C or noise in the letters of discrete time."""
    letters = {"C": "H", "noise": "R"}
    if mistake.path[:2] != ("sensors", j) or len(mistake.path) < 3 or mistake.path[2] not in letters:
        return mistake
    return mistake.moved((*mistake.path[:2], letters[str(mistake.path[2])], *mistake.path[3:]))


def _reading_noise(entry: SamplesSensor, j: int, context: Context) -> Signal | None:
    """noise or variance, the covariance of one reading; `every` belongs to continuous sensing."""
    found, path, name = context.found, ("sensors", j), entry.name
    if entry.every is not None:
        what = f"sensor '{name}': every belongs to continuous sensing"
        found.add((*path, "every"), what, "a reading is taken at the sample times of the horizon", True)
    if (entry.noise is None) == (entry.variance is None):
        what = f"sensor '{name}' has no 'noise'" if entry.noise is None else f"sensor '{name}' has noise and variance"
        found.add(path, what, "noise: [[0.1]], the covariance of one reading", True)
        return None
    key = "noise" if entry.variance is None else "variance"
    return context.signal(entry.noise if key == "noise" else entry.variance, *path, key)


def steps_plant_document(plant: DiscretePlant) -> PlainDict:
    """A plant in discrete time as it stands in a problem file."""
    system = {"F": plant.F.document(), "G": or_none(plant.G), "Q": plant.Q.document(), **labels_document(plant)}
    return prune({**system, "initial": {"mean": plant.mean.tolist(), "covariance": plant.covariance.tolist()}})


def document(problem: ReadingsProblem) -> PlainDict:
    """The problem as a JSON-able document with everything in it; `build` of it gives the identical problem."""
    clock, plant, least_most = problem.clock, problem.plant, list(problem.select)
    linearised = linearisation_of(problem)
    if isinstance(clock, Steps):
        horizon: PlainDict = {"steps": clock.steps, "epoch": clock.epoch}
        system = {} if linearised is not None else steps_plant_document(plant)
    else:
        horizon = {"start": clock.start, "end": clock.end, "sample_times": clock.times.tolist()}
        nothing = problem.running is not None and not np.any(problem.output.at(problem.output_at))
        horizon["predict_at"] = None if nothing else problem.predict_at
        system = {} if linearised is not None else plant_document(plant)
    if linearised is not None:
        system = formula_plant_document(linearised)
    horizon |= {} if problem.calendar is None else problem.calendar.document()
    stated = not (problem.running is not None and not np.any(problem.output.at(problem.output_at)))
    objective = {
        "cost_weight": float(problem.cost_weight),
        "output": problem.output.document() if stated else None,
        "at": problem.at if problem.discrete else None,
        "running": or_none(problem.running),
        "running_at": None if problem.running is None else problem.running_at,
        "minimise": None if problem.minimise == "cost" else problem.minimise,
        "criterion": None if problem.criterion is None else problem.criterion.document(),
    }
    if not problem.prior and linearised is None:
        system["initial"] = {"mean": plant.mean.tolist(), "covariance": NONE}
    result = {
        "family": "athans",
        "name": problem.name,
        "horizon": prune(horizon),
        "sensing": "samples",
        "plant": prune(system),
        "sensors": [_sensor_document(s, problem) for s in problem.sensors if s.name in problem.listed],
        "select": least_most[1] if problem.budget is not None or not problem.ranged else least_most,
        "budget": None if problem.budget is None else {key: int(b) for key, b in problem.budget.items()},
        "constraints": None if problem.rules is None else problem.rules.document(),
        "objective": prune(objective),
        "method": options_document(problem.method),
        "expect": None if problem.expect is None else plain(problem.expect),
        **({} if linearised is None else options_documents(linearised)),
    }
    return prune(result)


def _sensor_document(sensor: Sensor, problem: ReadingsProblem) -> PlainDict | str:
    if sensor.name == IDLE and sensor.is_idle:
        return IDLE
    windows = None if sensor.windows is None else [list(window) for window in sensor.windows]
    C, R = ("H", "R") if problem.discrete else ("C", "noise")
    own = None if problem.rules is None else problem.rules.sensors.get(sensor.name)
    stated = {} if own is None else own.document()
    if (linearised := linearisation_of(problem)) is not None:
        return {**sensor_document(linearised.sensors[sensor.name]), **stated}
    values = {"name": sensor.name, C: sensor.C.document(), R: sensor.noise.document()}
    return prune({**values, "cost": sensor.cost.document(), "windows": windows, **stated})

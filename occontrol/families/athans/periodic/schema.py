"""Problem files without an end: the problem from a document, and the document from a problem."""

from __future__ import annotations

from occontrol.core.errors import ProblemError
from occontrol.core.kinds import PlainDict
from occontrol.core.method import Method
from occontrol.core.sensor import IDLE, Sensor
from occontrol.families.athans.methods import ALL_METHODS
from occontrol.families.athans.periodic.documents import (
    CycleSensor,
    EndlessContinuousDocument,
    EndlessDocument,
    EndlessRules,
    EndlessSensor,
    EndlessStepsDocument,
)
from occontrol.families.athans.periodic.limits import CycleLimits
from occontrol.families.athans.periodic.problem import PeriodicProblem
from occontrol.families.athans.readings.documents import SamplesSensor, StepsSensor
from occontrol.families.athans.readings.schema import sensor_of, steps_plant, steps_plant_document
from occontrol.families.athans.schema_parts import plant_document, plant_of, select_of
from occontrol.families.athans.sensor_noise import sensor_noise
from occontrol.files.schema.common import Context, options_document, plain, prune

RULES = {"min_on", "max_uses"}  # keys that are of the cycle, not of the sensor


def build(document: EndlessDocument, context: Context) -> PeriodicProblem:
    """The problem that the document describes; ProblemError with every mistake."""
    found, objective = context.found, document.objective
    sensing, variable, step = "steps", "k", 1.0
    if isinstance(document, EndlessContinuousDocument):
        sensing, variable, step = document.sensing, "t", document.horizon.step
        plant = plant_of(document.plant, context)
    elif isinstance(document, EndlessStepsDocument):
        plant = steps_plant(document.plant, context)
    else:
        raise ProblemError("the document is of neither kind")
    entries = document.sensors
    for key in ("output", "at"):
        if getattr(objective, key) is not None:
            what, hint = f"{key} belongs to a horizon that ends", "running: a weight that counts for ever"
            found.add(("objective", key), what, hint, True)
    states = 1 if plant is None else plant.states
    running = context.signal(objective.running, "objective", "running", variable=variable)
    sensors = [_sensor(entry, j, states, sensing, context) for j, entry in enumerate(entries)]
    select, method = select_of(document.select, context), None
    if document.method is not None:
        method = context.method(document.method, ALL_METHODS)
    expect = context.expect(document.expect)
    if plant is None or running is None:
        found.raise_if_any()
        raise ProblemError(found.mistakes)
    problem = context.attempt(
        PeriodicProblem,
        name=context.title(document.name),
        plant=plant,
        sensors=sensors,
        running=running,
        sensing=sensing,
        step=step,
        running_at=objective.running_at,
        cost_weight=objective.cost_weight,
        select=1 if select is None else select,
        method=method,
        expect=expect,
        limits=_limits(document),
        repeat=document.horizon.repeat,
    )
    found.raise_if_any()
    return problem


def _limits(document: EndlessDocument) -> CycleLimits | None:
    """The rules of the file: those of a sensor before those of all; None without any."""
    stated: list[CycleSensor] = [s for s in document.sensors if not isinstance(s, str)]  # type: ignore[attr-defined]
    all_ = document.constraints or EndlessRules(min_on=None, max_uses=None, max_switches=None)
    found: dict[str, dict] = {}
    for key in ("min_on", "max_uses"):
        values = {s.name: getattr(s, key) if getattr(s, key) is not None else getattr(all_, key) for s in stated}  # type: ignore[attr-defined]
        found[key] = {name: value for name, value in values.items() if value is not None}
    if not any(found.values()) and all_.max_switches is None:
        return None
    return CycleLimits(found["min_on"], found["max_uses"], all_.max_switches)


def _sensor(entry, j: int, states: int, sensing: str, context: Context) -> Sensor:
    """The sensor; one that measures nothing in its place when there is a mistake (that is noted)."""
    if not isinstance(entry, EndlessSensor):
        shaped = entry if isinstance(entry, str) else StepsSensor(**entry.model_dump(exclude=RULES))
        return sensor_of(shaped, j, states, "k", context)
    if sensing == "samples" or entry.name == "":
        return sensor_of(SamplesSensor(**entry.model_dump(exclude=RULES)), j, states, "t", context)
    C = context.signal(entry.C, "sensors", j, "C")
    noise = sensor_noise(entry.noise, entry.variance, entry.every, entry.name, ("sensors", j), context)
    cost, sensor = context.signal(entry.cost, "sensors", j, "cost"), None
    if C is not None and noise is not None and cost is not None:
        sensor = context.attempt(
            Sensor, "sensors", j, name=entry.name, C=C, noise=noise, cost=cost, windows=entry.windows
        )
    return sensor or sensor_of("idle", j, states, "t", context)


def document(problem: PeriodicProblem) -> PlainDict:
    """The problem as a JSON-able document with everything in it; `build` of it gives the identical problem."""
    horizon: PlainDict = {"infinite": True, "repeat": None if problem.repeat is None else float(problem.repeat)}
    if problem.discrete:
        system = steps_plant_document(problem.stepped)
    else:
        horizon["step"] = float(problem.step)
        system = plant_document(problem.flowing)
    stated = list(problem.select) if IDLE not in problem.listed else problem.select[1]
    result = {
        "family": "athans",
        "name": problem.name,
        "horizon": prune(horizon),
        "sensing": "rate" if problem.sensing == "rate" else "samples",
        "plant": system,
        "sensors": [_sensor_document(s, problem) for s in problem.sensors if s.name in problem.listed],
        "select": stated,
        "constraints": _rules_document(problem.limits),
        "objective": {
            "cost_weight": float(problem.cost_weight),
            "running": problem.running.document(),
            "running_at": None if problem.sensing == "rate" else problem.running_at,
        },
        "method": method_document(problem.method),
        "expect": None if problem.expect is None else plain(problem.expect),
    }
    result["objective"] = prune(result["objective"])
    return prune(result)


def _rules_document(limits: CycleLimits | None) -> PlainDict | None:
    return None if limits is None or limits.max_switches is None else {"max_switches": limits.max_switches}


def method_document(method: Method | None) -> PlainDict | None:
    """The options; no time limit is said, for a file without any has one."""
    stated = options_document(method)
    if stated is not None and getattr(method, "time_limit", None) is None:
        stated["time_limit"] = None
    return stated


def _sensor_document(sensor: Sensor, problem: PeriodicProblem) -> PlainDict | str:
    if sensor.name == IDLE and sensor.is_idle:
        return IDLE
    C, R = ("H", "R") if problem.discrete else ("C", "noise")
    rules = {} if problem.limits is None else problem.limits.of_sensor(sensor.name)
    values = {"name": sensor.name, C: sensor.C.document(), R: sensor.noise.document()}
    windows = None if sensor.windows is None else [list(window) for window in sensor.windows]
    return prune({**values, "cost": sensor.cost.document(), "windows": windows, **rules})

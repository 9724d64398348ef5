"""Rules on looks (dwell, slews, revisit): a few targets on one resource as one plant with a sensor for every target.

What the family does with rules on schedules (families/athans/rules) then holds for looks: a look that dwells is a use
of at least so long, a slew is the delay of a change to another target, or to one from rest, and revisit the longest
time without a use.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from occontrol.core.errors import Mistake, ProblemError
from occontrol.core.method import Method
from occontrol.core.plant import LinearPlant
from occontrol.core.sensor import IDLE, Sensor, idle_sensor
from occontrol.core.signal import ConstantSignal, Signal, TableSignal
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.families.athans.rules.statement import Constraints, SensorRules
from occontrol.families.athans.targets.groups import LookSet
from occontrol.families.athans.targets.one_target import look_sensor, root_of
from occontrol.families.athans.targets.problem import TargetsProblem

MOST_STATES = 150
_WORDS = "rules on looks (dwell, slew, revisit)"


@dataclass(frozen=True)
class LookRules:
    """What the file asks of looks beside capacities.

    Parameters
    ----------
    dwell : {model: intervals} that a look lasts at least, where that is more than one
    slew : {resource: time} between looks at different targets, and before a look after rest
    revisit : {target: time} that it may at most go without a look
    """

    dwell: Mapping[str, int]
    slew: Mapping[str, float]
    revisit: Mapping[str, float]

    def __bool__(self) -> bool:
        return bool(self.dwell or self.slew or self.revisit)


def as_one_plant(problem: TargetsProblem, rules: LookRules, method: Method | None) -> SchedulingProblem:
    """The problem of one plant whose sensors are called TARGET@RESOURCE.

    Parameters
    ----------
    problem : TargetsProblem
    rules : LookRules
    method : of the family

    Raises ProblemError where rules on looks make no sense: see `_mistakes`.
    """
    from scipy.linalg import block_diag

    if found := _mistakes(problem, rules):
        raise ProblemError(found)
    resource, n, step = problem.resources[0], problem.states, float(problem.steps[0])
    A, noise, start, mean, running, outputs, sensors, own = [], [], [], [], [], [], [], {}
    at = 0
    for group in problem.groups:
        for i, name in enumerate(group.names):
            states = np.arange(at, at + group.states)
            at += group.states
            one, intensity = group.plant_of(i)
            A.append(one.at(0.0))
            noise.append(intensity.at(0.0))
            start.append(group.covariance[i])
            mean.append(group.mean[i])
            running.append(group.weight[i] * group.running[i])
            outputs.append(root_of(float(group.weight[i]) * group.terminal[i]))
            called, open_ = f"{name}@{resource.name}", _open(problem, group.looks, i)
            if not np.any(open_):
                continue
            narrow = look_sensor(problem, group, group.looks[0], i, called)
            windows = None if np.all(open_) else _windows(open_, problem.edges)
            sensors.append(Sensor(called, _wide(narrow.C, states, n), narrow.noise, narrow.cost, windows))
            dwell = rules.dwell.get(group.model)
            own[called] = SensorRules(min_on=dwell * step if dwell else None, revisit=rules.revisit.get(name))
    R, D = block_diag(*running), block_diag(*outputs)
    names = [sensor.name for sensor in sensors]
    slew = rules.slew.get(resource.name)
    delay = {a: {b: slew for b in names if b != a} for a in [*names, IDLE]} if slew else None
    return SchedulingProblem(
        name=problem.name,
        plant=LinearPlant(block_diag(*A), block_diag(*noise), block_diag(*start), np.concatenate(mean)),
        sensors=[*sensors, idle_sensor(n)],
        edges=problem.edges,
        output=D[np.any(D != 0, axis=1)] if np.any(D) else np.zeros((1, n)),
        cost_weight=problem.cost_weight,
        running=R if np.any(R) else None,
        select=int(np.max(resource.capacity)),
        method=method,
        expect=problem.expect,
        integration=problem.integration,
        rules=Constraints(sensors=own, switch_delay=delay),
    )


def _mistakes(problem: TargetsProblem, rules: LookRules) -> list[Mistake]:
    """Why these rules are not for this problem, by their places in its file."""
    found, first = [], problem.resources[0]
    capacity = first.capacity
    given = np.unique(capacity[capacity > 0])
    if len(problem.resources) > 1:
        what = f"{_WORDS} are for one resource, there are {len(problem.resources)}"
        found.append(Mistake(("resources",), what, "one file for each resource, or leave the rules out"))
    elif len(given) > 1:
        what = f"{_WORDS} need a capacity that stays the same, it is {given[0]} to {given[-1]}"
        found.append(Mistake(("resources", 0, "capacity"), what, "a number; windows close it"))
    elif rules.slew and given[-1] > 1:
        what = f"a slew is from one target to the next, the capacity of '{first.name}' is {given[-1]}"
        found.append(Mistake(("resources", 0, "slew"), what, "capacity: 1, or leave slew out"))
    if problem.states > MOST_STATES:
        what = f"{_WORDS} are for at most {MOST_STATES} states in all, there are {problem.states}"
        found.append(Mistake(("targets",), what, "fewer targets, or leave the rules out"))
    if rules.dwell and np.ptp(problem.steps) > 1e-9 * problem.steps[0]:
        what = "a dwell of several intervals needs intervals of equal length"
        found.append(Mistake(("horizon",), what, "intervals: N in the place of edges"))
    for group in problem.groups:
        if len(group.looks) > len(problem.resources):
            what = f"{_WORDS} need one kind of look at '{group.model}', there are {len(group.looks)}"
            found.append(Mistake(("looks",), what, "give model: to the others, or leave them out"))
        if not all(signal.constant for signal in (group.A, group.noise) if isinstance(signal, Signal)):
            what = f"{_WORDS} need models that do not change with time"
            found.append(Mistake(("target_models", group.model), what, "numbers in A and noise"))
    return found


def _open(problem: TargetsProblem, looks: Sequence[LookSet], i: int) -> np.ndarray:
    """(N,) whether target i of a group may be looked at."""
    found = np.zeros(problem.intervals, dtype=bool)
    for each in looks:
        found[each.interval[each.target == i]] = True
    return found & (problem.resources[0].capacity > 0)


def _windows(open_: np.ndarray, edges: np.ndarray) -> list[tuple[float, float]]:
    """Stretches of open intervals as times."""
    change = np.diff(np.concatenate([[False], open_, [False]]).astype(int))
    first, last = np.flatnonzero(change > 0), np.flatnonzero(change < 0)
    return [(float(edges[a]), float(edges[b])) for a, b in zip(first, last, strict=True)]


def _wide(C: Signal, states: np.ndarray, n: int) -> Signal:
    """C of one target as that of all n states."""
    values = C.values if isinstance(C, TableSignal) else C.at(0.0)[None]
    full = np.zeros((*values.shape[:2], n))
    full[:, :, states] = values
    return TableSignal(C.times, full, C.interpolation) if isinstance(C, TableSignal) else ConstantSignal(full[0])

"""One target alone as a scheduling problem of its own: for filters, simulations and the check in continuous time."""

from __future__ import annotations

import numpy as np

from occontrol.core.errors import SolveFailed
from occontrol.core.look_schedule import LookSchedule
from occontrol.core.plant import LinearPlant
from occontrol.core.schedule import Schedule
from occontrol.core.sensor import IDLE, Sensor, idle_sensor
from occontrol.core.signal import ConstantSignal, Signal, TableSignal
from occontrol.families.athans.integration.options import Integration
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.families.athans.targets.groups import LookSet, TargetGroup
from occontrol.families.athans.targets.problem import TargetsProblem

CHECKED = 12  # targets that are integrated again: all where there are no more
RANK = 1e-14


def target_problem(problem: TargetsProblem, target: int) -> SchedulingProblem:
    """Target number `target` with a sensor for every resource that sees it, named TARGET@RESOURCE, and idle."""
    g, i = problem.group_of(target)
    group = problem.groups[g]
    A, noise = group.plant_of(i)
    plant = LinearPlant(A, noise, group.covariance[i], group.mean[i])
    sensors = [
        look_sensor(problem, group, looks, i, f"{group.names[i]}@{problem.resources[looks.resource].name}")
        for looks in group.looks
        if np.any(looks.target == i)
    ]
    w, n = float(group.weight[i]), group.states
    return SchedulingProblem(
        name=group.names[i],
        plant=plant,
        sensors=[*sensors, idle_sensor(n)],
        edges=problem.edges,
        output=root_of(w * group.terminal[i]),
        cost_weight=problem.cost_weight,
        running=w * group.running[i],
        select=max(1, len(sensors)),
        integration=Integration(substeps=problem.integration.substeps, windows="cover", refine=False),
    )


def target_schedule(problem: TargetsProblem, schedule: LookSchedule, target: int) -> Schedule:
    """The looks at one target as a schedule of `target_problem`."""
    g, i = problem.group_of(target)
    resources = [looks.resource for looks in problem.groups[g].looks if np.any(looks.target == i)]
    names = [f"{problem.groups[g].names[i]}@{problem.resources[rho].name}" for rho in resources]
    weights = np.zeros((problem.intervals, len(names) + 1))
    mine = np.flatnonzero(schedule.target == target)
    for j, rho in enumerate(resources):
        at = mine[schedule.resource[mine] == rho]
        weights[schedule.interval[at], j] = schedule.share[at]
    weights[:, -1] = max(1, len(names)) - np.sum(weights[:, :-1], axis=1)
    return Schedule(problem.edges, weights, (*names, IDLE))


def continuous_costs(
    problem: TargetsProblem, schedule: LookSchedule, costs: np.ndarray, most: int = CHECKED
) -> dict[int, float] | str:
    """What targets cost when they are integrated again in continuous time; the reason where that fails.

    Parameters
    ----------
    problem : TargetsProblem
    schedule : LookSchedule
    costs : (targets,) by the recursion: where not all can be looked at, the dearest and others evenly
    most : targets that are looked at
    """
    from occontrol.families.athans.continuous.reintegration import reintegrate

    chosen = np.arange(problem.targets)
    if problem.targets > most:
        evenly = np.linspace(0, problem.targets - 1, most // 2).astype(int)
        chosen = np.unique(np.concatenate([np.argsort(-costs)[: most // 2], evenly]))
    found = {}
    for target in chosen:
        try:
            one = target_problem(problem, int(target))
            check = reintegrate(one, target_schedule(problem, schedule, int(target)))
        except SolveFailed as error:
            return str(error).splitlines()[0]
        found[int(target)] = float(check.cost)
    return found


def look_sensor(problem: TargetsProblem, group: TargetGroup, looks: LookSet, i: int, name: str) -> Sensor:
    """The looks of one resource at target i of a group; where they change they are held from edge to edge.

    Parameters
    ----------
    problem : TargetsProblem
    group : of its targets
    looks : LookSet of the group
    i : number of the target in the group
    name : of the sensor
    """
    mine = np.flatnonzero(looks.target == i)
    which = looks.which[mine]
    if np.all(which == which[0]):
        s = which[0]
        return Sensor(name, ConstantSignal(looks.C[s]), ConstantSignal(looks.noise[s]), float(looks.cost[s]))
    held = np.zeros(problem.intervals, dtype=np.int64)
    held[looks.interval[mine]] = which
    before = np.zeros(problem.intervals, dtype=np.int64)
    known = np.zeros(problem.intervals, dtype=bool)
    known[looks.interval[mine]] = True
    before = np.maximum.accumulate(np.where(known, np.arange(problem.intervals), 0))
    held = np.where(known | (before > 0), held[before], which[0])

    def table(values: np.ndarray) -> Signal:
        return TableSignal(problem.edges[:-1], values[held], "previous")

    return Sensor(name, table(looks.C), table(looks.noise), table(looks.cost[:, None, None]))


def root_of(weight: np.ndarray) -> np.ndarray:
    """D with D'D = `weight` (n, n), at least one row."""
    values, vectors = np.linalg.eigh((weight + weight.T) / 2)
    kept = values > RANK * max(values[-1], 0.0)
    if not np.any(kept):
        return np.zeros((1, len(weight)))
    return (vectors[:, kept] * np.sqrt(values[kept])).T

"""Measurements along a chooser's own path, and the estimate along anybody's measurements."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from occontrol.core.arrange import STEP_SLACK, arrange, step_times
from occontrol.core.errors import plural
from occontrol.core.measurement import Estimate, Measurement
from occontrol.core.trajectory import Trajectory
from occontrol.families.hybrid.methods import GroupMethod
from occontrol.families.hybrid.problem import Problem
from occontrol.families.hybrid.runs import experiment


def simulate(problem: Problem, method: GroupMethod, seed: int = 0) -> tuple[list[Measurement], Trajectory]:
    """One seeded truth and the measurements that a method's chooser asks for along it.

    Parameters
    ----------
    problem : Problem
    method : that chooses
    seed : of the random generator

    Returns (measurements, truth): measurements at k = 1 .. steps, truth with values (steps+1, n).
    """
    from occontrol.families.hybrid.monte_carlo import run_some

    tried = dataclasses.replace(experiment(problem, method), seed=seed)
    runs = run_some(tried, tried.models(), [0])
    first = np.cumsum([0] + [sensor.rows for sensor in problem.sensors])
    measurements = []
    for k in range(1, problem.steps + 1):
        for j in tried.groups[runs.choices[0, k - 1]]:
            values = runs.truths.values[0, k - 1, first[j] : first[j + 1]]
            measurements.append(Measurement(float(k), problem.sensors[j].name, values))
    return measurements, Trajectory(np.arange(problem.steps + 1.0), runs.truths.states[0])


def run_filter(problem: Problem, measurements: Sequence[Measurement]) -> Estimate:
    """The jumping-mode estimate along measurements at whole steps; any sensors may report at a step, or none.

    Parameters
    ----------
    problem : Problem
    measurements : list of Measurement with time = k; a value that is NaN is missing

    Raises ProblemError for unknown sensors, wrong numbers of values, and times that are not steps.
    """
    from occontrol.families.hybrid.imm import filter_measurements

    readings = _readings(problem, measurements)
    found = filter_measurements(problem.plant, problem.sensors, int(problem.steps), readings)
    deviation = np.sqrt(np.maximum(np.diagonal(found.covariance, axis1=1, axis2=2), 0.0))
    empty, last = np.zeros((problem.steps + 1, 0)), int(np.argmax(found.probabilities[-1]))
    silent = sum(not found.dimension[k] for k in range(1, problem.steps + 1))
    holes = sum(int(np.isnan(values).sum()) for given in readings.values() for _, values in given)
    notes = [f"the most probable mode at the end is {problem.plant.names[last]} ({found.probabilities[-1, last]:.3g})"]
    if silent:
        notes.append(f"{silent} of {problem.steps} steps have no measurement: the estimate is predicted there")
    if holes:
        notes.append(f"{plural(holes, 'value')} missing: what else was read at these steps is used")
    return Estimate(
        times=np.arange(problem.steps + 1.0),
        mean=found.mean,
        standard_deviation=deviation,
        predicted=empty,
        predicted_deviation=empty,
        nis=found.nis,
        dimension=found.dimension,
        covariance=found.covariance,
        notes=tuple(notes),
    )


def _readings(problem: Problem, measurements: Sequence[Measurement]) -> dict[int, list[tuple[int, np.ndarray]]]:
    """Sensors and values by step, of the steps at which something was read."""
    sensors = problem.sensors
    arrived = arrange(
        step_times(1, int(problem.steps)),
        sensors.names,
        [sensor.rows for sensor in sensors],
        None,
        measurements,
        slack=STEP_SLACK,
        instants=True,
    )
    return {
        k: [(sensors.index(name), values) for name, values in given.items()]
        for k, given in enumerate(arrived, 1)
        if given
    }

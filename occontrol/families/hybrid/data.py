"""Measurements along a chooser's own path, and the estimate along anybody's measurements."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from occontrol.core.errors import Mistake, ProblemError
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
        notes.append(f"{holes} value{'s' * (holes != 1)} missing: what else was read at these steps is used")
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
    """Sensors and values by step; several mistakes are reported together."""
    readings: dict[int, list[tuple[int, np.ndarray]]] = {}
    found: list[Mistake] = []
    for m in measurements:
        place = f"line {m.line}" if m.line else ""
        k = round(m.time) if np.isfinite(m.time) else 0
        values = np.atleast_1d(np.asarray(m.values, dtype=float))
        if m.sensor not in problem.sensors.names:
            known = ", ".join(problem.sensors.names)
            found.append(Mistake((), f"there is no sensor '{m.sensor}'", f"the sensors are: {known}", place=place))
            continue
        j = problem.sensors.index(m.sensor)
        rows = problem.sensors[j].rows
        if abs(m.time - k) > 1e-9 or not 1 <= k <= problem.steps:
            found.append(Mistake((), f"t = {m.time:g} is not a step", f"t is 1, 2, .. {problem.steps}", place=place))
        elif values.shape != (rows,) or np.any(np.isinf(values)):
            came = "an infinite one" if values.shape == (rows,) else f"{values.size} came"
            what = f"sensor '{m.sensor}' has {rows} value{'s' * (rows != 1)}, {came}"
            found.append(Mistake((), what, "leave a missing value empty, or its line out", place=place))
        elif any(j == other for other, _ in readings.get(k, [])):
            found.append(Mistake((), f"sensor '{m.sensor}' reports twice at t = {k}", place=place))
        else:
            readings.setdefault(k, []).append((j, values))
    if found:
        raise ProblemError(found)
    return readings

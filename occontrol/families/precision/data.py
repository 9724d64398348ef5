"""Simulated measurements with the chosen precisions, and measurement files through the filter."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from occontrol.core.arrange import arrange
from occontrol.core.errors import UsageError
from occontrol.core.measurement import Estimate, Measurement
from occontrol.core.solution import Solution
from occontrol.core.trajectory import Trajectory
from occontrol.families.precision.forecast import split_seed
from occontrol.families.precision.problem import Problem
from occontrol.families.precision.sequence import innovation_squared, observe, simulate_truth


def _plan(solution: Solution | None, what: str) -> np.ndarray:
    """(K, q*m) precisions of a solution."""
    if solution is None or "precisions" not in solution.arrays:
        raise UsageError(f"there are no precisions to {what} with\n  hint: occontrol solve FILE first")
    return np.asarray(solution.arrays["precisions"])


def simulate(problem: Problem, solution: Solution | None, seed: int = 0) -> tuple[list[Measurement], Trajectory]:
    """A true trajectory, and measurements of it with exactly the chosen precisions.

    Parameters
    ----------
    problem : Problem with a plant
    solution : Solution whose precisions are used
    seed : of truth and noise
    """
    plant, measurement, _ = problem.dynamics("simulate")
    plan = _plan(solution, "simulate")
    truth = simulate_truth(plant, measurement, plan.size // problem.sensor_count, seed)
    seen = observe(truth.values.ravel(), plan.ravel(), split_seed(seed, 4)).reshape(truth.values.shape)
    measurements = [
        Measurement(float(truth.times[k + 1]), name, np.array([seen[k, i]]))
        for k in range(len(seen))
        for i, name in enumerate(problem.names)
        if np.isfinite(seen[k, i])
    ]
    return measurements, Trajectory(truth.times, truth.states)


def run_filter(problem: Problem, solution: Solution, measurements: Sequence[Measurement]) -> Estimate:
    """The ensemble or unscented filter over measurements, with the solution's precisions; one estimate per batch.

    Parameters
    ----------
    problem : Problem with a plant
    solution : Solution
    measurements : at the steps and of the sensors that the solution uses; a missing one means no update by it
    """
    plant, measurement, options = problem.dynamics("filter")
    plan = _plan(solution, "filter")
    observed = _values(problem, plant.interval, plan, measurements)
    filter_ = options.start(plant, measurement)
    rows: dict[str, list] = {key: [] for key in ("time", "mean", "covariance", "nis", "dimension")}
    notes = []
    for k, precisions in enumerate(plan):
        here = np.where(np.isnan(observed[k]), 0.0, precisions)
        lacking = int(np.sum((precisions > 0) & (here == 0)))
        forecast = filter_.forecast(problem.batch)
        if lacking:
            notes.append(f"batch {k + 1}: {lacking} measurements are missing, the bound is not promised there")
        covariance = filter_.update(forecast, here, observed[k])
        rows["time"].append(forecast.times[-1])
        rows["mean"].append(filter_.mean)
        rows["covariance"].append(covariance)
        rows["nis"].append(innovation_squared(forecast, here, observed[k]))
        rows["dimension"].append(int(np.sum(here > 0)))
    covariances = np.array(rows["covariance"])
    none = np.zeros((len(plan), 0))
    return Estimate(
        times=np.array(rows["time"]),
        mean=np.array(rows["mean"]),
        standard_deviation=np.sqrt(np.maximum(np.einsum("kii->ki", covariances), 0.0)),
        predicted=none,
        predicted_deviation=none,
        nis=np.array(rows["nis"]),
        dimension=np.array(rows["dimension"]),
        covariance=covariances,
        notes=tuple(notes),
    )


def _values(problem: Problem, interval: float, plan: np.ndarray, measurements: Sequence[Measurement]) -> np.ndarray:
    """(K, q*m) values in the plan's order, NaN where there is none; ProblemError for what does not fit it."""
    used = plan.reshape(-1, problem.sensor_count) > 0
    edges = interval * np.arange(len(used) + 1)
    given = [m for m in measurements if not (len(m.values) == 1 and np.isnan(m.values[0]))]  # NaN is missing
    in_use = [np.flatnonzero(step).tolist() for step in used]
    arrived = arrange(edges, problem.names, (1,) * problem.sensor_count, in_use, given)
    values = np.full(used.shape, np.nan)
    for k, samples in enumerate(arrived):
        for name, value in samples.items():
            values[k, problem.names.index(name)] = value[0]
    return values.reshape(plan.shape)

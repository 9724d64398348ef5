"""Least sensor precision for a required accuracy, in ensemble and unscented Kalman filters (Das & Bhattacharya)."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from occontrol.core.arrange import arrange
from occontrol.core.errors import UsageError
from occontrol.core.measurement import Estimate, Measurement
from occontrol.core.monitor import Monitor
from occontrol.core.solution import Solution, Status
from occontrol.core.trajectory import Trajectory
from occontrol.families.precision.forecast import Forecast, split_seed
from occontrol.families.precision.linearised import linearise_batch, undetectable_modes
from occontrol.families.precision.methods import METHODS as METHODS
from occontrol.families.precision.methods import Barrier, choose
from occontrol.families.precision.problem import Problem as Problem
from occontrol.families.precision.program import PrecisionResult
from occontrol.families.precision.pruning import Pruned, best_set, prune
from occontrol.families.precision.result import assemble
from occontrol.families.precision.sequence import (
    BatchOutcome,
    innovation_squared,
    observe,
    run_sequence,
    simulate_truth,
    start_filter,
)
from occontrol.families.precision.text import describe as describe
from occontrol.families.precision.text import summarise as summarise

COMPARE = ["barrier", "clarabel", "uniform"]


def solve(problem: Problem, method: Any = None, monitor: Monitor | None = None) -> Solution:
    """Choose the precisions of every batch and prove how good they are.

    Parameters
    ----------
    problem : Problem
    method : a METHODS value, or None for the problem's own, or the default
    monitor : Monitor

    Returns a Solution whose status is certified, feasible, limit, interrupted or infeasible (with the smallest factor
    that can be reached). Several batches run one after another against a simulated truth, measured with the precisions
    that were chosen.
    """
    monitor = monitor or Monitor()
    method = method or problem.method or Barrier()
    started = time.perf_counter()
    if monitor.time_limit is None and getattr(method, "time_limit", None) is not None:
        monitor.time_limit = monitor.seconds + method.time_limit
    spared = _spared(problem)
    steps: list[tuple[PrecisionResult, Pruned | None]] = []

    def step(forecast: Forecast | None, number: int) -> PrecisionResult | None:
        if number and monitor.stop:
            return None  # the batches so far are kept
        moments = problem.moments if forecast is None else forecast.moments
        assert moments is not None
        if problem.batches > 1:
            monitor.stage = f"batch {number + 1} of {problem.batches}"
        program = problem.program(moments)
        result, pruned = choose(program, method, monitor), None
        if problem.prune is not None and result.precisions is not None and result.objective > 0:
            groups = problem.groups()

            def again(smaller: Any) -> PrecisionResult:
                return choose(smaller, method, monitor)

            if problem.prune.exact:
                pruned = best_set(program, again, groups, problem.prune.sensors, spared, monitor=monitor)
            else:
                pruned = prune(program, again, result, groups, problem.prune, spared, monitor)
            if pruned is None:
                nan = float("nan")
                text = f"No {problem.prune.sensors} sensors can meet the bound."
                failed = PrecisionResult(
                    Status.INFEASIBLE, text, None, nan, nan, nan, nan, None, result.feasibility, result.route
                )
                steps.append((failed, None))
                return failed
        steps.append((result, pruned))
        return result if pruned is None else pruned.result

    outcomes: list[BatchOutcome] = []
    if problem.moments is not None:
        step(None, 0)
    else:
        assert problem.plant is not None and problem.measurement is not None and problem.filter is not None
        outcomes = run_sequence(
            problem.plant, problem.measurement, problem.filter, problem.batch, problem.batches, step, problem.truth_seed
        )
    return assemble(problem, method.name, steps, outcomes, monitor, time.perf_counter() - started)


def _spared(problem: Problem) -> Callable[[np.ndarray], bool] | None:
    """Whether the linearised plant stays as detectable as it is with every sensor; None where there is no plant."""
    if problem.plant is None or problem.prune is None or problem.measurement is None:
        return None
    transition, rows = linearise_batch(problem.plant, problem.measurement, problem.batch)
    already = len(undetectable_modes(transition, rows))
    return lambda left: len(undetectable_modes(transition, rows[left])) <= already


def _plan(problem: Problem, solution: Solution | None, what: str) -> np.ndarray:
    """(K, q*m) precisions of a solution, for what needs a plant."""
    if problem.plant is None:
        raise UsageError(
            f"a problem with plain moments has no plant to {what}\n  hint: give plant, measurement and filter"
        )
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
    plan = _plan(problem, solution, "simulate")
    assert problem.plant is not None and problem.measurement is not None
    truth = simulate_truth(problem.plant, problem.measurement, plan.size // problem.sensor_count, seed)
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
    plan = _plan(problem, solution, "filter")
    assert problem.plant is not None and problem.measurement is not None and problem.filter is not None
    observed = _arrange(problem, plan, measurements)
    filter_ = start_filter(problem.plant, problem.measurement, problem.filter)
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
    deviation = np.sqrt(np.maximum(np.einsum("kii->ki", covariances), 0.0))
    return Estimate(
        np.array(rows["time"]), np.array(rows["mean"]), deviation, none, none, np.array(rows["nis"]),
        np.array(rows["dimension"]), covariances, tuple(notes),
    )  # fmt: skip


def _arrange(problem: Problem, plan: np.ndarray, measurements: Sequence[Measurement]) -> np.ndarray:
    """(K, q*m) values in the plan's order, NaN where there is none; ProblemError for what does not fit it."""
    assert problem.plant is not None
    steps, names = plan.size // problem.sensor_count, list(problem.names)
    used = plan.reshape(steps, len(names)) > 0
    # a line whose value is missing says nothing, wherever it stands
    given = [m for m in measurements if not (len(m.values) == 1 and np.isnan(m.values[0]))]
    arrived = arrange(
        np.arange(1, steps + 1) * problem.plant.interval,
        names,
        [1] * len(names),
        [list(np.flatnonzero(row)) for row in used],
        given,
        slack=1e-6,
        instants=True,
    )
    values = np.full((steps, len(names)), np.nan)
    for k, found in enumerate(arrived):
        for name, value in found.items():
            values[k, names.index(name)] = value[0]
    return values.reshape(plan.shape)

"""Many seeded runs of a jumping-mode plant, its sensors, chooser and estimator, advanced together by a compiled kernel.

Run i uses the seed (seed, i) whatever the number of runs and however they are divided among threads.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from occontrol.core import stopwatch
from occontrol.core.errors import SolveFailed
from occontrol.core.monitor import Monitor
from occontrol.families.hybrid.chooser import Chooser
from occontrol.families.hybrid.imm import sample_model, start
from occontrol.families.hybrid.imm_kernel import JumpModel, filter_runs
from occontrol.families.hybrid.plant import JumpPlant
from occontrol.families.hybrid.sensor import JumpSensor
from occontrol.families.hybrid.statistics import Outcomes, join
from occontrol.families.hybrid.truth import TrueRuns, Truth, simulate_truths
from occontrol.numerics.linalg import normalised_square

MOST_THREADS = 8
ROUND_SECONDS = 0.3
FIRST_STEPS = 2000  # of one thread before its speed is known


@dataclass(frozen=True, eq=False)
class Experiment:
    """Everything that a run needs but its number.

    Parameters
    ----------
    plant : JumpPlant
    sensors : of JumpSensor
    groups : positions of the sensors of every group to choose from
    steps : number of steps
    position : components of the state that count as position
    truth : Truth
    chooser : Chooser
    seed : whole number, not negative
    """

    plant: JumpPlant
    sensors: Sequence[JumpSensor]
    groups: Sequence[Sequence[int]]
    steps: int
    position: Sequence[int]
    truth: Truth
    chooser: Chooser
    seed: int = 1

    def models(self) -> tuple[JumpModel, JumpModel]:
        """The arrays of the estimator, and those of the simulation, where all sensors report together."""
        every = [range(len(self.sensors))]
        return tuple(
            sample_model(self.plant, self.sensors, groups, self.steps, self.position) for groups in (self.groups, every)
        )  # type: ignore[return-value]


@dataclass(frozen=True, eq=False)
class Runs:
    """Complete histories of some runs: truths and what the estimator made of them.

    Parameters
    ----------
    truths : TrueRuns
    choices : (runs, steps) group in use
    estimates, covariances, log_probabilities : (runs, steps, n), (runs, steps, n, n), (runs, steps, modes)
    excess, error : of the guard probabilities
    """

    truths: TrueRuns
    choices: np.ndarray
    estimates: np.ndarray
    covariances: np.ndarray
    log_probabilities: np.ndarray
    excess: float
    error: float


def run_some(experiment: Experiment, models: tuple[JumpModel, JumpModel], numbers: Sequence[int]) -> Runs:
    """Simulate and estimate the runs with the given numbers.

    Parameters
    ----------
    experiment : Experiment
    models : experiment.models()
    numbers : run numbers, 0, 1, ..

    Raises SolveFailed when a state or an estimate leaves the range of the numbers.
    """
    e = experiment
    model, whole = models
    truths = simulate_truths(e.plant, whole, e.steps, e.truth, [(e.seed, i) for i in numbers])
    if e.chooser.sequence is None:
        choices = np.full((len(numbers), e.steps), -1, dtype=np.int64)
    else:
        choices = np.array(e.chooser.sequence(truths.luck, len(e.groups)), dtype=np.int64, order="C")
    means, roots, chances = start(e.plant)
    estimates, spreads, log_probabilities, excess, error = filter_runs(
        model, means[0], roots[0], chances, truths.values, choices,
        float(e.chooser.bound_weight), float(e.chooser.position_weight),
    )  # fmt: skip
    for what, values in (("state", truths.states[:, 1:]), ("estimate", estimates), ("covariance", spreads)):
        bad = ~np.all(np.isfinite(values).reshape(*values.shape[:2], -1), axis=2)
        if np.any(bad):
            k = int(np.argmax(np.any(bad, axis=0))) + 1
            raise SolveFailed(
                f"the {what} is not finite from step k = {k} on\n"
                "  hint: a mode that grows without bound overflows; use fewer steps, or check its A"
            )
    return Runs(truths, choices, estimates, spreads, log_probabilities, excess, error)


def outcomes(experiment: Experiment, runs: Runs) -> Outcomes:
    """What the statistics need of some runs.

    Parameters
    ----------
    experiment : Experiment
    runs : Runs
    """
    apart = runs.estimates - runs.truths.states[:, 1:]
    squared = np.sum(apart[:, :, list(experiment.position)] ** 2, axis=2)
    wrong = np.argmax(runs.log_probabilities, axis=2) != runs.truths.modes[:, 1:]
    choices = runs.choices.astype(np.int16)
    return Outcomes(squared, wrong, choices, nees(apart, runs.covariances).mean(axis=1), runs.excess, runs.error)


def nees(apart: np.ndarray, covariances: np.ndarray) -> np.ndarray:
    """Normalised estimation error squared; directions without variance do not count.

    e' P^+ e

    Parameters
    ----------
    apart : (..., n) estimate minus truth
    covariances : (..., n, n)
    """
    try:
        return normalised_square(apart, covariances)
    except np.linalg.LinAlgError:
        inverse = np.linalg.pinv(covariances, hermitian=True)
        return np.einsum("...i,...ij,...j->...", apart, inverse, apart)


def monte_carlo(experiment: Experiment, runs: int, monitor: Monitor | None = None) -> tuple[Outcomes, Runs]:
    """All runs, or as many as the monitor allows (at least one).

    Parameters
    ----------
    experiment : Experiment
    runs : how many
    monitor : Monitor; is told the number of runs done and the average RMS so far

    Returns
    -------
    Outcomes of the runs that were done, and the complete first run.
    """
    monitor = Monitor() if monitor is None else monitor
    models = experiment.models()
    first = run_some(experiment, models, [0])
    parts, done = [outcomes(experiment, first)], 1
    total = parts[0].squared.sum(axis=0)
    workers = min(MOST_THREADS, _cores())
    size = max(1, FIRST_STEPS // experiment.steps)

    def work(numbers: range) -> Outcomes:
        return outcomes(experiment, run_some(experiment, models, numbers))

    with ThreadPoolExecutor(workers) as pool:
        while done < runs and not monitor.stop:
            began = stopwatch.seconds()
            bounds = [min(runs, done + w * size) for w in range(workers + 1)]
            shares = [range(a, b) for a, b in itertools.pairwise(bounds) if b > a]
            fresh = list(pool.map(work, shares))
            parts += fresh
            total = sum((part.squared.sum(axis=0) for part in fresh), total)
            done = bounds[-1]
            spent = max(stopwatch.seconds() - began, 1e-3)
            size = int(np.clip(size * ROUND_SECONDS / spent, 1, min(4 * size, _widest(experiment))))
            monitor.report(done, float(np.mean(np.sqrt(total / done))), float("nan"), runs=runs)
    return join(parts), first


def _widest(experiment: Experiment) -> int:
    """So many runs of one thread keep its arrays below some 64 MB."""
    n = experiment.plant.states
    each = n * n + 4 * n + 4 * len(experiment.sensors) + len(experiment.plant.modes)
    return max(1, int(8e6 / (experiment.steps * each)))


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1

"""Covariances of every discrete filter along many steps at which rounding is at its worst, with missing samples.

    python -m scripts.campaign_definiteness [steps of each filter and plant] [seed]

The prior is diag(1e6, 1e-6, 1e6, 1e-6), sensors have R = 1e-12, a fifth of the samples is lost. Counts covariances that
are not symmetric, eigenvalues below -1e-14 of the largest, and negative normalised innovations; the exit code is 1 when
there is any. Run from the project's folder.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator

import numpy as np
from scipy.linalg import expm

from occontrol.core.plant import DiscretePlant, LinearPlant
from occontrol.core.schedule import Schedule
from occontrol.core.sensor import Sensor
from occontrol.families.athans.filter.online import MatchedFilter
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.families.hybrid.imm import filter_measurements
from occontrol.families.hybrid.plant import JumpPlant, Mode
from occontrol.families.hybrid.sensor import JumpSensor
from occontrol.families.vlambda.baselines import RoundRobinChooser
from occontrol.families.vlambda.online import OnlineSelector
from occontrol.families.vlambda.problem import Problem
from occontrol.families.vlambda.sensor import DiscreteSensor

PROMISE = 1e-14  # of the largest eigenvalue: by so much the smallest may be negative
LOST = 0.2  # share of the samples
CHUNK = 60  # steps after which a filter begins anew, from the worst prior
STEP = 0.1
PRIOR, NOISE = np.diag([1e6, 1e-6, 1e6, 1e-6]), np.diag([0, 1e-10, 0, 1e-6])
SENSORS = {
    "sum": ([[1.0, 0, 1, 0]], [[1e-12]]),
    "pair": ([[1.0, 0, 0, 0], [0, 0, 1, 1e-3]], [[1e-12, 5e-13], [5e-13, 1e-12]]),
}
PLANTS = {
    "drifting": np.array([[0, 1, 0, 0], [0, 0, 0, 0], [0, 0, 0, 1], [0, 0, 0, 0.0]]),
    "oscillating": np.array([[0, 1, 0, 0], [-9, 0, 0, 0], [0, 0, 0, 1], [1, 0, -4, 0.0]]),
    "stiff": np.array([[-50, 1, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1], [0, 0, -2, -0.1]]),
}


def athans(A: np.ndarray, model: str, generator: np.random.Generator) -> Iterator[tuple[np.ndarray, float]]:
    """Covariance (4, 4) and normalised innovation of every step of one pass; `model` is split or exact."""
    plant = LinearPlant(A=A, noise=NOISE, covariance=PRIOR, mean=np.ones(4))
    sensors = [Sensor(name, C, R, 1.0) for name, (C, R) in SENSORS.items()]
    edges = STEP * np.arange(CHUNK + 1)
    problem = SchedulingProblem("worst", plant, sensors, edges, [[1, 0, 0, 0]], 7.0)
    loop = MatchedFilter(problem, Schedule(edges, np.eye(2)[np.arange(CHUNK) % 2], tuple(SENSORS)), model)
    while True:
        loop.restart()
        while not loop.finished:
            done = loop.step(_values(loop.next_sensors, generator))
            yield done.covariance, done.nis


def vlambda(A: np.ndarray, generator: np.random.Generator) -> Iterator[tuple[np.ndarray, float]]:
    """The same of the V-Lambda filter, which does the same steps in discrete time."""
    plant = DiscretePlant(expm(STEP * A), STEP * NOISE, PRIOR)
    sensors = [DiscreteSensor(name, C, R) for name, (C, R) in SENSORS.items()]
    problem = Problem(name="worst", plant=plant, sensors=sensors, steps=CHUNK, epoch=1)
    while True:
        loop = OnlineSelector(problem.sampled, problem.starts, 1, RoundRobinChooser())
        while not loop.finished:
            done = loop.step(_values(loop.sensors, generator))
            yield done.covariance, done.nis


def hybrid(A: np.ndarray, generator: np.random.Generator) -> Iterator[tuple[np.ndarray, float]]:
    """The same of the jumping-mode estimator, whose second mode is slower."""
    F = expm(STEP * A)
    modes = [Mode("fast", F, STEP * NOISE, np.eye(4)), Mode("slow", expm(0.5 * STEP * A), STEP * NOISE, np.eye(4))]
    plant = JumpPlant(modes, PRIOR, np.ones(4), transition_matrix=[[0.9, 0.1], [0.2, 0.8]])
    sensors = [JumpSensor(name, C, R) for name, (C, R) in SENSORS.items()]
    names = list(SENSORS)
    while True:
        readings = {}
        for k in range(1, CHUNK + 1):
            values = _values([names[k % 2]], generator)
            readings[k] = [(names.index(name), value) for name, value in values.items()]
        found = filter_measurements(plant, sensors, CHUNK, readings)
        yield from zip(found.covariance[1:], found.nis[1:], strict=True)


def _values(names: object, generator: np.random.Generator) -> dict[str, np.ndarray]:
    """What sensors bring; some are lost, and some values of a pair."""
    found = {}
    for name in names:  # type: ignore[attr-defined]
        value = generator.standard_normal(len(SENSORS[name][0]))
        value[generator.uniform(size=len(value)) < LOST / 2] = np.nan
        if generator.uniform() > LOST:
            found[name] = value
    return found


FILTERS = {
    "split": lambda A, g: athans(A, "split", g),
    "exact": lambda A, g: athans(A, "exact", g),
    "vlambda": vlambda,
    "hybrid": hybrid,
}


def count(name: str, plant: str, steps: int, seed: int) -> tuple[int, float]:
    """How many covariances or innovations of a filter are wrong, and the worst min/max eigenvalue.

    Parameters
    ----------
    name, plant : a key of FILTERS and one of PLANTS
    steps, seed : how many steps, and of the readings
    """
    wrong, worst, generator = 0, np.inf, np.random.default_rng(seed)
    source = FILTERS[name](PLANTS[plant], generator)
    while steps > 0:
        some = [next(source) for _ in range(min(steps, 1000))]
        steps -= len(some)
        covariances, innovations = np.array([c for c, _ in some]), np.array([i for _, i in some])
        values = np.linalg.eigvalsh(covariances)
        ratio = values[:, 0] / values[:, -1]
        skew = np.any(covariances != np.swapaxes(covariances, 1, 2), axis=(1, 2))
        wrong += int(np.sum(~(ratio >= -PROMISE) | skew | (innovations < 0)))
        worst = min(worst, float(np.min(ratio)))
    return wrong, worst


def main(arguments: list[str]) -> int:
    """Print the counts of every filter and plant."""
    steps, seed = (int(word) for word in (*arguments, *("333334", "1")[len(arguments) :]))
    total = 0
    for name in FILTERS:
        for plant in PLANTS:
            wrong, worst = count(name, plant, steps, seed)
            total += wrong
            print(f"{name}, {plant}: {steps} steps, {wrong} wrong, worst min/max eigenvalue {worst:.2e}", flush=True)
    return int(total > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

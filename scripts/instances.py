"""Seeded scheduling problems for benchmarks: chains of coupled oscillators, stable and unstable, stiff and mild."""

from __future__ import annotations

import numpy as np

from occontrol.core.plant import DiscretePlant, LinearPlant
from occontrol.core.sensor import Sensor
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.families.athans.readings.clock import Steps
from occontrol.families.athans.readings.problem import ReadingsProblem


def oscillators(states: int, sensors: int, intervals: int, seed: int, running: bool = False) -> SchedulingProblem:
    """A chain of masses between springs and dampers, some of them driving, with noisy taps as sensors.

    Parameters
    ----------
    states : n, even; positions first, then velocities
    sensors : M; each taps one or two coordinates
    intervals : N
    seed : seeds 0 and 3 stable and mild, 1 and 4 with a driven (unstable) mass, 2 stiff
    running : whether an integral weight on the positions is added

    Returns a SchedulingProblem over 10 time units, predicting 2 further.
    """
    rng = np.random.default_rng(1000 * states + 10 * sensors + seed)
    m = states // 2
    stiffness = rng.uniform(0.5, 2.0, m + 1) * (30.0 if seed % 5 == 2 else 1.0)
    damping = rng.uniform(0.05, 0.3, m)
    if seed % 3 == 1:
        damping[rng.integers(m)] = -0.15
    K = np.diag(stiffness[:-1] + stiffness[1:]) - np.diag(stiffness[1:-1], 1) - np.diag(stiffness[1:-1], -1)
    A = np.block([[np.zeros((m, m)), np.eye(m)], [-K, -np.diag(damping)]])
    noise = np.zeros((states, states))
    noise[m:, m:] = np.diag(rng.uniform(0.02, 0.3, m))
    suite = []
    for j in range(sensors):
        C = np.zeros((1, states))
        C[0, rng.integers(states)] = 1.0
        C[0, rng.integers(states)] += rng.uniform(-1, 1)
        suite.append(Sensor(f"tap{j + 1}", C, [[float(10 ** rng.uniform(-1.5, 0))]], cost=float(rng.uniform(0, 0.5))))
    D = np.zeros((min(3, m), states))
    D[np.arange(len(D)), rng.choice(m, len(D), replace=False)] = 1.0
    return SchedulingProblem(
        name=f"oscillators-{states}-{sensors}-{seed}",
        plant=LinearPlant(A, noise, 4.0 * np.eye(states)),
        sensors=suite,
        edges=np.linspace(0.0, 10.0, intervals + 1),
        output=D,
        predict_at=12.0,
        cost_weight=0.1,
        running=np.diag(np.r_[np.ones(m), np.zeros(m)]) * 0.05 if running else None,
    )


def selection(states: int, sensors: int, steps: int, select: int, radius: float, seed: int) -> ReadingsProblem:
    """Choose some of many scalar sensors at each of a few steps; the sum of the posterior traces counts.

    Parameters
    ----------
    states, sensors, steps, select : n, M, T, and how many are read at a time
    radius : spectral radius of the random plant
    seed : 0 rows are unit vectors, otherwise Gaussian
    """
    rng = np.random.default_rng(100 * states + seed)
    F = rng.standard_normal((states, states))
    F *= radius / np.max(np.abs(np.linalg.eigvals(F)))
    if seed == 0:
        rows = np.eye(states)[rng.permutation(states)[:sensors]]
    else:
        rows = rng.standard_normal((sensors, states)) / np.sqrt(states)
    one = np.eye(states)
    return ReadingsProblem(
        name=f"selection-{states}-{sensors}-{steps}-{select}-{seed}",
        plant=DiscretePlant(F, 0.5 * one, one),
        sensors=[Sensor(f"s{j + 1}", row[None], [[0.5]]) for j, row in enumerate(rows)],
        clock=Steps(steps),
        output=np.zeros((1, states)),
        running=one,
        running_at="posterior",
        cost_weight=0.0,
        select=select,
    )

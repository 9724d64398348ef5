"""Seeded random scheduling problems, small and stiff, for the tests of sweeps and solvers."""

from __future__ import annotations

import numpy as np

from occontrol.core.plant import LinearPlant
from occontrol.core.sensor import Sensor, idle_sensor
from occontrol.families.athans.integration.options import Integration
from occontrol.families.athans.problem import SchedulingProblem


def random_problem(
    seed: int,
    states: int = 3,
    sensors: int = 3,
    intervals: int = 8,
    rows: int = 1,
    select: int = 1,
    idle: bool = False,
    running: bool = False,
    varying: bool = False,
    stiff: bool = False,
    windows: bool = False,
) -> SchedulingProblem:
    """A problem whose every feature can be switched on."""
    rng = np.random.default_rng(seed)
    # mild growth at most: thousands of e-folds unobserved would test rounding, not the method
    A = rng.normal(size=(states, states)) * 0.5 / np.sqrt(states) - 0.2 * np.eye(states)
    entries = [[float(x) for x in row] for row in A]
    if varying:
        entries[0][0] = f"{entries[0][0]} + 0.5*sin(2*t)"  # type: ignore[call-overload]
    G = rng.normal(size=(states, max(1, states - 1)))
    noise = 0.1 * G @ G.T
    covariance = np.eye(states) * (1e6 if stiff else 4.0)
    suite = []
    edges = np.concatenate([[0.0], np.cumsum(rng.uniform(0.05, 0.6, intervals))])
    for j in range(sensors):
        theta = rng.normal(size=(rows, rows))
        theta = (theta @ theta.T + np.eye(rows)) * (1e-3 if stiff else 0.2)
        where = [(float(edges[0]), float(edges[max(1, intervals // 2)]))] if windows and j == 0 else None
        suite.append(Sensor(f"s{j}", rng.normal(size=(rows, states)), theta, float(rng.uniform(0, 0.5)), where))
    if idle:
        suite.append(idle_sensor(states))
    D = rng.normal(size=(min(2, states), states))
    return SchedulingProblem(
        name=f"random {seed}",
        plant=LinearPlant(entries, noise, covariance),
        sensors=suite,
        edges=edges,
        output=D,
        predict_at=float(edges[-1]) + 0.3,
        cost_weight=0.3,
        running=np.eye(states) * 0.2 if running else None,
        select=select,
        # these problems are about the recursion itself
        integration=Integration(substeps=1, windows="cover"),
    )


def random_policy(problem: SchedulingProblem, rng: np.random.Generator, integral: bool = False) -> np.ndarray:
    """A feasible policy (N, M)."""
    from occontrol.families.athans.discretise import feasible_set

    allowed = feasible_set(problem)
    draw = rng.random(allowed.shape)
    return allowed.vertex(draw) if integral else allowed.project(draw)

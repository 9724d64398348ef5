"""Seeded truth and measurements along any schedule, by exact discretisation of the continuous plant.

x+ and the averaged readings of each interval are drawn together from their joint normal law (see sampled_model.py), so
neither plant noise nor averages are approximated, whatever the length of the intervals.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from occontrol.core.measurement import Measurement
from occontrol.core.schedule import Schedule
from occontrol.core.trajectory import Trajectory
from occontrol.families.athans.filter.sampled_model import SampledModel, exact_model
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.numerics.linalg import square_root


def draw(model: SampledModel, seeds: Sequence[int]) -> tuple[np.ndarray, list[np.ndarray]]:
    """Truths and readings of several independent runs.

    Parameters
    ----------
    model : SampledModel with N intervals, n states
    seeds : K seeds, one generator each

    Returns states (K, N+1, n) at the nodes and N arrays (K, m) of readings.
    """
    N, n = model.intervals, model.states
    width = int(np.max(model.dimension, initial=0))
    luck = np.empty((len(seeds), N + 1, n + width))
    for i, seed in enumerate(seeds):
        luck[i] = np.random.default_rng(seed).standard_normal((N + 1, n + width))
    states, readings = np.empty((len(seeds), N + 1, n)), []
    states[:, 0] = model.mean + luck[:, 0, :n] @ square_root(model.covariance, floor=0.0).T
    for k in range(N):
        m = len(model.offset[k])
        shock = luck[:, k + 1, : n + m] @ model.noise_roots[k].T
        x = states[:, k]
        states[:, k + 1] = x @ model.transition[k].T + model.input[k] + shock[:, :n]
        readings.append(x @ model.observe[k].T + model.offset[k] + shock[:, n:])
    return states, readings


def simulate(
    problem: SchedulingProblem, schedule: Schedule, seed: int = 0, model: SampledModel | None = None
) -> tuple[list[Measurement], Trajectory]:
    """One true trajectory and what the scheduled sensors report of it.

    Parameters
    ----------
    problem : SchedulingProblem
    schedule : Schedule to follow; its edges are the times of the samples
    seed : of the random generator; the same seed gives the same data
    model : SampledModel to draw from; the exact one if left out

    Returns the measurements (the average over an interval carries the time of its end) and the truth at the edges.
    """
    model = model or exact_model(problem, schedule)
    states, readings = draw(model, [seed])
    measurements = []
    for k in range(model.intervals):
        for j, place in model.places(k).items():
            measurements.append(Measurement(float(model.edges[k + 1]), model.names[j], readings[k][0, place]))
    return measurements, Trajectory(model.edges, states[0])

"""Gains of the matched filter at every reading, K = S(k|k) H' R^-1, padded with zeros."""

from __future__ import annotations

import numpy as np

from occontrol.families.athans.readings.problem import ReadingsProblem

MAX_BYTES = 500_000_000
USED = 1e-9


def reading_gains(problem: ReadingsProblem, weights: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """K of every instant: the values of the sensors that are read one below the other, in the order of the sensors.

    Parameters
    ----------
    problem : ReadingsProblem with N readings and n states
    weights : (N, M)
    covariance : (N, n, n) after the readings

    Returns (N, n, m), m the largest number of values of an instant; (N, n, 0) where that takes too much memory.
    """
    times, (N, n) = problem.clock.times, covariance.shape[:2]
    used = [[j for j, s in enumerate(problem.sensors) if s.rows and weights[k, j] > USED] for k in range(N)]
    m = max((sum(problem.sensors[j].rows for j in each) for each in used), default=0)
    if 8 * N * n * m > MAX_BYTES:
        return np.zeros((N, n, 0))
    gain = np.zeros((N, n, m))
    for j, sensor in enumerate(problem.sensors):
        at = [k for k in range(N) if j in used[k]]
        if not at:
            continue
        C, R = sensor.C.sample(times[at]), sensor.noise.sample(times[at])
        own = covariance[at] @ np.swapaxes(np.linalg.solve(R, C), 1, 2) * weights[at, j][:, None, None]
        for i, k in enumerate(at):
            first = sum(problem.sensors[e].rows for e in used[k] if e < j)
            gain[k, :, first : first + sensor.rows] = own[i]
    return gain

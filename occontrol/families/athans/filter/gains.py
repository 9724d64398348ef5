"""Precomputed gains of the matched filter along a policy."""

from __future__ import annotations

import numpy as np

from occontrol.families.athans.node_path import Path
from occontrol.families.athans.problem import SchedulingProblem

USED = 1e-9
MAX_BYTES = 400_000_000


def filter_gains(problem: SchedulingProblem, weights: np.ndarray, path: Path) -> dict[str, np.ndarray]:
    """Gains of the sampled and of the continuous filter, for the sensors in use, one below the other in their order.

        gain_k = S+_k [v_j C_j' Theta_j^-1 ...] h_k            (integrate-and-dump samples, at the midpoint)
        continuous_gain(t_k) = Sigma(t_k) [v_j C_j' Theta_j^-1 ...]   Athans (1971), equation (7.5), transpose restored

    Parameters
    ----------
    problem : SchedulingProblem
    weights : (N, M)
    path : Path along them; without `updated` there is no gain of the samples (see planned.py)

    Returns {"gain": (N, n, m), "continuous_gain": (N+1, n, m)}, m the largest number of rows in use, padded with zeros;
    empty when they would take more than MAX_BYTES. The node at the end of interval N-1 uses that interval's sensors.
    """
    N, n = problem.intervals, problem.states
    sizes = np.array([s.rows for s in problem.sensors])
    used = weights > USED
    m = int(np.max(used @ sizes))
    if 8 * (2 * N + 1) * n * m > MAX_BYTES:
        return {}
    gain, continuous = np.zeros((N, n, m)), np.zeros((N + 1, n, m))
    column = np.cumsum(np.where(used, sizes, 0), axis=1) - np.where(used, sizes, 0)
    steps = problem.steps
    for j, sensor in enumerate(problem.sensors):
        at = np.flatnonzero(used[:, j])
        if not sensor.rows or not len(at):
            continue
        if len(path.updated):
            scale = weights[at, j] * steps[at]
            _place(sensor, problem.midpoints[at], path.updated[at], gain, at, column[at, j], scale)
        _place(sensor, problem.edges[at], path.covariance[at], continuous, at, column[at, j], weights[at, j])
        if used[N - 1, j]:
            last = np.array([N - 1])
            end = problem.edges[-1:]
            _place(sensor, end, path.covariance[N:], continuous, last + 1, column[last, j], weights[last, j])
    return {"gain": gain, "continuous_gain": continuous} if len(path.updated) else {"continuous_gain": continuous}


def _place(sensor, times, covariance, target, where, columns, scale) -> None:
    C, theta = sensor.C.sample(times), sensor.noise.sample(times)
    block = covariance @ np.swapaxes(np.linalg.solve(theta, C), 1, 2) * scale[:, None, None]
    for i, (k, c) in enumerate(zip(where, columns, strict=True)):
        target[k, :, c : c + sensor.rows] = block[i]

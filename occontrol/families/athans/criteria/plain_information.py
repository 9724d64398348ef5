"""The independent check without a prior: one least-squares problem from the problem's own signals.

All readings, whitened and stacked as functions of the state at the start, are one matrix H; the covariance of what its
columns determine is V S^-2 V' by its singular values. Nothing is shared with the search but the plant's own integration
by another rule.
"""

from __future__ import annotations

import numpy as np

from occontrol.families.athans.criteria.plain import plain_value
from occontrol.families.athans.readings.plain import Gaps, PlainCost
from occontrol.families.athans.readings.problem import ReadingsProblem

LOST = 3e-7  # of the largest singular value: a direction that is not seen


def plain_information_cost(problem: ReadingsProblem, weights: np.ndarray) -> PlainCost:
    """Cost of a policy of readings without a prior; a share v of a reading has the noise R/v.

    Parameters
    ----------
    problem : without a prior, N readings and M sensors
    weights : (N, M) of every reading
    """
    times, n = problem.clock.times, problem.states
    across = np.eye(n)[:, problem.unknown]  # of the start, what is not known
    rows = [np.zeros((across.shape[1], across.shape[1]))]
    gaps = Gaps(problem)
    if not problem.discrete:
        across = gaps.transition(0) @ across
    prices = np.column_stack([s.cost.sample(times)[:, 0, 0] for s in problem.sensors])
    samples = [(s.C.sample(times), s.noise.sample(times)) for s in problem.sensors]
    for k in range(len(times)):
        for j in np.flatnonzero(weights[k] > 0):
            C, R = samples[j][0][k], samples[j][1][k]
            if len(C):
                lower = np.linalg.cholesky((R + R.T) / 2)
                rows.append(np.sqrt(weights[k, j]) * np.linalg.solve(lower, C @ across))
        if k < len(times) - 1 or problem.at == "predicted":
            across = gaps.transition(k + (not problem.discrete)) @ across
    output = problem.output.at(problem.output_at)
    if not problem.discrete:
        output = output @ gaps.beyond
    H = np.vstack(rows)
    scale = np.linalg.norm(H, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    _, sizes, basis = np.linalg.svd(H / scale, full_matrices=False)
    kept = sizes > LOST * sizes[0]
    Z = (output @ across / scale) @ basis[kept].T / sizes[kept]
    X = Z @ Z.T
    prediction = float(np.trace(X))
    value = prediction if problem.criterion is None else plain_value(problem.criterion, X)
    observation = problem.cost_weight * float(np.sum(prices * weights))
    return PlainCost(observation + value, observation, 0.0, prediction, value)

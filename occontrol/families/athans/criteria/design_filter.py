"""The filter without a prior: information adds up, and there is an estimate once it is nonsingular.

    F <- F + (H Phi)' R^-1 (H Phi),   y <- y + (H Phi)' R^-1 (z - H c),   x(t) = Phi F^-1 y + c,   S(t) = Phi F^-1 Phi'

with Phi and c the plant's transition and drift since the start, so that F^-1 y is the least-squares estimate there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from occontrol.core.arrange import arrange
from occontrol.core.measurement import Estimate, Measurement
from occontrol.core.schedule import Schedule
from occontrol.families.athans.criteria.design_arrays import DETERMINED
from occontrol.families.athans.readings.filter import ReadingModel, reading_model, reading_predictor
from occontrol.families.athans.readings.problem import ReadingsProblem


def run_information_filter(
    problem: ReadingsProblem, schedule: Schedule, measurements: Sequence[Measurement]
) -> Estimate:
    """Estimate the state and predict the output from readings along a schedule, without a prior.

    Parameters
    ----------
    problem : without a prior
    schedule : with N readings
    measurements : each a reading of one sensor at one of the instants, in any order

    Returns an Estimate with N+1 rows, which are not numbers until the information is nonsingular.
    """
    model = reading_model(problem, schedule)
    predictor = reading_predictor(problem, model)
    samples = arrange(
        problem.clock.times, model.names, model.rows, model.active, measurements, instants=True, slack=1e-6
    )
    D, n, N = problem.output.at(problem.output_at), problem.states, model.intervals
    p = len(D)
    mean, covariance = np.full((N + 1, n), np.nan), np.full((N + 1, n, n), np.nan)
    predicted, spread = np.full((N + 1, p), np.nan), np.full((N + 1, p, p), np.nan)
    F, y, across, drift = np.zeros((n, n)), np.zeros(n), np.eye(n), np.zeros(n)
    dimension = np.zeros(N + 1, dtype=int)
    for k in range(N):
        across, drift = model.transition[k] @ across, model.transition[k] @ drift + model.input[k]
        H, R, z = _arrived(model, k, samples[k])
        dimension[k + 1] = len(z)
        if len(z):
            root = np.linalg.cholesky(R)
            rows, values = np.linalg.solve(root, H @ across), np.linalg.solve(root, z - H @ drift)
            F, y = F + rows.T @ rows, y + rows.T @ values
        scale = np.sqrt(np.diagonal(F))
        if not np.all(scale > 0):
            continue
        sizes, basis = np.linalg.eigh(F / np.outer(scale, scale))
        if sizes[0] <= DETERMINED * sizes[-1]:
            continue
        half = basis / scale[:, None] / np.sqrt(sizes)
        mean[k + 1] = across @ (half @ (half.T @ y)) + drift
        covariance[k + 1] = across @ half @ half.T @ across.T
        predicted[k + 1], spread[k + 1] = predictor.predict(k + 1, mean[k + 1], covariance[k + 1])
    deviation = np.sqrt(np.einsum("kii->ki", covariance))
    known = np.flatnonzero(np.isfinite(mean[:, 0]))
    first = f"from {model.edges[known[0]]:g} on" if len(known) else "nowhere"
    seen = np.einsum("pi,kij,pj->kp", D, covariance, D)
    return Estimate(
        times=model.edges,
        mean=mean,
        standard_deviation=deviation,
        predicted=predicted,
        predicted_deviation=np.sqrt(np.maximum(np.einsum("kii->ki", spread), 0.0)),
        nis=np.full(N + 1, np.nan),
        dimension=dimension,
        covariance=covariance,
        notes=(f"without a prior the readings determine all states {first}",),
        output=mean @ D.T,
        output_deviation=np.sqrt(seen),
    )


def _arrived(
    model: ReadingModel, k: int, sample: Mapping[str, np.ndarray]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows, covariance and values of the readings that arrived."""
    H, R = model.readings[k]
    z = np.full(len(H), np.nan)
    for j, place in model.places(k).items():
        if model.names[j] in sample:
            z[place] = sample[model.names[j]]
    kept = np.flatnonzero(np.isfinite(z))
    return H[kept], R[np.ix_(kept, kept)], z[kept]

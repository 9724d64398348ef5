"""The plant linearised along its mean over one batch, and which of its modes a set of measurements would miss."""

from __future__ import annotations

import numpy as np

from occontrol.families.precision.measurement import NonlinearMeasurement
from occontrol.families.precision.plant import NonlinearPlant

UNSEEN = 1e-9  # of the largest singular value: below, a mode counts as not measured


def linearise_batch(
    plant: NonlinearPlant, measurement: NonlinearMeasurement, batch: int
) -> tuple[np.ndarray, np.ndarray]:
    """Transition (n, n) over the batch and rows (q*m, n): what each measurement sees of the state at its start."""
    state, time, matrix, rows = plant.mean, 0.0, np.eye(plant.states), []
    for _ in range(batch):
        matrix = plant.jacobian(state, time) @ matrix
        state = plant.advance(state[:, None], time)[:, 0]
        time += plant.interval
        rows.append(measurement.jacobian(state, time) @ matrix)
    return matrix, np.vstack(rows)


def undetectable_modes(transition: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Eigenvalues of modulus 1 or more whose mode no row sees (Popov, Belevitch & Hautus).

    rank [mu I - F; C] < n, decided by singular values after scaling the rows to length one.

    `transition` is F (n, n), `rows` is C (m, n).
    """
    n = transition.shape[0]
    lengths = np.linalg.norm(rows, axis=1)
    rows = rows[lengths > 0] / lengths[lengths > 0, None]
    scale = max(1.0, float(np.linalg.norm(transition, 2)))
    missed = []
    for mu in np.linalg.eigvals(transition):
        if abs(mu) < 1.0 - 1e-9:
            continue
        stacked = np.vstack([(mu * np.eye(n) - transition) / scale, rows])
        if np.linalg.svd(stacked, compute_uv=False)[-1] < UNSEEN:
            missed.append(mu)
    return np.array(missed)

"""Seeded truths of a jumping-mode plant and what every sensor would read of them, all runs at once.

Unknowns: x (runs, n) and the mode q (runs,), advanced together. Every run has a generator of its own, so that a run
does not depend on how many others there are, and every method meets the same truth and the same noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from occontrol.families.hybrid.imm_kernel import JumpModel
from occontrol.families.hybrid.plant import JumpPlant
from occontrol.numerics.linalg import square_root


@dataclass(frozen=True, eq=False)
class Truth:
    """Where the runs begin.

    Parameters
    ----------
    mean, covariance : (n,), (n, n) of the true state at k = 0
    mode : position of the mode at k = 0, or None to draw it from the plant's probabilities
    """

    mean: np.ndarray
    covariance: np.ndarray
    mode: int | None = None


@dataclass(frozen=True, eq=False)
class TrueRuns:
    """Simulated truths.

    Parameters
    ----------
    states : (runs, steps+1, n)
    modes : (runs, steps+1)
    values : (runs, steps, rows of all sensors)
    luck : (runs, steps) uniform numbers for random choosers
    """

    states: np.ndarray
    modes: np.ndarray
    values: np.ndarray
    luck: np.ndarray


def _root(matrices: np.ndarray) -> np.ndarray:
    """The symmetric root, which no choice of eigenvectors changes: the same seed then gives the same run."""
    return square_root(matrices, scaled=False, symmetric=True)


def simulate_truths(
    plant: JumpPlant, model: JumpModel, steps: int, truth: Truth, seeds: Sequence[Sequence[int]]
) -> TrueRuns:
    """Simulate one truth per seed.

    x(k) = A_q(k) x(k-1) + B_q(k) u(k) + F_q(k) w(k),    z_i(k) = C_i x(k) + v_i(k)

    Parameters
    ----------
    plant : JumpPlant
    model : its arrays, with all sensors as the first group
    steps : number of steps
    truth : Truth
    seeds : one seed (any sequence of whole numbers) per run

    Returns
    -------
    TrueRuns. Liu & Hwang, equations (1)-(5). Of several guards that hold, the first in the user's order leads on; where
    none holds the mode stays.
    """
    n, runs, rows, extra = plant.states, len(seeds), int(model.rows[0]), len(model.threshold_mean)
    normal = np.empty((runs, n + steps * (n + rows + extra)))
    uniform = np.empty((runs, 1 + 2 * steps))
    for r, seed in enumerate(seeds):
        generator = np.random.default_rng(list(seed))
        generator.standard_normal(out=normal[r])
        generator.random(out=uniform[r])
    first, rest = normal[:, :n], normal[:, n:].reshape(runs, steps, n + rows + extra)
    states, modes = np.empty((runs, steps + 1, n)), np.empty((runs, steps + 1), dtype=np.int64)
    states[:, 0] = truth.mean + first @ _root(truth.covariance)
    modes[:, 0] = _draw(plant.probabilities[None], uniform[:, 0]) if truth.mode is None else truth.mode
    plant_noise, sensor_noise = _root(model.noise), _root(model.R[:, 0])
    thresholds = model.threshold_mean + rest[:, :, n + rows :] @ _root(model.threshold_covariance)
    with np.errstate(all="ignore"):
        for k in range(1, steps + 1):
            q, x = modes[:, k - 1], states[:, k - 1]
            if plant.guards is None:
                q = _draw(model.transition_matrix[q], uniform[:, k])
            else:
                q = _follow_guards(model, q, np.hstack([x, thresholds[:, k - 1]]))
            A, drift, noise = (part[min(k, len(part)) - 1] for part in (model.A, model.drift, plant_noise))
            moved = np.einsum("rij,rj->ri", A[q], x) + drift[q]
            states[:, k] = moved + np.einsum("rij,rj->ri", noise[q], rest[:, k - 1, :n])
            modes[:, k] = q
        C = np.broadcast_to(model.C[:, 0], (steps, rows, n))
        spread = np.broadcast_to(sensor_noise, (steps, rows, rows))
        values = np.einsum("kij,rkj->rki", C, states[:, 1:])
        values += np.einsum("kij,rkj->rki", spread, rest[:, :, n : n + rows])
    return TrueRuns(states, modes, values, uniform[:, 1 + steps :])


def _draw(probabilities: np.ndarray, luck: np.ndarray) -> np.ndarray:
    return np.minimum((luck[:, None] >= np.cumsum(probabilities, axis=1)).sum(axis=1), probabilities.shape[1] - 1)


def _follow_guards(model: JumpModel, modes: np.ndarray, joint: np.ndarray) -> np.ndarray:
    following, open_ = modes.copy(), np.ones(len(modes), dtype=bool)
    for g in range(len(model.source)):
        rows = model.guard_rows[g]
        inside = np.all(joint @ model.guard_L[g, :rows].T + model.guard_b[g, :rows] <= 0, axis=1)
        taken = open_ & inside & (modes == model.source[g])
        following[taken] = model.target[g]
        open_ &= ~taken
    return following

"""What ensemble and sigma-point filters share: a batch of q steps seen as one measurement, and its forecast.

A batch that starts from x_k stacks y_{k+1} .. y_{k+q}; only x_{k+q} is bounded and handed on.
Das & Bhattacharya, equations (3)-(5), a q-step q-shift process.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occontrol.core.errors import SolveFailed
from occontrol.families.precision.measurement import NonlinearMeasurement
from occontrol.families.precision.moments import Moments
from occontrol.families.precision.plant import NonlinearPlant
from occontrol.families.precision.sigma_points import square_root


@dataclass(frozen=True, eq=False)
class Forecast:
    """A batch before its measurements arrive.

    Parameters
    ----------
    times : (q,) of the measurements
    mean : (n,) of the last state
    measurement_mean : (q*m,) step by step
    moments : Moments of the last state and of all measurements
    members : (n, N) last states of an ensemble, None for sigma points
    """

    times: np.ndarray
    mean: np.ndarray
    measurement_mean: np.ndarray
    moments: Moments
    members: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class BatchRun:
    """Members driven through a batch: times (q,), last states (n, N), measurements (q*m, N), of the mean (q*m,)."""

    times: np.ndarray
    members: np.ndarray
    values: np.ndarray
    values_of_mean: np.ndarray


def run_batch(
    plant: NonlinearPlant,
    measurement: NonlinearMeasurement,
    members: np.ndarray,
    step: int,
    batch: int,
    noise: np.ndarray | None = None,
    inflation: float = 1.0,
) -> BatchRun:
    """Advance members (n, N) through `batch` steps from step k.

    Parameters
    ----------
    noise : (batch, n, N) added after every step, or None
    inflation : factor on the forecast covariance: members move away from their mean by its root, then are measured

    Raises SolveFailed when a member leaves the finite numbers.
    """
    times, values, of_mean = [], [], []
    names = tuple(measurement.names or ())
    for j in range(batch):
        members = plant.advance(members, (step + j) * plant.interval)
        if noise is not None:
            members = members + noise[j]
        if inflation != 1.0:
            centre = np.mean(members, axis=1, keepdims=True)
            members = centre + np.sqrt(inflation) * (members - centre)
        time = (step + j + 1) * plant.interval
        measured = measurement.values(members, time)
        for what, array in (("state", members), ("measurement", measured)):
            if not np.all(np.isfinite(array)):
                i, column = np.argwhere(~np.isfinite(array))[0]
                label = f"x{i + 1}" if what == "state" else f"measurement '{names[i]}'"
                text = f"{label} of member {column + 1} is not finite at t = {time:g}"
                raise SolveFailed(f"{text}\n  hint: check the formulas there, or use a smaller step with more substeps")
        times.append(time)
        values.append(measured)
        of_mean.append(measurement.values(np.mean(members, axis=1, keepdims=True), time)[:, 0])
    return BatchRun(np.array(times), members, np.vstack(values), np.concatenate(of_mean))


def split_seed(seed: int, purpose: int) -> np.random.Generator:
    """Independent streams of one seed: 0 ensemble, 1 plant noise, 2 perturbations, 3 truth, 4 measurement noise."""
    return np.random.default_rng([seed, purpose])


def draw(generator: np.random.Generator, covariance: np.ndarray, count: int) -> np.ndarray:
    """(n, count) zero-mean normal columns with the covariance (n, n), which may be singular."""
    return square_root(covariance) @ generator.standard_normal((covariance.shape[0], count))

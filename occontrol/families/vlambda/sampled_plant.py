"""A discrete-time plant and its sensors as arrays over k = 0 .. K-1, states scaled, measurements whitened.

Everything after this works with C = R^{-1/2} H, so that information is C'C, and with states divided by the user's
scales, so that eigenvalues of different states can be compared (Oshman 1994, remark 1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from occontrol.core.plant import DiscretePlant
from occontrol.families.vlambda.sensor import DiscreteSensor
from occontrol.numerics.linalg import square_root, whiten


def _whitened_or_nan(noise: np.ndarray, rows: np.ndarray) -> np.ndarray:
    try:
        return whiten(noise, rows)[0]
    except np.linalg.LinAlgError:
        return np.full(rows.shape, np.nan)


@dataclass(frozen=True, eq=False)
class SampledSensor:
    """One sensor over the horizon.

    Parameters
    ----------
    sensor : DiscreteSensor
    scales : (n,) of the states
    H, R, rows : (K, m, n), (K, m, m) and C = R^{-1/2} H (K, m, n) in scaled states; None for a movable sensor
    """

    sensor: DiscreteSensor
    scales: np.ndarray
    H: np.ndarray | None = None
    R: np.ndarray | None = None
    rows: np.ndarray | None = None

    def matrices(self, start: int, stop: int, location: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """H (N, m, n) in scaled states and R (N, m, m) for k = start .. stop-1, at `location` (d,) if movable."""
        if self.H is not None and self.R is not None:
            return self.H[start:stop], self.R[start:stop]
        steps = np.arange(start, stop, dtype=float)
        places = np.tile(np.asarray(location, dtype=float), (len(steps), 1))
        return self.sensor.H.sample(steps, places) * self.scales, self.sensor.R.sample(steps, places)

    def whitened(self, start: int, stop: int, location: np.ndarray | None = None) -> np.ndarray:
        """C = R^{-1/2} H (N, m, n) for k = start .. stop-1; LinAlgError where R is not positive definite.

        `location` (d,).
        """
        if self.rows is not None:
            return self.rows[start:stop]
        rows, noise = self.matrices(start, stop, location)
        return whiten(noise, rows)[0]

    def whitened_at(self, step: int, locations: np.ndarray) -> np.ndarray:
        """C (N, m, n) at one step and N locations (N, d); NaN where R is not positive definite."""
        steps = np.full(len(locations), float(step))
        rows, noise = self.sensor.H.sample(steps, locations) * self.scales, self.sensor.R.sample(steps, locations)
        try:
            return whiten(noise, rows)[0]
        except np.linalg.LinAlgError:
            return np.array([_whitened_or_nan(R, H) for R, H in zip(noise, rows, strict=True)])


@dataclass(frozen=True, eq=False)
class SampledPlant:
    """Plant and sensors over k = 0 .. K-1, in states divided by `scales`.

    Parameters
    ----------
    transition : (K, n, n) F(k)
    noise_root : (K, n, p) G(k) Q(k)^{1/2}
    mean, covariance : (n,), (n, n) of x(0), before any measurement
    sensors : tuple of SampledSensor
    scales : (n,)
    """

    transition: np.ndarray
    noise_root: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray
    sensors: tuple[SampledSensor, ...]
    scales: np.ndarray

    @property
    def steps(self) -> int:
        """The number K of steps."""
        return len(self.transition)

    @property
    def states(self) -> int:
        """The number n of states."""
        return self.transition.shape[1]

    @property
    def names(self) -> list[str]:
        """The sensors' names, in order."""
        return [s.sensor.name for s in self.sensors]


def sample_plant(
    plant: DiscretePlant, sensors: Sequence[DiscreteSensor], steps: int, scales: np.ndarray | None = None
) -> SampledPlant:
    """Evaluate every function of k on 0 .. steps-1 and divide the states by `scales` (n,) (ones if left out)."""
    n = plant.states
    s = np.ones(n) if scales is None else np.asarray(scales, dtype=float)
    k = np.arange(steps, dtype=float)
    Q = np.asarray(plant.Q.sample(k))
    if plant.G is None:
        # scaled before the root is taken: that of Q in other units would lose the small states
        roots = square_root(Q / np.outer(s, s), scaled=False)
    else:
        roots = plant.G.sample(k) @ square_root(Q, scaled=False) / s[:, None]
    sampled = []
    for sensor in sensors:
        if sensor.movable:
            sampled.append(SampledSensor(sensor, s))
            continue
        H, R = np.asarray(sensor.H.sample(k)) * s, np.array(sensor.R.sample(k))
        sampled.append(SampledSensor(sensor, s, H, R, np.ascontiguousarray(whiten(R, H)[0])))
    return SampledPlant(
        np.ascontiguousarray(plant.F.sample(k) * s / s[:, None]),
        np.ascontiguousarray(roots),
        plant.mean / s,
        plant.covariance / np.outer(s, s),
        tuple(sampled),
        s,
    )

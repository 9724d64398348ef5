"""Unscented Kalman filter over batches of q steps, with sensors of chosen precision.

Unknowns: mean (n,) and covariance (n, n) of the last state. The augmented state is x_k with the plant noise of the q
steps (nothing where there is none): earlier blocks of the printed augmented state never enter the next batch.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from occontrol.core.errors import Collector, Mistake, ProblemError
from occontrol.families.precision import sigma_points
from occontrol.families.precision.forecast import Forecast, run_batch
from occontrol.families.precision.measurement import NonlinearMeasurement
from occontrol.families.precision.moments import Moments, gain, moments_of_anomalies, posterior_covariance
from occontrol.families.precision.plant import NonlinearPlant


@dataclass(frozen=True)
class UnscentedFilter:
    """Options of the unscented Kalman filter.

    Parameters
    ----------
    alpha : spread of the points, > 0; 0.001 as printed makes them all but coincide
    beta : 2 suits normal errors; beta >= alpha^2 keeps the covariance positive semidefinite
    kappa : second spread, n_a + kappa > 0

    Das & Bhattacharya, sections 3.3 and 3.4, with the covariance put right (see sigma_points.py).
    """

    alpha: float = 1.0
    beta: float = 2.0
    kappa: float = 0.0
    name: str = field(default="ukf", init=False)

    def __post_init__(self) -> None:
        found = Collector()
        if not (np.isfinite(self.alpha) and self.alpha > 0):
            found.add(("alpha",), f"alpha is {self.alpha:g}", "alpha > 0")
        if not np.isfinite(self.beta) or self.beta < self.alpha * self.alpha:
            found.add(("beta",), f"beta is {self.beta:g}", "beta >= alpha^2: below, the covariance may be indefinite")
        if not np.isfinite(self.kappa):
            found.add(("kappa",), f"kappa is {self.kappa:g}")
        found.raise_if_any()

    def start(self, plant: NonlinearPlant, measurement: NonlinearMeasurement) -> Unscented:
        """The running filter, which stands at the plant's initial mean and covariance."""
        return Unscented(plant, measurement, self)


class Unscented:
    """A running unscented filter.

    Parameters
    ----------
    plant, measurement : what moves and what is seen
    options : UnscentedFilter
    """

    def __init__(self, plant: NonlinearPlant, measurement: NonlinearMeasurement, options: UnscentedFilter):
        self.plant, self.measurement, self.options, self.step = plant, measurement, options, 0
        self.mean, self.covariance = plant.mean, plant.covariance

    def forecast(self, batch: int) -> Forecast:
        """Moments of x_{k+q} and y_{k+1} .. y_{k+q}; (12), (13). The filter stands at k+q afterwards.

        Raises ProblemError where kappa leaves the points no spread.
        """
        options, n = self.options, self.plant.states
        root = sigma_points.noise_root(self.plant.noise)
        width = root.shape[1]
        size = n + batch * width
        if size + options.kappa <= 0:
            what = f"kappa is {options.kappa:g}, the augmented state has {size} entries"
            raise ProblemError(Mistake(("filter", "kappa"), what, f"kappa > {-size}"))
        covariance = np.eye(size)
        covariance[:n, :n] = self.covariance
        points = sigma_points.sigma_points(
            np.concatenate([self.mean, np.zeros(size - n)]), covariance, options.alpha, options.kappa
        )
        noise = None
        if width:
            noise = np.stack([root @ points[n + j * width : n + (j + 1) * width] for j in range(batch)])
        run = run_batch(self.plant, self.measurement, points[:n], self.step, batch, noise)
        both = np.vstack([run.members, run.values])
        mean, anomalies = sigma_points.mean_and_anomalies(both, options.alpha, options.beta, options.kappa)
        self.step += batch
        return Forecast(run.times, mean[:n], mean[n:], moments_of_anomalies(anomalies[:n], anomalies[n:]))

    def update(self, forecast: Forecast, precisions: np.ndarray, observed: np.ndarray) -> np.ndarray:
        """Take the measurements of a batch in, without those of precision 0; return the covariance (11), (n, n).

        precisions, observed : (q*m,) each"""
        moments: Moments = forecast.moments
        precisions = np.asarray(precisions, dtype=float)
        kalman = gain(moments.cross, moments.measurement, precisions)
        innovation = np.where(precisions > 0, np.nan_to_num(observed) - forecast.measurement_mean, 0.0)
        self.mean = forecast.mean + kalman @ innovation
        posterior = posterior_covariance(moments, precisions)
        self.covariance = (posterior + posterior.T) / 2
        return self.covariance

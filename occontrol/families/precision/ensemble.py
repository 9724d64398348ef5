"""Ensemble Kalman filter over batches of q steps, with sensors of chosen precision.

Unknowns: members (n, N). Forecast by the plant, moments by equations (9) and (10) of Das & Bhattacharya with mean
centring, update either with perturbed observations (8) or by the symmetric square root. Only the latter has exactly the
covariance (11) that a precision program promises; after perturbed observations the sample covariance scatters.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from occontrol.core.errors import Collector
from occontrol.families.precision.forecast import Forecast, draw, run_batch, split_seed
from occontrol.families.precision.measurement import NonlinearMeasurement
from occontrol.families.precision.moments import gain, moments_of_anomalies, square_root_transform
from occontrol.families.precision.plant import NonlinearPlant

UPDATES = ("square-root", "perturbed")
CENTRINGS = ("mean", "model")


@dataclass(frozen=True)
class EnsembleFilter:
    """Options of the ensemble Kalman filter.

    Parameters
    ----------
    members : N >= 2
    inflation : factor on the forecast covariance, > 0
    update : square-root (keeps the promised covariance) or perturbed (observations)
    centring : mean of the measured members, or `model`: the measured mean member, as printed (conservative)
    seed : of the initial ensemble, plant noise and perturbations

    Das & Bhattacharya, sections 3.1 and 3.2.
    """

    members: int = 41
    inflation: float = 1.0
    update: str = "square-root"
    centring: str = "mean"
    seed: int = 1
    name: str = field(default="enkf", init=False)

    def __post_init__(self) -> None:
        found = Collector()
        if isinstance(self.members, bool) or int(self.members) != self.members or not 2 <= self.members <= 100_000:
            found.add(("members",), f"members is {self.members}", "a whole number, at least 2")
        if not (np.isfinite(self.inflation) and self.inflation > 0):
            found.add(("inflation",), f"inflation is {self.inflation:g}", "inflation > 0; 1 is none")
        if self.update not in UPDATES:
            found.add(("update",), f"unknown update '{self.update}'", "update: " + " | ".join(UPDATES))
        if self.centring not in CENTRINGS:
            found.add(("centring",), f"unknown centring '{self.centring}'", "centring: " + " | ".join(CENTRINGS))
        if isinstance(self.seed, bool) or int(self.seed) != self.seed or self.seed < 0:
            found.add(("seed",), f"seed is {self.seed}", "a whole number, at least 0")
        found.raise_if_any()

    def start(self, plant: NonlinearPlant, measurement: NonlinearMeasurement) -> Ensemble:
        """The running filter, which stands at the plant's initial mean and covariance."""
        return Ensemble(plant, measurement, self)


class Ensemble:
    """A running ensemble filter.

    Parameters
    ----------
    plant, measurement : what moves and what is seen
    options : EnsembleFilter
    """

    def __init__(self, plant: NonlinearPlant, measurement: NonlinearMeasurement, options: EnsembleFilter):
        self.plant, self.measurement, self.options, self.step = plant, measurement, options, 0
        count = options.members
        self.members = plant.mean[:, None] + draw(split_seed(options.seed, 0), plant.covariance, count)
        self._noise, self._perturb = split_seed(options.seed, 1), split_seed(options.seed, 2)

    @property
    def mean(self) -> np.ndarray:
        """(n,) ensemble mean."""
        return np.mean(self.members, axis=1)

    @property
    def covariance(self) -> np.ndarray:
        """(n, n) sample covariance, divided by N - 1."""
        away = self.members - self.mean[:, None]
        return away @ away.T / (away.shape[1] - 1)

    def forecast(self, batch: int) -> Forecast:
        """Moments of x_{k+q} and y_{k+1} .. y_{k+q}; (6), (9), (10). The filter stands at k+q afterwards."""
        noise = None
        if np.any(self.plant.noise):
            n, count = self.members.shape
            draws = draw(self._noise, self.plant.noise, batch * count)
            noise = draws.reshape(n, batch, count).transpose(1, 0, 2)
        run = run_batch(self.plant, self.measurement, self.members, self.step, batch, noise, self.options.inflation)
        members, values = run.members, run.values
        mean, centre = np.mean(members, axis=1), np.mean(values, axis=1)
        reference = centre if self.options.centring == "mean" else run.values_of_mean
        scale = 1 / np.sqrt(members.shape[1] - 1)
        moments = moments_of_anomalies(scale * (members - mean[:, None]), scale * (values - reference[:, None]))
        self.members, self._values, self.step = members, values, self.step + batch
        return Forecast(run.times, mean, centre, moments, members)

    def update(self, forecast: Forecast, precisions: np.ndarray, observed: np.ndarray) -> np.ndarray:
        """Take the measurements of a batch in, without those of precision 0; return the covariance (11), (n, n).

        precisions, observed : (q*m,) each

        Perturbed: X + K (y - H(X) + e). Square root: mean + K (y - mean H(X)), anomalies times (I + A_y'SA_y)^(-1/2).
        """
        moments = forecast.moments
        precisions = np.asarray(precisions, dtype=float)
        used = precisions > 0
        kalman = gain(moments.cross, moments.measurement, precisions)
        observed = np.where(used, np.nan_to_num(observed), 0.0)
        if self.options.update == "perturbed":
            error = self._perturb.standard_normal(self._values.shape)
            error = np.where(used[:, None], error / np.sqrt(np.where(used, precisions, 1.0))[:, None], 0.0)
            innovation = np.where(used[:, None], observed[:, None] - self._values + error, 0.0)
            self.members = self.members + kalman @ innovation
        else:
            assert moments.anomalies is not None
            transform = square_root_transform(moments.anomalies[moments.states :], precisions)
            mean = forecast.mean + kalman @ np.where(used, observed - forecast.measurement_mean, 0.0)
            self.members = mean[:, None] + (self.members - forecast.mean[:, None]) @ transform
        half = kalman @ moments.cross.T
        return moments.state - (half + half.T) / 2

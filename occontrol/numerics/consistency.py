"""Does a filter believe of its errors what is true? NIS and NEES with their chi-squared bands.

    NIS  = e' Y^-1 e            of an innovation e with m values:   chi-squared, m degrees, independent in time
    NEES = (x - xh)' P^-1 (x - xh)   of the n states:               chi-squared, n degrees, dependent in time

Averages over independent runs are compared with the band that holds them with 99 % probability.
Source: Bar-Shalom, Li & Kirubarajan, Estimation with Applications to Tracking and Navigation, 5.4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occontrol.core.measurement import Estimate
from occontrol.core.trajectory import Trajectory
from occontrol.numerics.linalg import whitener

PROBABILITY = 0.99


def average_band(degrees: float, probability: float = PROBABILITY) -> tuple[float, float]:
    """The band of (chi-squared with `degrees` degrees)/degrees: two-sided, e.g. 0.5 % on either side.

    Parameters
    ----------
    degrees : degrees of freedom in all (values times runs)
    probability : of lying inside
    """
    from scipy.stats import chi2

    tail = (1 - probability) / 2
    low, high = chi2.ppf([tail, 1 - tail], degrees) / degrees
    return float(low), float(high)


def nees(truth: np.ndarray, mean: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Normalised estimation error squared at every node, and its degrees of freedom (n, less where P is singular).

    Parameters
    ----------
    truth : (..., K, n) true states; leading axes are runs
    mean : (..., K, n)
    covariance : (K, n, n)
    """
    error = truth - mean
    value = np.zeros(error.shape[:-1])
    degrees = np.zeros(len(covariance), dtype=int)
    for k, P in enumerate(covariance):
        white = whitener(P)
        value[..., k] = np.sum((error[..., k, :] @ white) ** 2, axis=-1)
        degrees[k] = white.shape[1]
    return value, degrees


@dataclass(frozen=True, eq=False)
class Consistency:
    """NIS and NEES of K runs.

    Parameters
    ----------
    times : (N+1,) nodes
    nis : (K, N) NaN where nothing was measured
    dimension : (N,) values behind each
    nees : (K, N+1)
    degrees : (N+1,)
    """

    times: np.ndarray
    nis: np.ndarray
    dimension: np.ndarray
    nees: np.ndarray
    degrees: np.ndarray

    @property
    def average_nis(self) -> float:
        """NIS per value, over all steps and runs."""
        return float(np.nansum(self.nis) / (len(self.nis) * max(1, int(np.sum(self.dimension)))))

    @property
    def nis_band(self) -> tuple[float, float]:
        """The 99 % band of `average_nis`."""
        return average_band(len(self.nis) * int(np.sum(self.dimension)))

    @property
    def average_nees(self) -> np.ndarray:
        """(N+1,) NEES per degree of freedom, over the runs; NaN where the covariance is zero."""
        degrees = np.where(self.degrees > 0, self.degrees, np.nan)
        return np.mean(self.nees, axis=0) / degrees

    @property
    def nees_band(self) -> tuple[float, float]:
        """The 99 % band of `average_nees` at one node (of those with most degrees of freedom)."""
        return average_band(len(self.nees) * max(1, int(np.max(self.degrees))))

    @property
    def nees_inside(self) -> float:
        """The share of the nodes at which `average_nees` lies inside its band; 0.99 is expected."""
        bands = {d: average_band(len(self.nees) * d) for d in set(self.degrees.tolist()) if d}
        pairs = zip(self.average_nees, self.degrees.tolist(), strict=True)
        inside = [bands[d][0] <= value <= bands[d][1] for value, d in pairs if d]
        return float(np.mean(inside)) if inside else 1.0


def judge_run(estimate: Estimate, truth: Trajectory) -> Consistency:
    """NIS and NEES of one filter run whose truth is known.

    Parameters
    ----------
    estimate : Estimate with one row per node
    truth : Trajectory at the same nodes
    """
    value, degrees = nees(truth.values[None], estimate.mean[None], estimate.covariance)
    return Consistency(estimate.times, estimate.nis[None, 1:], estimate.dimension[1:], value, degrees)

"""What arrives from the sensors, and what a filter makes of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Measurement:
    """One sample of one sensor (one line of a measurement file).

    Parameters
    ----------
    time : t of the sample; in continuous time the value is the average over the interval that ends there
    sensor : the sensor's name
    values : (m,) the values
    line : line number in the file it came from, 0 if none
    """

    time: float
    sensor: str
    values: np.ndarray
    line: int = 0


@dataclass(frozen=True, eq=False)
class Estimate:
    """What a filter returns, one row per time.

    Parameters
    ----------
    times : (K,)
    mean : (K, n) state estimate
    standard_deviation : (K, n)
    predicted : (K, p) prediction of w (p = 0 where the family predicts nothing)
    predicted_deviation : (K, p)
    nis : (K,) normalised innovation squared; NaN where nothing was measured
    dimension : (K,) number of values behind each nis
    covariance : (K, n, n)
    notes : announcements, e.g. that missing samples made the precomputed covariance invalid
    output, output_deviation : (K, p) w(t) = D(t) x(t) at the time of the row itself, where the family has it
    """

    times: np.ndarray
    mean: np.ndarray
    standard_deviation: np.ndarray
    predicted: np.ndarray
    predicted_deviation: np.ndarray
    nis: np.ndarray
    dimension: np.ndarray
    covariance: np.ndarray
    notes: tuple[str, ...] = ()
    output: np.ndarray | None = None
    output_deviation: np.ndarray | None = None

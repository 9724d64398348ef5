"""What arrives from the sensors, and what a filter makes of it: sample by sample, step by step, over a whole file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np


@dataclass(frozen=True, eq=False)
class Measurement:
    """One sample of one sensor (one line of a measurement file).

    Parameters
    ----------
    time : t of the sample, in the unit of time; in continuous time the value is the average over the interval that
        ends there
    sensor : the sensor's name
    values : (m,) the values, in measurement units
    line : line number in the file it came from, 0 if none
    """

    time: float
    sensor: str
    values: np.ndarray
    line: int = 0


@dataclass(frozen=True, eq=False, kw_only=True)
class Step:
    """What an on-line object knows after a step; families with more to say add fields in a subclass.

    Parameters
    ----------
    time : t of the estimate, in the unit of time; k in discrete time
    estimate, covariance : (n,), (n, n) of the state, in state units and their squares. Where a family bounds errors
        instead of describing them by chance, the centre of the set of possible states and its shape times its level
    prediction, prediction_covariance : (p,), (p, p) of w, in units of w and their squares; p = 0 where the
        family predicts nothing
    nis : normalised innovation squared of the values just taken in, NaN where there were none
    dimension : number of values behind nis
    next_sensors : names of the sensors to read next; () for none, and at the end
    """

    time: float
    estimate: np.ndarray
    covariance: np.ndarray
    prediction: np.ndarray = field(default_factory=lambda: np.zeros(0))
    prediction_covariance: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    nis: float = math.nan
    dimension: int = 0
    next_sensors: tuple[str, ...] = ()

    @property
    def standard_deviation(self) -> np.ndarray:
        """(n,) of every state."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))


@dataclass(frozen=True, eq=False)
class Estimate:
    """What a filter returns, one row per time.

    Parameters
    ----------
    times : (K,), in the unit of time
    mean : (K, n) state estimate, in state units
    standard_deviation : (K, n), in state units
    predicted : (K, p) prediction of w, in units of w (p = 0 where the family predicts nothing)
    predicted_deviation : (K, p), in units of w
    nis : (K,) normalised innovation squared; NaN where nothing was measured
    dimension : (K,) number of values behind each nis
    covariance : (K, n, n), in state units squared
    notes : announcements, e.g. that missing samples made the precomputed covariance invalid
    output, output_deviation : (K, p) w(t) = D(t) x(t), in units of w, at the time of the row, where the family has it
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


class OnlineLoop(Protocol):
    """What runs in a loop on a target, such as MatchedFilter: each family's own class says what it takes and gives."""

    @property
    def next_sensors(self) -> tuple[str, ...]:
        """Names of the sensors to read next; () for none, and at the end."""
        ...

    @property
    def times_left(self) -> np.ndarray:
        """The times of the steps that are left, as in a measurement file, in the unit of time; empty at the end."""
        ...

    def step(self, measurements: Mapping[str, np.ndarray] | None = None) -> Step:
        """The estimate and what to measure next, after `measurements` (m,) by the name of each sensor that was read."""
        ...

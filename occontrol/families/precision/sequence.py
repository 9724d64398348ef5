"""Batches one after another: forecast, choose the precisions, measure a simulated truth with exactly those, update.

The truth is drawn from the initial mean and covariance and moves with the plant's own noise; every batch's covariance
after the update is held against the bound that its precisions were chosen for.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from occontrol.families.precision.ensemble import EnsembleFilter
from occontrol.families.precision.forecast import Forecast, draw, split_seed
from occontrol.families.precision.measurement import NonlinearMeasurement
from occontrol.families.precision.plant import NonlinearPlant
from occontrol.families.precision.unscented import UnscentedFilter
from occontrol.numerics.linalg import normalised_square


class Chosen(Protocol):
    """What decides about a batch."""

    @property
    def precisions(self) -> np.ndarray | None:
        """(q*m,), or None where nothing meets the bound."""
        ...


@dataclass(frozen=True, eq=False)
class Truth:
    """A simulated truth: times (K*q + 1,), states (K*q + 1, n), noise-free measurements (K*q, m)."""

    times: np.ndarray
    states: np.ndarray
    values: np.ndarray


@dataclass(frozen=True, eq=False)
class BatchOutcome:
    """What happened in one batch.

    Parameters
    ----------
    forecast : Forecast
    chosen : what `choose` returned; its `precisions` (q*m,) were used
    observed : (q*m,) measurements, NaN where the precision is zero
    mean, covariance : (n,), (n, n) after the update, covariance by equation (11)
    filter_covariance : (n, n) what the filter itself holds afterwards (an ensemble's sample covariance)
    truth : (n,) true state at the end of the batch
    nis : normalised innovation squared of the measurements that were used
    """

    forecast: Forecast
    chosen: Chosen
    observed: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray
    filter_covariance: np.ndarray
    truth: np.ndarray
    nis: float


def simulate_truth(plant: NonlinearPlant, measurement: NonlinearMeasurement, steps: int, seed: int) -> Truth:
    """Draw x_0 and drive it through `steps` steps; the same seed gives the same truth."""
    generator = split_seed(seed, 3)
    states = [plant.mean + draw(generator, plant.covariance, 1)[:, 0]]
    values = []
    for k in range(steps):
        moved = plant.advance(states[-1][:, None], k * plant.interval)
        moved = moved + draw(generator, plant.noise, 1)
        states.append(moved[:, 0])
        values.append(measurement.values(moved, (k + 1) * plant.interval)[:, 0])
    return Truth(np.arange(steps + 1) * plant.interval, np.array(states), np.array(values))


def observe(values: np.ndarray, precisions: np.ndarray, generator: np.random.Generator) -> np.ndarray:
    """Noisy measurements of noise-free `values` with `precisions`, (q*m,) each; NaN where nothing is measured."""
    used = precisions > 0
    noise = generator.standard_normal(len(values)) / np.sqrt(np.where(used, precisions, 1.0))
    return np.where(used, values + noise, np.nan)


def innovation_squared(forecast: Forecast, precisions: np.ndarray, observed: np.ndarray) -> float:
    """nu' (Y + R)^-1 nu over the measurements in use; chi-squared with as many degrees for a linear plant.

    `precisions` (q*m,), `observed` (q*m,).
    """
    used = np.flatnonzero(precisions > 0)
    if not len(used):
        return float("nan")
    root = np.sqrt(precisions[used])
    innovation = root * (observed - forecast.measurement_mean)[used]
    inner = np.eye(len(used)) + root[:, None] * forecast.moments.measurement[np.ix_(used, used)] * root
    return float(normalised_square(innovation, inner))


def run_sequence(
    plant: NonlinearPlant,
    measurement: NonlinearMeasurement,
    options: EnsembleFilter | UnscentedFilter,
    batch: int,
    batches: int,
    choose: Callable[[Forecast, int], Chosen | None],
    seed: int = 0,
) -> list[BatchOutcome]:
    """Run `batches` batches of `batch` steps; ends early when `choose` has no precisions to measure with.

    Parameters
    ----------
    choose : (forecast, number of the batch) -> an object with `precisions` (q*m,); None stops before the batch,
        an object whose `precisions` are None after it
    seed : of the truth and the measurement noise

    The last outcome of a sequence that ended early holds the refused choice, and the forecast as its estimate.
    """
    filter_ = options.start(plant, measurement)
    truth = simulate_truth(plant, measurement, batch * batches, seed)
    generator = split_seed(seed, 4)
    outcomes = []
    for k in range(batches):
        forecast = filter_.forecast(batch)
        chosen = choose(forecast, k)
        if chosen is None:
            break
        precisions = chosen.precisions
        end = truth.states[(k + 1) * batch]
        if precisions is None:
            prior, none = forecast.moments.state, np.full(len(forecast.measurement_mean), np.nan)
            outcomes.append(BatchOutcome(forecast, chosen, none, forecast.mean, prior, prior, end, float("nan")))
            break
        values = truth.values[k * batch : (k + 1) * batch].ravel()
        observed = observe(values, precisions, generator)
        nis = innovation_squared(forecast, precisions, observed)
        covariance = filter_.update(forecast, precisions, observed)
        outcomes.append(
            BatchOutcome(forecast, chosen, observed, filter_.mean, covariance, filter_.covariance, end, nis)
        )
    return outcomes

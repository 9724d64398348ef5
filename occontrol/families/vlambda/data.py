"""The V-Lambda filter over data: a seeded truth with its measurements, and the estimate from a measurement file."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from occontrol.core.arrange import STEP_SLACK, arrange, step_times
from occontrol.core.errors import Mistake, ProblemError, UsageError, plural
from occontrol.core.measurement import Estimate, Measurement
from occontrol.core.trajectory import Trajectory
from occontrol.families.vlambda.online import OnlineSelector
from occontrol.families.vlambda.sampled_plant import SampledPlant
from occontrol.families.vlambda.sensor_choice import Chooser
from occontrol.numerics.linalg import square_root


def simulate_selection(
    plant: SampledPlant, starts: np.ndarray, select: int, chooser: Chooser, seed: int
) -> tuple[list[Measurement], Trajectory]:
    """Draw x(0), the plant noise and the noise of the selected sensors.

    Parameters
    ----------
    plant, select, chooser : as in OnlineSelector
    starts : (E+1,), as in OnlineSelector
    seed : of the generator; the same seed gives the same data

    Returns
    -------
    Measurements, t = k, in the order of k, and the truth x(0) .. x(K-1) (K, n) in the user's units.
    """
    generator = np.random.default_rng(seed)
    loop = OnlineSelector(plant, starts, select, chooser)
    state = plant.mean + square_root(plant.covariance, scaled=False) @ generator.standard_normal(plant.states)
    truth, found = [], []
    for k in range(plant.steps):
        truth.append(state * plant.scales)
        for j in loop.choice.sensors:
            H, R = loop.matrices(j)
            noise = np.linalg.cholesky(R) @ generator.standard_normal(len(H))
            found.append(Measurement(float(k), plant.names[j], H @ state + noise))
        state = plant.transition[k] @ state + plant.noise_root[k] @ generator.standard_normal(plant.noise_root.shape[2])
        loop.step()
    return found, Trajectory(np.arange(plant.steps, dtype=float), np.array(truth))


def filter_measurements(
    plant: SampledPlant, starts: np.ndarray, select: int, chooser: Chooser, measurements: Sequence[Measurement]
) -> Estimate:
    """Run the filter over every step of the horizon, whatever was measured.

    Parameters
    ----------
    plant, select, chooser : as in OnlineSelector
    starts : (E+1,), as in OnlineSelector
    measurements : t must be a step k; at most one per sensor and step; a value that is NaN is missing

    Returns
    -------
    Estimate with one row per k = 0 .. K-1. Missing samples mean no update, and `notes` says how many there were.

    Raises ProblemError naming line and mistake.
    """
    steps_of_horizon, rows = step_times(0, plant.steps - 1), [s.sensor.rows for s in plant.sensors]
    by_step = arrange(steps_of_horizon, plant.names, rows, None, measurements, slack=STEP_SLACK, instants=True)
    loop = OnlineSelector(plant, starts, select, chooser)
    steps, missing, extra, holes = [], 0, 0, 0
    while not loop.finished:
        k = loop.step_number
        given, planned = by_step[k], set(loop.sensors)
        try:
            steps.append(loop.step(given))
        except UsageError as error:  # a movable sensor that was not selected is nowhere
            line = next((m.line for m in measurements if round(m.time) == k and m.sensor in given), 0)
            place = f"line {line}" if line else f"t = {k}"
            raise ProblemError(Mistake((), str(error), place=place)) from None
        missing += len(steps[-1].missing)
        extra += len(set(given) - planned)
        gone = [(int(np.isnan(values).sum()), len(values)) for values in given.values()]
        holes += sum(count for count, size in gone if count < size)
    notes = list(loop.filter.notes)
    if missing:
        notes.append(f"{plural(missing, 'planned sample')} missing: no update there, the covariance is not the run's")
    if holes:
        notes.append(
            f"{plural(holes, 'value')} missing: what else the sensor read is used, the covariance is not the run's"
        )
    if extra:
        notes.append(f"{plural(extra, 'sample')} of sensors that were not selected at that step: used all the same")
    count = len(steps)
    return Estimate(
        np.array([s.time for s in steps]),
        np.array([s.estimate for s in steps]),
        np.array([s.standard_deviation for s in steps]),
        np.empty((count, 0)),
        np.empty((count, 0)),
        np.array([s.nis for s in steps]),
        np.array([s.dimension for s in steps]),
        np.array([s.covariance for s in steps]),
        tuple(notes),
    )

"""The V-Lambda filter over data: a seeded truth with its measurements, and the estimate from a measurement file."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from occontrol.core.errors import Mistake, ProblemError, UsageError
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
    plant, starts, select, chooser : as in OnlineSelector
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
    plant, starts, select, chooser : as in OnlineSelector
    measurements : t must be a step k; at most one per sensor and step; a value that is NaN is missing

    Returns
    -------
    Estimate with one row per k = 0 .. K-1. Missing samples mean no update, and `notes` says how many there were.

    Raises ProblemError naming line and mistake.
    """
    by_step = _by_step(plant, measurements)
    loop = OnlineSelector(plant, starts, select, chooser)
    steps, missing, extra, holes = [], 0, 0, 0
    while not loop.finished:
        k = loop.step_number
        given = by_step.get(k, {})
        planned = set(loop.sensors)
        try:
            steps.append(loop.step({name: m.values for name, m in given.items()}))
        except UsageError as error:
            raise ProblemError(Mistake((), str(error), place=_place(next(iter(given.values()))))) from None
        missing += len(steps[-1].missing)
        extra += len(set(given) - planned)
        gone = [int(np.isnan(m.values).sum()) for m in given.values()]
        holes += sum(count for count, m in zip(gone, given.values(), strict=True) if count < len(m.values))
    notes = list(loop.filter.notes)
    if missing:
        s = "s" * (missing != 1)
        notes.append(f"{missing} planned sample{s} missing: no update there, the covariance is not the run's")
    if holes:
        s = "s" * (holes != 1)
        notes.append(f"{holes} value{s} missing: what else the sensor read is used, the covariance is not the run's")
    if extra:
        notes.append(
            f"{extra} sample{'s' * (extra != 1)} of sensors that were not selected at that step: used all the same"
        )
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


def _place(measurement: Measurement) -> str:
    return f"line {measurement.line}" if measurement.line else f"t = {measurement.time:g}"


def _by_step(plant: SampledPlant, measurements: Sequence[Measurement]) -> dict[int, dict[str, Measurement]]:
    """Measurements by step and sensor; several mistakes are reported together."""
    rows = {s.sensor.name: s.sensor.rows for s in plant.sensors}
    found: dict[int, dict[str, Measurement]] = {}
    mistakes = []
    for m in measurements:
        k, where = round(float(m.time)), _place(m)
        if m.sensor not in rows:
            mistakes.append(
                Mistake((), f"there is no sensor '{m.sensor}'", "there are: " + ", ".join(rows), place=where)
            )
        elif abs(m.time - k) > 1e-9 or not 0 <= k < plant.steps:
            what = f"t = {m.time:g} is not a step of the horizon"
            mistakes.append(Mistake((), what, f"t is k = 0 .. {plant.steps - 1}", place=where))
        elif len(m.values) != rows[m.sensor] or np.any(np.isinf(m.values)):
            s, came = "s" * (rows[m.sensor] != 1), len(m.values)
            infinite = "an infinite one" if came == rows[m.sensor] else f"{came} came"
            what = f"sensor '{m.sensor}' has {rows[m.sensor]} value{s}, {infinite}"
            mistakes.append(Mistake((), what, "leave a missing value empty, or its line out", place=where))
        elif m.sensor in found.setdefault(k, {}):
            mistakes.append(Mistake((), f"sensor '{m.sensor}' is there twice at k = {k}", place=where))
        else:
            found[k][m.sensor] = m
    if mistakes:
        raise ProblemError(mistakes)
    return found

"""The noise of a sensor as a problem file states it: an intensity, or the variance of one reading and their spacing.

Theta = R h      readings of variance R, one every h, tell as much as continuous sensing of intensity Theta
"""

from __future__ import annotations

import numpy as np

from occontrol.core.errors import Path
from occontrol.core.scaled_signal import scaled
from occontrol.core.signal import Signal
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.files.schema.common import Context

EXAMPLE = "noise: [[0.1]], or variance: [[0.5]] with every: 0.2"


def sensor_noise(
    noise: object, variance: object, every: float | None, name: str, path: Path, context: Context
) -> Signal | None:
    """The intensity Theta (m, m); None where there is a mistake, which is noted.

    Parameters
    ----------
    noise, variance : as in the file, or None
    every : time between two readings, or None
    name, path : of the sensor in the file
    context : where mistakes are noted
    """
    found = context.found
    if (noise is None) == (variance is None):
        what = f"sensor '{name}' has no 'noise'" if noise is None else f"sensor '{name}' has noise and variance"
        found.add((*path, "noise") if noise is not None else path, what, EXAMPLE)
        return None
    if variance is None:
        if every is not None:
            found.add((*path, "every"), "every belongs to a variance, not to a noise intensity", EXAMPLE)
        return context.signal(noise, *path, "noise")
    if every is None:
        found.add((*path, "variance"), "the variance of one reading needs 'every'", EXAMPLE)
        return None
    if not (np.isfinite(every) and every > 0):
        found.add((*path, "every"), f"every is {every:g}, it must be a time above 0", "the time between two readings")
        return None
    stated = context.signal(variance, *path, "variance")
    if stated is None:
        return None
    rows = stated.shape[0]
    return scaled(stated, np.full(rows, float(every)), np.ones(rows))


def sample_deviations(problem: SchedulingProblem) -> list[tuple[str, float, np.ndarray]]:
    """What one sample of every sensor is worth: (name, h, (m,) deviations sqrt(Theta_ii / h)).

    A sample is the average over one interval of the edges; h is the median length.

    Parameters
    ----------
    problem : SchedulingProblem
    """
    h, middle = float(np.median(problem.steps)), problem.midpoints[[problem.intervals // 2]]
    return [
        (s.name, h, np.sqrt(np.maximum(np.diagonal(s.noise.sample(middle)[0]), 0.0) / h))
        for s in problem.sensors
        if s.rows
    ]

"""How far a plant that nobody measures grows over its horizon, as a power of ten: refused beyond what numbers hold."""

from __future__ import annotations

import numpy as np

from occontrol.core.errors import Mistake
from occontrol.core.plant import LinearPlant

MOST_DECADES = 290.0  # powers of ten; doubles end at 308, and costs are products of a covariance with weights
SAMPLES = 64
MANY_STATES = 200  # states from which fewer samples have to do


def growth(plant: LinearPlant, edges: np.ndarray) -> float:
    """log10 of the factor by which a covariance grows over the horizon without measurements.

    2 log10 |Phi(T, t0)|: for a constant A by its largest real part, otherwise by the product of exponentials of A
    frozen on sub-intervals, scaled at every step.

    Parameters
    ----------
    plant : LinearPlant with A (n, n)
    edges : (N+1,) times
    """
    start, end = float(edges[0]), float(edges[-1])
    if plant.A.constant:
        rate = float(np.max(np.linalg.eigvals(plant.A.at(start)).real))
        return 2 * max(rate, 0.0) * (end - start) / np.log(10)
    from scipy.linalg import expm

    n = plant.states
    cells = np.linspace(start, end, (SAMPLES if n <= MANY_STATES else 8) + 1)
    phi, total, width = np.eye(n), 0.0, float(cells[1] - cells[0])
    for middle in (cells[1:] + cells[:-1]) / 2:
        A = plant.A.at(float(middle))
        rate = float(np.max(np.linalg.eigvals(A).real))
        phi = expm((A - rate * np.eye(n)) * width) @ phi  # the shift keeps the exponential among the numbers
        size = float(np.linalg.norm(phi, 2))
        if not np.isfinite(size) or size == 0:
            return total * 2 / np.log(10)
        total += rate * width + np.log(size)
        phi /= size
    return 2 * max(total, 0.0) / np.log(10)


def beyond_numbers(plant: LinearPlant, edges: np.ndarray) -> list[Mistake]:
    """The mistake that the plant grows beyond what numbers hold, or an empty list.

    Parameters
    ----------
    plant : LinearPlant
    edges : (N+1,) times
    """
    power = growth(plant, edges)
    if power <= MOST_DECADES:
        return []
    what = f"the plant grows beyond numbers: unmeasured, its covariance grows 10^{power:.0f} times over the horizon"
    return [Mistake(("plant", "A"), what, "shorten the horizon, or mend the unit of time: A is a rate per unit of it")]

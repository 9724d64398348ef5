"""A linear plant as formulas, and the textbook Kalman filter over it, one scalar measurement at a time."""

import numpy as np

from occontrol.families.precision.measurement import NonlinearMeasurement
from occontrol.families.precision.plant import NonlinearPlant

RNG = np.random.default_rng(0)
F = 0.6 * RNG.standard_normal((3, 3))
H = RNG.standard_normal((2, 3))
NOISE = np.diag([0.1, 0.2, 0.0])
COVARIANCE = np.array([[0.6, 0.1, 0.1], [0.1, 0.6, 0.1], [0.1, 0.1, 0.6]])
MEAN = RNG.standard_normal(3)
PRECISIONS = RNG.uniform(0, 3, (6, 2))
PRECISIONS[1, 0] = 0.0
OBSERVED = RNG.standard_normal((6, 2))


def rows(matrix):
    return [" + ".join(f"({v:.17g})*x{j + 1}" for j, v in enumerate(row)) for row in matrix]


def linear(noise=NOISE):
    return NonlinearPlant(COVARIANCE, MEAN, f=rows(F), noise=noise), NonlinearMeasurement(3, h=rows(H))


def kalman(noise=NOISE):
    mean, covariance = MEAN, COVARIANCE
    for k in range(6):
        mean, covariance = F @ mean, F @ covariance @ F.T + noise
        for j in range(2):
            if PRECISIONS[k, j] > 0:
                innovation = H[j] @ covariance @ H[j] + 1 / PRECISIONS[k, j]
                gain = covariance @ H[j] / innovation
                mean = mean + gain * (OBSERVED[k, j] - H[j] @ mean)
                covariance = covariance - np.outer(gain, H[j] @ covariance)
    return mean, covariance


def run(filter_, batch):
    """Drive a filter through the six steps in batches; its covariance by equation (11) at the end."""
    for k in range(0, 6, batch):
        forecast = filter_.forecast(batch)
        covariance = filter_.update(forecast, PRECISIONS[k : k + batch].ravel(), OBSERVED[k : k + batch].ravel())
    return filter_.mean, covariance

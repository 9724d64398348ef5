"""Collocation schemes on [0, 1] as Runge-Kutta tables: Radau IIA and Gauss-Legendre, any number of stages."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.polynomial import legendre

SCHEMES = ("radau", "legendre")


@lru_cache(maxsize=16)
def butcher_table(scheme: str, stages: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A (s, s), b (s,), c (s,) of a collocation method.

    Parameters
    ----------
    scheme : "radau" (IIA: order 2s - 1, stiffly accurate, its last stage is the end) or "legendre" (order 2s)
    stages : s >= 1

    Raises ValueError for another scheme. Hairer, Wanner (1996), sections IV.5 and IV.8.
    """
    if scheme not in SCHEMES or stages < 1:
        raise ValueError(f"scheme '{scheme}' with {stages} stages; schemes: {', '.join(SCHEMES)}, stages >= 1")
    series = np.zeros(stages + 1)
    series[stages] = 1.0
    if scheme == "radau":
        series[stages - 1] = -1.0
    c = (np.sort(np.real(legendre.legroots(series))) + 1) / 2
    if scheme == "radau":
        c[-1] = 1.0
    powers = np.vander(c, increasing=True)
    degrees = np.arange(1, stages + 1)
    A = np.linalg.solve(powers.T, (c[:, None] ** degrees / degrees).T).T
    b = np.linalg.solve(powers.T, 1.0 / degrees)
    return A, b, c

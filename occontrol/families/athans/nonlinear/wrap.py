"""Differences of angles, between -pi and pi."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def wrapped(difference: np.ndarray, angles: Sequence[bool] | np.ndarray) -> np.ndarray:
    """Differences of values, those of angles brought to [-pi, pi).

    Parameters
    ----------
    difference : (..., m), in measurement units
    angles : (m,) which values are angles [rad]
    """
    found = np.array(difference, dtype=float)
    which = np.flatnonzero(np.asarray(angles, dtype=bool))
    if len(which):
        found[..., which] = np.mod(found[..., which] + np.pi, 2 * np.pi) - np.pi
    return found

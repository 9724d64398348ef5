"""Ellipsoid sizes as criteria of the convex engine: from above, smoothed, and from below, supporting."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occontrol.families.robust.ellipsoid_size import Size


class _SizeCriterion:
    """A Criterion whose value and gradient (n, n) at P (n, n) come from one decomposition."""

    def linearised(self, covariance: np.ndarray) -> tuple[float, np.ndarray]:
        """Value and gradient (n, n) at P (n, n)."""
        raise NotImplementedError

    def value(self, covariance: np.ndarray) -> float:
        """The function at P (n, n)."""
        return self.linearised(covariance)[0]

    def gradient(self, covariance: np.ndarray) -> np.ndarray:
        """Its gradient (n, n) at P (n, n)."""
        return self.linearised(covariance)[1]


@dataclass(frozen=True)
class Smoothed(_SizeCriterion):
    """A size with its kink smoothed, never below the size: what the relaxation minimises.

    Parameters
    ----------
    size : Size
    level : d
    power : of the mean that stands for the largest eigenvalue, see `Size.smooth`
    """

    size: Size
    level: float
    power: float

    def linearised(self, covariance: np.ndarray) -> tuple[float, np.ndarray]:
        """The smoothed size and its gradient (n, n) at P, `covariance` (n, n)."""
        return self.size.smooth(covariance, self.level, self.power)

    def smoothing_error(self, covariance: np.ndarray) -> float:
        """By how much it exceeds the size at P, `covariance` (n, n)."""
        return self.value(covariance) - float(self.size.value(covariance, self.level))


@dataclass(frozen=True)
class Supported(_SizeCriterion):
    """A convex function that touches a size at the shape where it is asked for and nowhere exceeds it: for planes.

    Parameters
    ----------
    size : Size
    level : d
    power : infinite for the longest axis alone, see `Size.support`
    """

    size: Size
    level: float
    power: float = np.inf

    def linearised(self, covariance: np.ndarray) -> tuple[float, np.ndarray]:
        """The supporting function at P, `covariance` (n, n), and its gradient (n, n)."""
        return self.size.support(covariance, self.level, self.power)

    def smoothing_error(self, covariance: np.ndarray) -> float:
        """0 for any `covariance` (n, n): it never exceeds the size."""
        return 0.0

"""What is charged at the end: a function of the covariance that is convex in the information, with its gradient."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np


class Criterion(Protocol):
    """A function of a covariance S (n, n) that grows with S and is convex in its inverse.

    That much makes J convex in the policy, so that every gradient gives a lower bound.

    Attributes
    ----------
    signed : whether it may be negative, as logarithms are; then no bound may be raised to 0
    """

    signed: ClassVar[bool]

    def value(self, covariance: np.ndarray) -> float:
        """The criterion at S, `covariance` (n, n)."""
        ...

    def gradient(self, covariance: np.ndarray) -> np.ndarray:
        """The weight matrix d value/dS (n, n), symmetric and positive semidefinite: what the costate ends with.

        S is `covariance` (n, n).
        """
        ...

    def smoothing_error(self, covariance: np.ndarray) -> float:
        """What comes off J at S before its tangent bounds the criterion that `value` smooths; 0 without smoothing.

        S is `covariance`, (n, n).
        """
        ...

    def rounding(self, covariance: np.ndarray) -> float:
        """How far the last digit of S, `covariance` (n, n), moves what is not linear in it."""
        ...


class CorneredCriterion(Criterion, Protocol):
    """A criterion with corners, which can be smoothed from above.

    Attributes
    ----------
    smoothing : mu, 0 for the true criterion
    """

    @property
    def smoothing(self) -> float: ...

    def smoothed(self, smoothing: float) -> CorneredCriterion:
        """The same with another mu, `smoothing`."""
        ...

    @property
    def spread(self) -> float:
        """By so much the smoothed value may lie above the true one, for each unit of mu."""
        ...


class CurvedCriterion(Criterion, Protocol):
    """A criterion with second derivatives, for Newton's method."""

    def curvature(self, covariance: np.ndarray, changes: np.ndarray) -> np.ndarray:
        """Second derivatives (m, m) at S, `covariance` (n, n), along `changes` of S (m, n, n)."""
        ...


@dataclass(frozen=True, eq=False)
class TraceCriterion:
    """tr(W S): linear, so its weight is the same for every policy and the sweep's loops compile it in.

    Parameters
    ----------
    weight : (n, n) W, symmetric positive semidefinite
    """

    weight: np.ndarray
    signed: ClassVar[bool] = False

    def value(self, covariance: np.ndarray) -> float:
        """tr(W S) for S, `covariance` (n, n)."""
        return float(np.vdot(self.weight, covariance))

    def gradient(self, covariance: np.ndarray) -> np.ndarray:
        """W (n, n), whatever `covariance` (n, n) is."""
        return self.weight

    def smoothing_error(self, covariance: np.ndarray) -> float:
        """0 for any `covariance` (n, n): nothing is smoothed."""
        return 0.0

    def rounding(self, covariance: np.ndarray) -> float:
        """0 for any `covariance` (n, n): it is linear."""
        return 0.0

    def curvature(self, covariance: np.ndarray, changes: np.ndarray) -> np.ndarray:
        """0 (m, m) at any `covariance` (n, n) along `changes` (m, n, n): the trace is linear."""
        return np.zeros((len(changes), len(changes)))

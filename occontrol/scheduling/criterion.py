"""What is charged at the end: a function of the covariance that is convex in the information, with its gradient."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np


class Criterion(Protocol):
    """A function of a covariance S (n, n) that grows with S and is convex in its inverse.

    That much makes J convex in the policy, so that every gradient gives a lower bound.
    """

    def value(self, covariance: np.ndarray) -> float:
        """The criterion at S (n, n)."""
        ...

    def gradient(self, covariance: np.ndarray) -> np.ndarray:
        """The weight matrix d value/dS (n, n), symmetric and positive semidefinite: what the costate ends with."""
        ...

    def smoothing_error(self, covariance: np.ndarray) -> float:
        """By how much `value` may exceed the criterion that it smooths, at S (n, n); 0 where nothing is smoothed."""
        ...


@dataclass(frozen=True, eq=False)
class TraceCriterion:
    """tr(W S): linear, so its weight is the same for every policy and the sweep's loops compile it in.

    Parameters
    ----------
    weight : (n, n) W, symmetric positive semidefinite
    """

    weight: np.ndarray

    def value(self, covariance: np.ndarray) -> float:
        """tr(W S) for S (n, n)."""
        return float(np.vdot(self.weight, covariance))

    def gradient(self, covariance: np.ndarray) -> np.ndarray:
        """W (n, n), whatever S (n, n) is."""
        return self.weight

    def smoothing_error(self, covariance: np.ndarray) -> float:
        """0: nothing is smoothed."""
        return 0.0

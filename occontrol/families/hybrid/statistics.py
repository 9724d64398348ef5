"""What many runs of the jumping-mode estimator say: errors over time, on average and at worst, each with its
standard error."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Outcomes:
    """What is kept of every run.

    Parameters
    ----------
    squared : (runs, steps) squared position error
    wrong : (runs, steps) whether the most probable mode is not the true one
    choices : (runs, steps) group in use
    consistency : (runs,) mean over the steps of e' P^-1 e over all states
    excess, error : largest |sum - 1| of guard probabilities before they were divided, largest error estimate of one
    """

    squared: np.ndarray
    wrong: np.ndarray
    choices: np.ndarray
    consistency: np.ndarray
    excess: float = 0.0
    error: float = 0.0

    @property
    def runs(self) -> int:
        """How many runs there are."""
        return len(self.squared)


def join(parts: list[Outcomes]) -> Outcomes:
    """Several sets of runs as one, in their order.

    Parameters
    ----------
    parts : at least one
    """
    names = ("squared", "wrong", "choices", "consistency")
    arrays = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    return Outcomes(**arrays, excess=max(part.excess for part in parts), error=max(part.error for part in parts))


def rms(squared: np.ndarray) -> np.ndarray:
    """Root of the mean over runs, at every step.

    r(k) = sqrt(mean_i e_i(k)^2)

    Parameters
    ----------
    squared : (runs, steps)
    """
    return np.sqrt(np.mean(squared, axis=0))


def average_with_error(squared: np.ndarray, summary: Callable[[np.ndarray], np.ndarray]) -> tuple[float, float]:
    """A summary of r(k) and its jackknife standard error over the runs.

    se^2 = (R - 1)/R sum_i (s_(i) - mean s_(.))^2,  s_(i) without run i

    Parameters
    ----------
    squared : (runs, steps)
    summary : (..., steps) -> (...), for example the mean or the maximum over the last axis

    Returns
    -------
    value, standard error; NaN for a single run. B. Efron, The Jackknife (1982), equation (3.2).
    """
    runs = len(squared)
    value = float(summary(rms(squared)))
    if runs < 2:
        return value, float("nan")
    total = squared.sum(axis=0)
    without = np.empty(runs)
    for first in range(0, runs, 256):
        part = squared[first : first + 256]
        without[first : first + 256] = summary(np.sqrt(np.maximum(total - part, 0.0) / (runs - 1)))
    return value, float(np.sqrt((runs - 1) / runs * np.sum((without - without.mean()) ** 2)))


def mean_with_error(values: np.ndarray) -> tuple[float, float]:
    """Mean over runs and its standard error; NaN for a single run.

    Parameters
    ----------
    values : (runs,)
    """
    spread = float(np.std(values, ddof=1) / np.sqrt(len(values))) if len(values) > 1 else float("nan")
    return float(np.mean(values)), spread


def summarise_runs(outcomes: Outcomes) -> dict[str, float]:
    """The plain numbers of many runs, each with `_standard_error` beside it.

    Parameters
    ----------
    outcomes : Outcomes

    Returns
    -------
    average_rms, peak_rms (mean and largest over the steps of r(k)), mode_errors (steps with the wrong mode, mean
    over runs), average_nees (equals the number of states where the estimator's covariance is honest).
    """
    pairs = {
        "average_rms": average_with_error(outcomes.squared, lambda r: np.mean(r, axis=-1)),
        "peak_rms": average_with_error(outcomes.squared, lambda r: np.max(r, axis=-1)),
        "mode_errors": mean_with_error(outcomes.wrong.sum(axis=1)),
        "average_nees": mean_with_error(outcomes.consistency),
    }
    result = {}
    for name, (value, error) in pairs.items():
        result |= {name: value, f"{name}_standard_error": error}
    return result

"""What a problem without an initial covariance cannot have, on any clock."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from occontrol.core.errors import Collector, Mistake

if TYPE_CHECKING:
    from occontrol.families.athans.base import AthansProblem

NONE = "initial.covariance is none"


def wrong_without_prior(problem: AthansProblem, times: np.ndarray) -> list[Mistake]:
    """Plant noise, whatever counts from the start, and caps on what is infinite there.

    Parameters
    ----------
    problem : of the family
    times : (K,) at which varying noise is looked at
    """
    if problem.prior:
        return []
    found, plant = Collector(), problem.plant
    key, signal = ("Q", plant.Q) if problem.discrete else ("noise", plant.noise)  # type: ignore[union-attr]
    noisy = np.any(signal.sample(times)) if not signal.constant else np.any(signal.at(0.0))
    if noisy:
        hint = f"{key}: 0 for parameters that do not move, or an initial covariance"
        found.add(("plant", key), f"{NONE}: without a prior the plant has no noise", hint, True)
    if getattr(problem, "running", None) is not None:
        what = f"{NONE}: a running weight is infinite before the readings determine every state"
        found.add(("objective", "running"), what, "output alone, or an initial covariance", True)
    if problem.criterion is not None and problem.criterion.name == "peak":
        what = f"{NONE}: a peak is infinite before the readings determine every state"
        found.add(("objective", "criterion", "name"), what, "a criterion of the end, or an initial covariance")
    if problem.minimise == "observation" or (problem.rules is not None and problem.rules.max_error is not None):
        what = f"{NONE}: a cap on the error is searched with a prior only"
        found.add(("plant", "initial", "covariance"), what, "a large covariance, or max_observation_cost")
    return found.mistakes

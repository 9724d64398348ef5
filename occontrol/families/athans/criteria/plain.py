"""Criteria for the independent check: from singular values, sharing no code with the search's."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from occontrol.families.athans.criteria.statement import (
    LARGEST,
    LOG_TRACE,
    LOGDET,
    PEAK,
    SCHATTEN,
    CriterionChoice,
)

KNOWN = 1e-12  # of the largest correlation: a direction that is known exactly, as in scheduling/criteria.py


def is_peak(choice: CriterionChoice | None) -> bool:
    """Whether a `choice` is of variances along the way."""
    return choice is not None and choice.name == PEAK


def counts(choice: CriterionChoice | None, when: str, time: float) -> bool:
    """Whether a peak counts at a reading.

    Parameters
    ----------
    choice : of a peak
    when : "prior" or "posterior"
    time : of the reading
    """
    since = -np.inf if choice is None or choice.since is None else choice.since
    return choice is not None and choice.when == when and time >= since - 1e-9 * max(1.0, abs(time))


def plain_value(choice: CriterionChoice, covariance: np.ndarray, along: Sequence[float] = ()) -> float:
    """The value of a criterion.

    Parameters
    ----------
    choice : CriterionChoice
    covariance : (p, p) X at the end
    along : tr X at the times that count for a peak
    """
    if choice.name == PEAK:
        return float(max(along))
    X = np.asarray((covariance + covariance.T) / 2)
    if choice.name == LOGDET:
        return _log_volume(X)
    sizes = np.linalg.svd(X.astype(float), compute_uv=False)
    if choice.name == LARGEST:
        return float(sizes[0])
    if choice.name == SCHATTEN:
        top = float(sizes[0])
        return top * float(np.sum((sizes / top) ** choice.power)) ** (1 / choice.power) if top else 0.0
    trace = float(np.trace(X))
    return float(np.log(trace)) if choice.name == LOG_TRACE else trace


def _log_volume(X: np.ndarray) -> float:
    """ln det X by elimination in the precision of X; over the directions that vary where X is singular."""
    scale = np.sqrt(np.maximum(np.diagonal(X), 0))
    moving = scale > 0
    if not np.any(moving):
        return -np.inf
    inner = np.asarray(X[np.ix_(moving, moving)])
    rest = inner / np.outer(scale[moving], scale[moving])
    sizes = np.linalg.svd(rest.astype(float), compute_uv=False)
    if sizes[-1] <= KNOWN * sizes[0]:  # what is left of the volume, in the user's units
        rank = int(np.sum(sizes > KNOWN * sizes[0]))
        return float(np.sum(np.log(np.linalg.svd(inner.astype(float), compute_uv=False)[:rank])))
    total = 2 * float(np.sum(np.log(scale[moving])))
    for i in range(len(rest)):
        pivot = rest[i, i]
        total += float(np.log(pivot))
        rest[i + 1 :, i + 1 :] -= np.outer(rest[i + 1 :, i], rest[i, i + 1 :]) / pivot
    return total

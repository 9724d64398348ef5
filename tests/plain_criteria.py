"""Criteria of a covariance X for tests, from its eigenvalues: no code of the product."""

from __future__ import annotations

from typing import Any

import numpy as np

SINGULAR = 1e-12


def plain_criterion(criterion: dict[str, Any], X: np.ndarray, peaks: list[float]) -> float:
    """The value for X (p, p) at the end and tr X at the times that count for a peak."""
    name = criterion["name"]
    if name == "peak":
        return max(peaks)
    sizes = np.maximum(np.linalg.eigvalsh((X + X.T) / 2)[::-1], 0.0)
    if name == "logdet":
        deviations = np.sqrt(np.maximum(np.diagonal(X), 0.0))
        moving = deviations > 0
        scale = deviations[moving]
        inner = np.linalg.eigvalsh(X[np.ix_(moving, moving)] / np.outer(scale, scale))
        rank = int(np.sum(inner > SINGULAR * inner[-1]))
        if rank == len(inner):
            return float(np.sum(np.log(inner)) + 2 * np.sum(np.log(scale)))
        return float(np.sum(np.log(sizes[:rank])))
    values = {
        "trace": np.sum(sizes),
        "log-trace": np.log(np.sum(sizes)) if sizes[0] > 0 else -np.inf,
        "largest-eigenvalue": sizes[0],
        "schatten": np.sum(sizes ** criterion.get("p", 4)) ** (1 / criterion.get("p", 4)),
    }
    return float(values[name])


def counted(criterion: dict[str, Any], when: str, t: float) -> bool:
    """Whether tr X before ("prior") or after ("posterior") the reading at t counts for a peak."""
    return (
        criterion.get("name") == "peak"
        and criterion.get("at", "posterior") == when
        and t >= criterion.get("from", -np.inf) - 1e-9
    )

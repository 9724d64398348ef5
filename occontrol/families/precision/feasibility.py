"""Can the bound be met at all? Decided in closed form, before any solver starts.

The least posterior covariance is reached at the caps (infinite precision where there is none). In units of the bound
its largest eigenvalue is the smallest reachable factor: below 1 the bound can be met strictly, above 1 not at all. At
exactly 1 it is met only if the caps are finite, or in directions that no sensor sees and that meet it from the start.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occontrol.families.precision.normal_form import Factored

EXACT = 1e-12  # of the bound: two eigenvalues count as equal
AT_CAP = 1e-10  # of the bound: how far a posterior at the caps may lie above it
BLIND = 1e-10  # correlation (squared) below which a direction counts as not measured


@dataclass(frozen=True, eq=False)
class Feasibility:
    """The verdict.

    Parameters
    ----------
    feasible : bool
    factor : the smallest reachable multiple of the bound (no solution below it)
    direction : (n,) weights c of the combination c'x of states whose error prevents more; largest entry 1
    idle : whether no measurement at all meets the bound (then precision zero is optimal)
    least_active : at least this many sensors must be used
    keep : (n, k) basis, in units of the bound, of the states that still have to be looked at
    tight : whether the only way is at the caps themselves
    """

    feasible: bool
    factor: float
    direction: np.ndarray
    idle: bool
    least_active: int
    keep: np.ndarray
    tight: bool = False


def feasibility(split: Factored, caps: np.ndarray) -> Feasibility:
    """Decide whether caps (m,), infinite where there is none, allow Sigma+ <= bound; see the header.

    The largest eigenvalue of the pencil (Sigma+(caps), P^d), and n+(P - P^d) as a bound on the number of sensors.
    """
    with np.errstate(invalid="ignore"):
        scaled = np.where(split.deviation > 0, caps * split.deviation**2, 0.0)
    n = split.residual.shape[0]
    values, vectors = np.linalg.eigh(split.covariance(scaled))
    factor = float(values[-1])
    direction = np.linalg.solve(split.root.T, vectors[:, -1])
    direction = direction / direction[np.argmax(np.abs(direction))]
    prior = np.linalg.eigvalsh(split.residual + split.influence @ split.influence.T)
    idle = bool(prior[-1] <= 1.0 + EXACT)
    least = int(np.sum(prior > 1.0 + EXACT))
    tolerance = EXACT * max(1.0, float(prior[-1]))
    unlimited = bool(np.any(np.isinf(scaled)))
    edge = np.abs(values - 1.0) <= tolerance
    keep = np.eye(n)
    if np.any(edge) and factor <= 1.0 + tolerance:
        # facial reduction: blind directions that meet the bound from the start take no part
        near = vectors[:, edge]
        _, s, vt = np.linalg.svd(split.influence.T @ near)
        seen = int(np.sum(s**2 > BLIND))
        blind = near @ vt[seen:].T
        if blind.shape[1]:
            keep = np.linalg.svd(np.eye(n) - blind @ blind.T)[0][:, : n - blind.shape[1]]
        if seen and not np.any(np.isfinite(scaled) & (scaled > 0)):
            # only the limit of infinite precision would do
            return Feasibility(idle, factor, direction, idle, least, keep)
        return Feasibility(True, factor, direction, idle, least, keep, tight=seen > 0)
    if factor > 1.0 + (tolerance if unlimited else AT_CAP):
        return Feasibility(False, factor, direction, idle, least, keep)
    return Feasibility(True, factor, direction, idle, least, keep, tight=factor > 1.0 - AT_CAP and not unlimited)

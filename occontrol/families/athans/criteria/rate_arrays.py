"""What a run of continuous sensing without a prior holds: information, and covariance where there is one."""

from __future__ import annotations

import numpy as np

from occontrol.families.athans.criteria.design_arrays import DETERMINED
from occontrol.families.athans.criteria.rate_information import Watched
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.scheduling.information import InformationObjective
from occontrol.scheduling.relaxation import RelaxedOutcome


def rate_arrays(
    problem: SchedulingProblem,
    watched: Watched,
    objective: InformationObjective,
    on: np.ndarray,
    measuring: np.ndarray,
    relaxed: RelaxedOutcome | None,
) -> dict[str, np.ndarray]:
    """The arrays of a policy.

    Parameters
    ----------
    problem : without a prior, n states, N intervals
    watched : what its sensors tell
    objective : the true one
    on, measuring : (N, M) what is in use, and what of it measures
    relaxed : the best shares, or None

    `information` (N+1, n, n) is on the state at the start, zeros where that is known; `covariance` (N+1, n, n) at the
    edges is not a number until all states are determined.
    """
    n, unknown = problem.states, np.flatnonzero(problem.unknown)
    L = watched.seen.information[:, :, unknown[:, None], unknown]
    F = np.concatenate([np.zeros((1, len(unknown), len(unknown))), np.einsum("kj,kjab->kab", measuring, L)])
    F = np.cumsum(F, axis=0)
    information, covariance = np.zeros((len(F), n, n)), np.full((len(F), n, n), np.nan)
    information[:, unknown[:, None], unknown] = F
    for k, each in enumerate(F):
        scale = np.sqrt(np.maximum(np.diagonal(each), 0.0))
        if np.all(scale > 0):
            values, vectors = np.linalg.eigh(each / np.outer(scale, scale))
            if values[0] > DETERMINED * values[-1]:
                root = watched.across[k][:, unknown] @ (vectors / scale[:, None]) / np.sqrt(values)
                covariance[k] = root @ root.T
    _, gradient = objective.cost_and_gradient(measuring)
    arrays = {
        "times": problem.edges,
        "edges": problem.edges,
        "weights": on,
        "information": information,
        "covariance": covariance,
        "switching": gradient / problem.steps[:, None],
    }
    if on is not measuring:
        arrays["measuring"] = measuring
    if relaxed is not None:
        arrays["relaxed_weights"] = relaxed.weights
        _, slope = objective.cost_and_gradient(relaxed.weights)
        arrays["relaxed_switching"] = slope / problem.steps[:, None]
    return arrays

"""The certificate of a policy on its grid: its cost, and what its own gradient proves about every other one."""

from __future__ import annotations

import numpy as np

from occontrol.core.solution import Certificate
from occontrol.scheduling.feasible_set import FeasibleSet
from occontrol.scheduling.objective import Objective


def at_least_zero(bound: float, cost: float) -> float:
    """A lower bound raised to 0, which no cost lies below where q, R and W are not negative and no logarithm is taken.

    A cost below 0 shows that one of them is, slightly; then nothing is raised.

    Parameters
    ----------
    bound : proven lower bound
    cost : of a policy
    """
    return max(bound, 0.0) if cost >= 0 else bound


def policy_certificate(
    objective: Objective,
    feasible_set: FeasibleSet,
    weights: np.ndarray,
    known_bound: float = -np.inf,
    floor: float = -np.inf,
) -> Certificate:
    """Cost of a policy and the better of its own lower bound J - sum_k [v_k.g_k - min_w w.g_k] and one known already.

    Parameters
    ----------
    objective : Objective, such as a Sweep
    feasible_set : FeasibleSet that the bound holds for
    weights : (N, M) policy of the set
    known_bound : a proven lower bound of the same objective, if any
    floor : what no cost can lie below, `Sweep.floor`; 0 for traces, which a cost below 0 refutes, -inf for logarithms

    Returns a Certificate, which may say that it contradicts itself.
    """
    J, g = objective.cost_and_gradient(weights)
    own = feasible_set.bound(J, weights, g)
    own = max(own, known_bound)
    return Certificate(J, own if np.isneginf(floor) else at_least_zero(own, J))

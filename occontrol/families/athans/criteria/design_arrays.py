"""What a run without a prior holds beside its numbers: information, covariance where there is one, equivalence."""

from __future__ import annotations

import numpy as np

from occontrol.core.kinds import PlainDict
from occontrol.families.athans.readings.fill import Filled
from occontrol.families.athans.readings.problem import ReadingsProblem
from occontrol.scheduling.budget import BudgetSet
from occontrol.scheduling.feasible_set import IntervalPolytopes
from occontrol.scheduling.grouping import Grouping
from occontrol.scheduling.information import InformationObjective

USED = 1e-2  # a share that counts as used, and what a share may lack of its limit and count as full
DETERMINED = 1e-13  # of the largest eigenvalue of the correlations of the information


def arrays_of(
    problem: ReadingsProblem, filled: Filled, weights: np.ndarray, gradient: np.ndarray
) -> dict[str, np.ndarray]:
    """The arrays of a policy.

    Parameters
    ----------
    problem : without a prior, n states
    filled : the problem as a recursion
    weights : (E, M) of every decision
    gradient : (E, M)

    `information` (N, n, n) is on the state at the start, zeros where that is known; `covariance` (N, n, n) after a
    reading is not a number until all states are determined.
    """
    r, units = filled.recursion, filled.units.inverse
    n, K, unknown = r.states, len(r.steps), problem.unknown
    v, across = r.on_steps(weights), np.eye(n)[:, unknown]
    F = np.zeros((across.shape[1], across.shape[1]))
    information, covariance = np.zeros((K, n, n)), np.full((K, n, n), np.nan)
    for k in range(K):
        across = r.transition[r.predict[k]] @ across
        for j in range(r.sensors):
            a, b = r.offsets[j], r.offsets[j + 1]
            rows = r.rows[r.row_set[k]][a:b] @ across
            F = F + v[k, j] * r.steps[k] * rows.T @ rows
        information[k][np.ix_(unknown, unknown)] = F
        scale = np.sqrt(np.maximum(np.diagonal(F), 0.0))
        if np.all(scale > 0):
            values, vectors = np.linalg.eigh(F / np.outer(scale, scale))
            if values[0] > DETERMINED * values[-1]:
                root = across @ (vectors / scale[:, None]) / np.sqrt(values)
                covariance[k] = root @ root.T
    lengths = r.by_decision(np.ones(K))
    return {
        "times": problem.clock.times,
        "edges": problem.edges,
        "weights": v,
        "information": units.weight(information),
        "covariance": units.covariance(covariance),
        "switching": r.on_steps(gradient / lengths[:, None]),
    }


def equivalence_of(objective: InformationObjective, allowed: IntervalPolytopes, weights: np.ndarray) -> PlainDict:
    """The check of the General Equivalence Theorem: what a reading saves, of those that are used and of the others.

    At the optimum no reading that could be used more saves more than one that could be used less.

    Parameters
    ----------
    objective : the true one, or smoothed
    allowed : the set of the shares
    weights : (N, M) shares
    """
    _, g = objective.cost_and_gradient(weights)
    excess = float(np.sum(allowed.excess(weights, g)))
    if not isinstance(allowed, BudgetSet) or Grouping(allowed).number is None:
        return {"excess": excess}
    grouping = Grouping(allowed)
    saved = -grouping.rows(g - g[:, [allowed.idle]])
    shares, upper = grouping.rows(weights), grouping.rows(allowed.upper)
    used = np.min(np.where(shares > USED, saved, np.inf), axis=1)
    left = np.max(np.where((upper > 0) & (shares < upper - USED), saved, -np.inf), axis=1)
    row = int(np.argmax(left - used))
    return {"used_save_at_least": float(used[row]), "others_save_at_most": float(left[row]), "excess": excess}

"""Greedy choices by another criterion than the trace: what it comes to if nothing more is measured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from occontrol.scheduling.baselines import greedy, later_weights
from occontrol.scheduling.criterion_sweep import CriterionSweep
from occontrol.scheduling.feasible_set import FeasibleSet
from occontrol.scheduling.peak import PeakSweep
from occontrol.scheduling.recursion import Recursion


def greedy_by_criterion(objective: CriterionSweep | PeakSweep, feasible_set: FeasibleSet) -> np.ndarray:
    """On every interval the choice that would be best if no measurement followed it, for the objective's criterion.

    For a peak it is the choice with the least variance at the next time that counts; variances below a limit count as
    the limit, so that the cheapest of such choices is taken.

    Parameters
    ----------
    objective : on a recursion
    feasible_set : FeasibleSet of the policies

    Returns (N, M) integral policy.
    """
    later = _next_variance(objective) if isinstance(objective, PeakSweep) else _at_the_end(objective)
    return greedy(objective.recursion, feasible_set, later)


def _at_the_end(objective: CriterionSweep) -> Callable[[int, np.ndarray], float]:
    """The criterion at the end and the running weight on the way there, from S+ of step k."""
    r, n = objective.recursion, objective.states
    F, Q = np.empty((len(r.steps), n, n)), np.empty((len(r.steps), n, n))
    across, noise = np.eye(n), np.zeros((n, n))
    for k in range(len(r.steps) - 1, -1, -1):
        one = r.transition[r.predict[k + 1]]
        noise = noise + across @ r.noise[r.predict[k + 1]] @ across.T
        across = across @ one
        F[k], Q[k] = across, noise
    weight = _running_weights(r)

    def later(k: int, S: np.ndarray) -> float:
        final = F[k] @ S @ F[k].T + Q[k]
        return objective.criterion.value((final + final.T) / 2) + float(np.sum(weight[k] * S))

    return later


def _running_weights(r: Recursion) -> np.ndarray:
    return later_weights(replace(r, terminal=np.zeros_like(r.terminal)))


def _next_variance(objective: PeakSweep) -> Callable[[int, np.ndarray], float]:
    """The largest of the variances that S+ of step k decides at once; the nearest later ones where it decides none."""
    watched, weight = objective.watched, _running_weights(objective.recursion)
    known = np.unique(watched.step[watched.step >= 0])
    floor = -np.inf if objective.limit is None else objective.limit
    scale = max(objective.penalty, 1.0)

    def later(k: int, S: np.ndarray) -> float:
        rest = float(np.sum(weight[k] * S))
        if not len(known):
            return rest
        at = known[min(int(np.searchsorted(known, k)), len(known) - 1)]
        here = np.flatnonzero(watched.step == at)
        values = np.einsum("kij,ij->k", watched.weight[here], S) + watched.constant[here]
        return rest + scale * max(float(np.max(values)), floor)

    return later

"""What NIS and NEES the filters of this family have: exactly, and over many runs (see numerics/consistency.py)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from occontrol.core.schedule import Schedule
from occontrol.families.athans.filter.online import MODELS, Plan, make_plan
from occontrol.families.athans.filter.sampled_model import SampledModel, exact_model
from occontrol.families.athans.filter.simulate import draw
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.numerics.consistency import Consistency, nees
from occontrol.numerics.linalg import solve_lower, whitener


def expected_nees(problem: SchedulingProblem, schedule: Schedule, model: str = "split") -> np.ndarray:
    """The mean NEES per degree of freedom that a filter has against the continuous plant, without any simulation.

    1 for the exact model; 1 + O(h^2) for the split model. With e = x - xh, H, d of the plant, Hs, ds of the filter,

        e+ = (F - K Hs) e - K (H - Hs) x - K (d - ds) + w - K v

    so mean and covariance of (x, e) together obey a linear recursion.

    Parameters
    ----------
    problem : SchedulingProblem
    schedule : Schedule with N intervals
    model : of the filter, "split" or "exact"

    Returns (N+1,), one value per node.
    """
    truth, own = exact_model(problem, schedule), MODELS[model](problem, schedule)
    plan, n = make_plan(own), own.states
    joint = np.tile(own.covariance, (2, 2))
    mean, bias = own.mean, np.zeros(n)
    result = np.ones(own.intervals + 1)
    for k in range(own.intervals):
        F, K, S = truth.transition[k], plan.gain[k], truth.cross[k]
        wrong = K @ (truth.observe[k] - own.observe[k])
        closed = own.transition[k] - K @ own.observe[k]
        step = np.block([[F, np.zeros((n, n))], [F - own.transition[k] - wrong, closed]])
        Q = truth.noise[k]
        mixed = Q - S @ K.T
        last = mixed - K @ S.T + K @ truth.reading_noise[k] @ K.T
        joint = step @ joint @ step.T + np.block([[Q, mixed], [mixed.T, last]])
        bias = closed @ bias - wrong @ mean - K @ (truth.offset[k] - own.offset[k])
        mean = F @ mean + truth.input[k]
        white = whitener(plan.covariance[k + 1])
        moment = joint[n:, n:] + np.outer(bias, bias)
        result[k + 1] = np.sum((moment @ white) * white) / max(1, white.shape[1])
    return result


def monte_carlo(
    problem: SchedulingProblem,
    schedule: Schedule,
    seeds: Sequence[int],
    model: str = "split",
    truth: SampledModel | None = None,
    plan: Plan | None = None,
) -> Consistency:
    """Simulate and filter many runs at once.

    Parameters
    ----------
    problem : SchedulingProblem
    schedule : Schedule to follow
    seeds : one per run
    model : of the filter, "split" or "exact"
    truth : SampledModel to draw from; the continuous plant (exact) if left out
    plan : gains and covariances that the filter uses; computed if left out
    """
    truth = truth or exact_model(problem, schedule)
    states, readings = draw(truth, seeds)
    own = truth if model == "exact" and truth.edges is schedule.edges else MODELS[model](problem, schedule)
    plan = plan or make_plan(own)
    mean = np.empty_like(states)
    mean[:, 0] = own.mean
    nis = np.full((len(states), own.intervals), np.nan)
    for k in range(own.intervals):
        x = mean[:, k]
        error = readings[k] - x @ own.observe[k].T - own.offset[k]
        mean[:, k + 1] = x @ own.transition[k].T + own.input[k] + error @ plan.gain[k].T
        if error.shape[1]:
            nis[:, k] = np.sum(solve_lower(plan.innovation_root[k], error.T) ** 2, axis=0)
    value, degrees = nees(states, mean, plan.covariance)
    return Consistency(own.edges, nis, own.dimension, value, degrees)

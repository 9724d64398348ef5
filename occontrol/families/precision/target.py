"""The first batch of measurements as one step of a filter, for code on a target: its gain does not depend on data.

The forecast stands still (F = 0, g = its mean), and cov [w; v] is the joint moment [P G; G' Y + S^-1] of state and
measurements that are used; the filter's own recursion then gives the gain G (Y + S^-1)^-1 and the covariance (11), also
where measurements are missing.
"""

from __future__ import annotations

import numpy as np

from occontrol.core.errors import SolveFailed, UsageError
from occontrol.core.solution import Solution
from occontrol.core.target import TargetModel, TargetPlan
from occontrol.families.precision.problem import Problem
from occontrol.numerics.linalg import square_root


def target_plan(problem: Problem, solution: Solution) -> TargetPlan:
    """One interval, at whose end every measurement of the batch arrives; each is a sensor of its own.

    Parameters
    ----------
    problem : Problem
    solution : with the precisions

    Raises UsageError for several batches, SolveFailed without precisions.
    """
    plan = solution.arrays.get("precisions")
    if plan is None:
        raise SolveFailed("the run has no precisions")
    if problem.batches > 1:
        what = "the gains of several batches follow from the estimates between them, which nobody has beforehand"
        raise UsageError(f"{what}\n  hint: a problem with one batch")
    precisions = np.asarray(plan, dtype=float).reshape(-1)
    used = np.flatnonzero(precisions > 0)
    moments, n = problem.first_moments(), problem.first_moments().states
    mean, seen, end = np.zeros(n), np.zeros(len(precisions)), 1.0
    if problem.moments is None:
        plant, measurement, options = problem.dynamics("forecast")
        forecast = options.start(plant, measurement).forecast(problem.batch)
        moments, mean, seen, end = forecast.moments, forecast.mean, forecast.measurement_mean, float(forecast.times[-1])
    kept, m = moments.only(used), len(used)
    joint = kept.anomalies
    if joint is None:
        joint = square_root(np.block([[kept.state, kept.cross], [kept.cross.T, kept.measurement]]), floor=0.0)
    noise = np.vstack([np.zeros((n, m)), np.diag(1 / np.sqrt(precisions[used]))])
    labels = tuple(problem.labels())
    return TargetPlan(
        edges=np.array([0.0, end]),
        names=labels,
        rows=(1,) * len(labels),
        active=[tuple(used.tolist())],
        instants=True,
        model=TargetModel(
            transition=np.zeros((1, n, n)),
            input=mean[None],
            observe=[np.zeros((m, n))],
            offset=[seen[used]],
            noise_root=[np.hstack([joint, noise])],
            mean=mean,
            covariance=moments.state,
            predict_matrix=np.zeros((2, 0, n)),
            predict_offset=np.zeros((2, 0)),
            predict_noise=np.zeros((2, 0, 0)),
        ),
    )

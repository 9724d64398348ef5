"""Which sampled filter belongs to a schedule, and its gains as arrays.

With one step of integration an interval the split filter has the schedule's covariance; with several the exact model of
the sampled plant is the matched filter, because a sample stays the average over one interval.
"""

from __future__ import annotations

import numpy as np

from occontrol.core.kinds import PlainMapping
from occontrol.core.schedule import Schedule
from occontrol.families.athans.filter.gains import MAX_BYTES
from occontrol.families.athans.problem import SchedulingProblem


def default_model(result: PlainMapping) -> str:
    """The filter that a result belongs to: "split", or "exact" where an interval has several steps of integration.

    Parameters
    ----------
    result : of a solution; one that does not say has one step an interval
    """
    steps, intervals = result.get("integration_steps"), result.get("intervals")
    if isinstance(steps, int) and isinstance(intervals, int) and steps > intervals:
        return "exact"
    return "split"


def planned_gains(problem: SchedulingProblem, schedule: Schedule) -> dict[str, np.ndarray]:
    """Gains and covariances of the exact sampled filter while every sample arrives.

    Parameters
    ----------
    problem : SchedulingProblem with n states
    schedule : Schedule with N intervals

    Returns {"gain": (N, n, m), "filter_covariance": (N+1, n, n)}, m the largest number of values of an interval, padded
    with zeros; gains lead from node to node. Empty when they would take more than MAX_BYTES.
    """
    from occontrol.families.athans.filter.online import make_plan
    from occontrol.families.athans.filter.sampled_model import exact_model

    model = exact_model(problem, schedule, driven=False)
    m, N, n = int(np.max(model.dimension, initial=0)), model.intervals, model.states
    if 8 * N * n * (m + n) > MAX_BYTES:
        return {}
    plan = make_plan(model)
    gain = np.zeros((N, n, m))
    for k, K in enumerate(plan.gain):
        gain[k, :, : K.shape[1]] = K
    return {"gain": gain, "filter_covariance": np.asarray(plan.covariance)}

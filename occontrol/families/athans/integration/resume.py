"""Where a resumed solve begins its relaxation: at the relaxed policy of an earlier solution."""

from __future__ import annotations

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.families.athans.problem import SchedulingProblem

ROUNDING = 1e-9  # by so much a weight may lie outside its bounds
FILLED = 1e-6  # by so much the weights of an interval may miss `select`


def earlier_policy(problem: SchedulingProblem, monitor: Monitor) -> np.ndarray | None:
    """(N, M) the relaxed policy of the earlier solution that the monitor brings, or None to begin anew.

    Where the earlier solve had added edges, an interval gets the mean over its parts. A policy that is none of this
    problem is left alone.

    Parameters
    ----------
    problem : SchedulingProblem with N intervals and M sensors
    monitor : Monitor, whose `resumed` is set when there is a policy
    """
    earlier = monitor.resume
    if earlier is None or earlier.schedule is None:
        return None
    weights = np.asarray(earlier.arrays.get("relaxed_weights", earlier.schedule.weights))
    edges = earlier.schedule.edges
    if weights.shape != (len(edges) - 1, problem.upper.shape[1]) or not np.all(np.isfinite(weights)):
        return None
    if edges[0] != problem.edges[0] or edges[-1] != problem.edges[-1] or not np.all(np.isin(problem.edges, edges)):
        return None
    if len(edges) > len(problem.edges):
        starts = np.searchsorted(edges, problem.edges[:-1])
        parts = np.diff(edges)[:, None]
        weights = np.add.reduceat(weights * parts, starts, axis=0) / np.add.reduceat(parts, starts, axis=0)
    inside = np.all((weights >= 0) & (weights <= problem.upper + ROUNDING))
    if not inside or not np.allclose(weights.sum(axis=1), problem.select, atol=FILLED):
        return None
    monitor.resumed = True
    return np.minimum(np.array(weights, dtype=float), problem.upper)

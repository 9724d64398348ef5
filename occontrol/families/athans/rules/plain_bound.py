"""The bound without rules, in terms of what is minimised under them."""

from __future__ import annotations

import numpy as np

from occontrol.scheduling.relaxation import RelaxedOutcome
from occontrol.scheduling.rules.hull import Hull
from occontrol.scheduling.rules.task import Task


def slewing_bound(bound: float, task: Task, upper: np.ndarray) -> float:
    """While slewing nothing is paid: a bound over schedules that always use a sensor loses what that may save.

    Parameters
    ----------
    bound : over schedules without slews, in units of the cost
    task : with the prices
    upper : (N, M) positive where a sensor may be used
    """
    if not task.rules.slews():
        return bound
    least = np.min(np.where(upper > 0, task.price[:, : upper.shape[1]], np.inf), axis=1)
    return bound - float(np.sum(np.maximum(least, 0.0)))


def plain_bound(task: Task, upper: np.ndarray, relaxed: RelaxedOutcome | None, root: Hull, proven: float) -> float:
    """The bound of the relaxation without rules.

    Parameters
    ----------
    task : what is minimised
    upper : (N, M) positive where a sensor may be used
    relaxed : that relaxation, or None
    root : the hull of the first node
    proven : the bound with the rules
    """
    goal = task.goal
    if relaxed is None:
        return proven
    if goal.error > 0:
        return slewing_bound(relaxed.lower_bound, task, upper)
    # observation: cost + nu (E - limit) with the multiplier of the first node
    v, multipliers, _ = root.proof
    J, g = task.sweep.cost_and_gradient(v)
    linear, nu = float(np.vdot(task.price, v)), multipliers.error
    slope = task.price + nu * (g - task.price)
    constant = linear - float(np.vdot(slope, v))
    constant += nu * (J - linear - task.rules.max_error) if nu > 0 else 0.0
    least = np.min((slope @ task.oracle.automaton.columns.T) + np.where(task.oracle.open, 0.0, np.inf), axis=1)
    return min(max(constant + float(np.sum(least)), 0.0), proven)

"""All schedules of a small problem: then the best one is known, and its cost is the bound."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.families.athans.found import Found
from occontrol.scheduling.budget import BudgetSet
from occontrol.scheduling.criterion_sweep import SmoothableObjective
from occontrol.scheduling.enumeration import SURE, schedule_count
from occontrol.scheduling.enumeration import schedules as of_budget
from occontrol.scheduling.feasible_set import IntervalPolytopes
from occontrol.scheduling.first_choices import choices

MOST = 30_000
OVERHEAD = 30_000.0  # operations that one call takes beside its arithmetic


def schedules_of(allowed: IntervalPolytopes, most: int) -> Iterator[np.ndarray] | None:
    """Every schedule (N, M) of a set; None where there are more than `most`.

    Parameters
    ----------
    allowed : IntervalPolytopes, perhaps with a budget
    most : schedules
    """
    if isinstance(allowed, BudgetSet):
        return of_budget(allowed) if schedule_count(allowed) <= most else None
    ways, count = [], 1
    for upper in allowed.upper:
        here = choices(upper, allowed.places)
        count *= 0 if here is None else len(here)
        if here is None or count > most:
            return None
        ways.append(here)
    return (np.array(word) for word in product(*ways))


def every_schedule(
    objective: SmoothableObjective,
    allowed: IntervalPolytopes,
    found: Found,
    work: float,
    monitor: Monitor,
    wanted: bool,
) -> bool:
    """Whether all schedules were tried; `found` has then the best of them and a bound that is its cost.

    Parameters
    ----------
    objective : the true one
    allowed : IntervalPolytopes, perhaps with a budget
    found : to be filled in
    work : operations that trying all of them may take
    monitor : Monitor
    wanted : whether a bound beyond the relaxation's is wanted
    """
    r = objective.recursion
    each = len(r.steps) * (4.0 * r.states**3 + 4.0 * r.rows.shape[1] * r.states**2 + 200.0) + OVERHEAD
    ways = schedules_of(allowed, min(MOST, int(work / each))) if wanted else None
    if ways is None or monitor.stop:
        return False
    best, best_cost, count = None, np.inf, 0
    for way in ways:
        if monitor.stop:
            return False
        cost, count = objective.cost(way), count + 1
        if cost < best_cost:
            best, best_cost = way, cost
    if best is None:
        return False
    found.weights = best
    found.bound = best_cost - SURE * (max(1.0, abs(best_cost)) if objective.signed else abs(best_cost))
    found.extra |= {"schedules": count, "proven_optimal": True}
    return True

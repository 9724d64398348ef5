"""All schedules of a budget, where they are few: then the best one is known, and so is the bound."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, combinations, product
from math import comb

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.scheduling.budget import TOTAL, BudgetSet
from occontrol.scheduling.objective import Objective

SURE = 1e-9  # of the cost: what rounding may do to the least of many costs


def schedule_count(allowed: BudgetSet) -> int:
    """How many schedules there are at most: limits at single instants are not looked at.

    Parameters
    ----------
    allowed : BudgetSet
    """
    open_ = [int(np.sum(allowed.upper[:, j] > 0.5)) for j in allowed.real]
    if TOTAL in allowed.budget:
        return comb(sum(open_), int(allowed.budget[TOTAL]))
    count = 1
    for j, places in zip(allowed.real, open_, strict=True):
        b = allowed.budget.get(allowed.names[j])
        count *= 2**places if b is None else comb(places, int(b))
    return count


def schedules(allowed: BudgetSet) -> Iterator[np.ndarray]:
    """Every schedule (N, M) of the set.

    Parameters
    ----------
    allowed : BudgetSet
    """
    entries = {int(j): [(int(k), int(j)) for k in np.flatnonzero(allowed.upper[:, j] > 0.5)] for j in allowed.real}
    ways: Iterator
    if TOTAL in allowed.budget:
        every = [entry for j in entries for entry in entries[j]]
        ways = combinations(every, int(allowed.budget[TOTAL]))
    else:
        single = []
        for j, mine in entries.items():
            b = allowed.budget.get(allowed.names[j])
            counts = range(len(mine) + 1) if b is None else [int(b)]
            single.append([c for count in counts for c in combinations(mine, count)])
        ways = (tuple(chain.from_iterable(choice)) for choice in product(*single))
    for way in ways:
        w = np.zeros(allowed.shape)
        for entry in way:
            w[entry] = 1.0
        left = allowed.select - np.sum(w, axis=1)
        if np.all(left >= 0):
            w[:, allowed.idle] = left
            yield w


def cheapest(objective: Objective, allowed: BudgetSet, monitor: Monitor) -> tuple[np.ndarray, float, float] | None:
    """The best schedule (N, M) of all, its J, and the bound that follows; None where interrupted, or none exists.

    Parameters
    ----------
    objective : J
    allowed : BudgetSet
    monitor : Monitor
    """
    best: tuple[float, np.ndarray] | None = None
    for w in schedules(allowed):
        if monitor.stop:
            return None
        cost = objective.cost(w)
        if best is None or cost < best[0]:
            best = (cost, w)
    return None if best is None else (best[1], best[0], best[0] - SURE * abs(best[0]))

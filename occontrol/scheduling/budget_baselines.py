"""The simple policies that keep exact numbers of readings: greedy, in turn, at random."""

from __future__ import annotations

import numpy as np

from occontrol.scheduling.budget import TOTAL, BudgetSet
from occontrol.scheduling.objective import Objective


def greedy_with_budget(objective: Objective, allowed: BudgetSet, weighed: int) -> np.ndarray:
    """Reading after reading the one that saves most on top of those chosen, until the numbers are reached.

    The most promising by the gradient are weighed on the true cost. A sensor without a number gets readings while they
    save something. Where rests do not fit together, the nearest schedule that keeps the numbers is taken.

    Parameters
    ----------
    objective : Objective of the policies
    allowed : BudgetSet
    weighed : readings whose true cost is computed for each that is chosen

    Returns (N, M) integral policy.
    """
    idle, free, numbers = allowed.idle, allowed.free, dict(allowed.budget)
    v = np.zeros(allowed.shape)
    v[:, idle] = allowed.select
    cost = objective.cost(v)
    while True:
        needed = np.array([_left(allowed, numbers, v, j) > 0 for j in range(allowed.shape[1])])
        needed[idle] = False
        open_ = (v < allowed.upper) & (v[:, [idle]] > 0.5) & (needed | free)
        if not np.any(open_):
            break
        _, g = objective.cost_and_gradient(v)
        promise = np.where(open_, g - g[:, [idle]], np.inf)
        trials = []
        for flat in np.argsort(promise, axis=None, kind="stable")[:weighed]:
            k, j = divmod(int(flat), allowed.shape[1])
            if not open_[k, j]:
                break
            w = v.copy()
            w[k, j] += 1.0
            w[k, idle] -= 1.0
            value = objective.cost(w)
            if needed[j] or value < cost:
                trials.append((value, len(trials), w))
        if not trials:
            break
        cost, _, v = min(trials)
    return v if allowed.contains(v) else allowed.vertex(-_without_idle(allowed, v))


def in_turn_with_budget(allowed: BudgetSet) -> np.ndarray:
    """The sensors in turn at instants that are spread evenly; with numbers for single sensors, each spread by itself.

    Parameters
    ----------
    allowed : BudgetSet; sensors without a number are not read

    Returns (N, M) integral policy.
    """
    N, wanted = len(allowed.upper), np.zeros(allowed.shape)
    real = [int(j) for j in allowed.real]
    if TOTAL in allowed.budget:
        b, turn = int(allowed.budget[TOTAL]), 0
        for i in range(b):
            k = i * N // b
            ways = [real[(turn + s) % len(real)] for s in range(len(real))]
            ways = [j for j in ways if allowed.upper[k, j] > 0.5 and wanted[k, j] == 0]
            if ways and np.sum(wanted[k]) < allowed.select:
                wanted[k, ways[0]] = 1.0
                turn = real.index(ways[0]) + 1
    else:
        for j in real:
            b = int(allowed.budget.get(allowed.names[j], 0))
            at = np.flatnonzero(allowed.upper[:, j] > 0.5)
            if b:
                wanted[at[(np.arange(b) * 2 + 1) * len(at) // (2 * b)], j] = 1.0
        wanted[:, allowed.free] = -1.0
    return allowed.vertex(-wanted)


def _left(allowed: BudgetSet, numbers: dict, v: np.ndarray, j: int) -> int:
    """How many readings of sensor j the numbers still ask for."""
    if TOTAL in numbers:
        return int(numbers[TOTAL]) - round(float(np.sum(v[:, allowed.real])))
    name = allowed.names[j]
    return int(numbers[name]) - round(float(np.sum(v[:, j]))) if name in numbers else 0


def _without_idle(allowed: BudgetSet, v: np.ndarray) -> np.ndarray:
    w = v.copy()
    w[:, allowed.idle] = 0.0
    w[:, allowed.free] -= 0.5  # free sensors only where they were chosen
    return w

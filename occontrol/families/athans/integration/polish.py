"""Schedules polished for the cost on finer steps: with prices corrected for the schedule itself, then by J alone."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.families.athans.integration.priced import Judged
from occontrol.scheduling.feasible_set import FeasibleSet
from occontrol.scheduling.hminimal import SweepOutcome, h_minimal, polish

MOST_REPRICINGS = 4  # times that the prices are corrected for a schedule
MOST_SWEEPS = 30  # of J itself where corrected prices cost the schedule wrongly


@dataclass(frozen=True)
class Repolish:
    """When corrected prices are good enough, and how long to polish.

    Parameters
    ----------
    relative_gap : share of J by which they may cost a schedule wrongly
    rounds : of every polish
    """

    relative_gap: float
    rounds: int


def polish_for(
    judge: Judged,
    allowed: FeasibleSet,
    others: list[np.ndarray],
    best: SweepOutcome,
    offset: float,
    options: Repolish,
    monitor: Monitor,
) -> SweepOutcome:
    """The schedule with the least J that polishing comes to, from one that was polished with other prices.

    Parameters
    ----------
    judge : J
    allowed : set of the schedules
    others : further schedules (N, M)
    best : the schedule so far, with its cost by the prices of the relaxation
    offset : what J exceeds those costs by, at the relaxed policy
    options : Repolish
    monitor : Monitor

    Returns SweepOutcome with the costs of J.
    """
    cost = judge.cost(best.weights)
    if abs(best.cost + offset - cost) <= options.relative_gap * abs(cost):
        return replace(best, cost=cost)
    for weights in others:
        value = judge.cost(weights)
        if value < cost:
            best, cost = replace(best, weights=weights), value
    for _ in range(MOST_REPRICINGS):
        if monitor.stop:
            return replace(best, cost=cost)
        sweep = judge.repriced(best.weights)
        found = polish(sweep, allowed, best.weights, options.rounds, monitor)
        value = judge.cost(found.weights)
        if not value < cost:
            break
        best, cost = replace(found, iterations=best.iterations + found.iterations), value
    direct = h_minimal(judge, allowed, best.weights, MOST_SWEEPS, monitor=monitor.child(silent=True))
    if direct.cost < cost:
        best, cost = replace(best, weights=direct.weights), direct.cost
    return replace(best, cost=cost)

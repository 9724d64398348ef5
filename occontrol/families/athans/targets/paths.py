"""What happens to every target along a schedule: its charged covariance, and how long ago it was looked at."""

from __future__ import annotations

import numpy as np

from occontrol.core.look_schedule import LookSchedule
from occontrol.families.athans.targets.certify import weights_of
from occontrol.families.athans.targets.fill import fill
from occontrol.families.athans.targets.problem import TargetsProblem
from occontrol.scheduling.blocks.walk import Walk


def charged(problem: TargetsProblem, schedule: LookSchedule) -> np.ndarray:
    """(N, targets) w tr(R Sigma) after the looks of every interval; with W where a target has no running weight.

    Parameters
    ----------
    problem : TargetsProblem
    schedule : LookSchedule
    """
    filled = fill(problem)
    weights = weights_of(filled, schedule)
    walk = Walk(filled.groups, filled.allowed, filled.looks.price, filled.steps, filled.charges)
    found = np.zeros((problem.intervals, problem.targets))
    for owner, path in zip(filled.owners, walk.charged(weights), strict=True):
        for k in range(problem.intervals):
            np.add.at(found[k], owner, path[k])
    return found


def ages(problem: TargetsProblem, schedule: LookSchedule) -> np.ndarray:
    """(N, targets) time since the last look, or since the start, at the end of every interval."""
    last = np.zeros(problem.targets)
    found = np.empty((problem.intervals, problem.targets))
    ends = np.searchsorted(schedule.interval, np.arange(problem.intervals + 1))
    for k in range(problem.intervals):
        seen = schedule.target[ends[k] : ends[k + 1]]
        last[seen] = problem.elapsed[k + 1]
        found[k] = problem.elapsed[k + 1] - last
    return found

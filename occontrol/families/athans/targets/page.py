"""The panels of the page of many targets: ages, deviations and prices; who is looked at when, for a few targets."""

from __future__ import annotations

import numpy as np

from occontrol.core.look_schedule import LookSchedule
from occontrol.core.solution import Solution
from occontrol.families.athans.targets.paths import ages, charged
from occontrol.families.athans.targets.problem import TargetsProblem
from occontrol.families.athans.targets.text import priced_by
from occontrol.files.page.content import Bars, Curves, Group, Panel
from occontrol.files.page.usual import MOST_TARGETS, TIME, curves_or_map

SHARES = (5, 50, 95)


def target_groups(problem: TargetsProblem, solution: Solution) -> list[Group]:
    """The panels of a schedule of looks.

    Parameters
    ----------
    problem : TargetsProblem
    solution : Solution with a schedule
    """
    schedule, edges = solution.schedule, problem.edges
    if not isinstance(schedule, LookSchedule):
        return []
    panels: list[Panel] = []
    if problem.targets <= MOST_TARGETS:
        title = "who is looked at when"
        panels.append(Bars(title=title, edges=edges, weights=schedule.by_target, names=problem.target_names))
    names = [f"{share} % of the targets are below" for share in SHARES]
    for title, label, values in (
        ("time since the last look", "time", ages(problem, schedule)),
        ("weighted deviation, sqrt(w tr(R Σ))", "deviation", np.sqrt(np.maximum(charged(problem, schedule), 0.0))),
    ):
        shares = np.percentile(values, SHARES, axis=1).T
        panels.append(Curves(title=title, label=label, times=edges, values=shares, names=names))
    title = f"price: what one more look would save, by {priced_by(solution)}"
    panels.append(curves_or_map(title, "cost", edges, solution.arrays["prices"], problem.resource_names))
    return [Group(axis=TIME, panels=panels)]

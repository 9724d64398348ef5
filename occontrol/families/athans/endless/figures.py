"""Pictures of a joint cycle: who is looked at when, and what each target costs beside what it costs at least."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from occontrol.core.look_schedule import LookSchedule
from occontrol.core.printed import rounded_down
from occontrol.core.solution import Solution
from occontrol.families.athans.endless.problem import EndlessTargetsProblem
from occontrol.families.athans.targets.figures import timeline
from occontrol.files.figures import style
from occontrol.files.page.content import Bars, Group
from occontrol.files.page.usual import MOST_TARGETS, TIME

NAMED = 40


def draw(problem: EndlessTargetsProblem, solution: Solution) -> dict[str, Figure]:
    """overview: all panels; looks: the cycle alone.

    Parameters
    ----------
    problem : EndlessTargetsProblem
    solution : Solution
    """
    schedule = solution.schedule
    if not isinstance(schedule, LookSchedule):
        return {}
    r, bounds = solution.numbers, solution.result.get("bounds") or {}
    text = f"cost {r.cost:.6g} a unit of time, no schedule of whole looks below {rounded_down(r.lower_bound, 6)}"
    if bounds.get("averaged") is not None:
        text += f", of any looks below {rounded_down(bounds['averaged'], 6)}"
    with style.house_style():
        overview = style.new_figure((13.33, 9.0), problem.name, text)
        grid = overview.add_gridspec(2, 1, height_ratios=[1.4, 1])
        timeline(overview.add_subplot(grid[0]), problem, schedule)
        _costs(overview.add_subplot(grid[1]), problem, solution)
        looks = style.new_figure((13.33, 7.0), problem.name, text)
        timeline(looks.subplots(), problem, schedule)
    return {"overview": overview, "looks": looks}


def groups(problem: EndlessTargetsProblem, solution: Solution) -> list[Group]:
    """The panel of the page: who is looked at when.

    Parameters
    ----------
    problem : EndlessTargetsProblem
    solution : Solution
    """
    schedule = solution.schedule
    if not isinstance(schedule, LookSchedule) or problem.targets > MOST_TARGETS:
        return []
    names = problem.target_names
    bars = Bars(title="who is looked at when", edges=schedule.edges, weights=schedule.by_target, names=names)
    return [Group(axis=TIME, panels=[bars])]


def _costs(axes: Axes, problem: EndlessTargetsProblem, solution: Solution) -> None:
    """Cost of every target, its looks paid at the prices, beside the least at these prices."""
    schedule, arrays = solution.schedule, solution.arrays
    assert isinstance(schedule, LookSchedule)
    P, prices = len(schedule.edges) - 1, arrays["prices"][0]
    paid = np.bincount(schedule.target, weights=prices[schedule.resource], minlength=problem.targets) / P
    costs, least = arrays["per_target_cost"], arrays["per_target_bound"]
    x = np.arange(problem.targets)
    axes.bar(x, costs, width=0.7, color=style.ACCENT, alpha=0.85, label="cost")
    axes.bar(x, paid, width=0.7, bottom=costs, color=style.GREY, alpha=0.5, label="its looks at the price")
    axes.scatter(x, least, marker="_", s=220 if problem.targets <= NAMED else 20, color=style.SECOND, lw=2, zorder=3,
                 label="both at least")  # fmt: skip
    axes.set_title("what each target costs a unit of time, and the least at these prices")
    if problem.targets <= NAMED:
        small = 9 if problem.targets <= 20 else 6
        axes.set_xticks(
            x, style.labels(problem.target_names), fontsize=small, rotation=0 if problem.targets <= 12 else 90
        )
    else:
        axes.set_xlabel("target")
    axes.set_ylim(0, 1.3 * float(np.max(costs + paid)) or None)
    axes.legend(ncols=3, fontsize=9, frameon=False, loc="upper right")

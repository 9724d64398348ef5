"""Pictures of the least error over caps on the observation cost: the front, the price of the cap, the schedules."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from occontrol.families.athans.budgets import BudgetFront
from occontrol.files.figures import style


def draw_budgets(front: BudgetFront) -> dict[str, Figure]:
    """Every figure of one front over caps.

    Parameters
    ----------
    front : BudgetFront

    Returns front and schedules.
    """
    with style.house_style():
        return {"front": _front(front), "schedules": _schedules(front)}


def _front(front: BudgetFront) -> Figure:
    budgets, errors, bounds = front.budgets, front.errors, front.lower_bound
    count = style.count_of(len(budgets), "budget")
    figure = style.new_figure((13.33, 6.8), front.problem.name, f"{count}; no schedule lies in the shaded region")
    left, middle, right = figure.subplots(1, 3, width_ratios=[2, 1, 1])
    # a bound for one cap holds up to it, so the region is made of steps
    first = float(budgets[0]) - 0.05 * float(np.ptp(budgets) or 1.0)
    left.fill_between([max(first, 0.0), *budgets], [bounds[0], *bounds], step="pre", color=style.PALE, lw=0)
    left.step([max(first, 0.0), *budgets], [bounds[0], *bounds], where="pre", color=style.SECOND, label="lower bound")
    left.plot(budgets, errors, "o", color=style.ACCENT, ms=6, label="schedules")
    if np.min(errors) > 0 and np.max(errors) > 30 * np.min(errors):
        left.set_yscale("log")
    else:
        left.set_ylim(bottom=0)
    running = " + running cost" if getattr(front.problem, "running", None) is not None else ""
    left.set_xlabel("cap on the observation cost")
    left.set_ylabel(f"prediction error{running}")
    left.legend(loc="upper right")
    left.grid()
    _bars(middle, budgets, front.prices, "price: error saved by one more unit")
    _bars(right, budgets, 100 * np.maximum((errors - bounds) / np.abs(errors), 0), "proven gap of the schedule, %")
    return figure


def _bars(axes: Axes, budgets: np.ndarray, values: np.ndarray, label: str) -> None:
    """A bar for every cap."""
    places = np.arange(len(budgets))
    axes.bar(places, values, color=style.ACCENT, width=0.7)
    axes.set_axisbelow(True)
    shown = places[:: max(1, -(-len(places) // 6))]
    axes.set_xticks(shown, [f"{budgets[i]:.4g}" for i in shown], fontsize=9)
    axes.set_xlabel("cap")
    axes.set_ylabel(label)
    axes.grid(axis="y")


def _schedules(front: BudgetFront) -> Figure:
    """One row for every cap: who measures when."""
    count, names = len(front.budgets), front.problem.sensors.names
    figure = style.new_figure((13.33, min(10.0, 2.4 + 0.34 * count)), front.problem.name, "schedules within the caps")
    axes = figure.subplots()
    colours = style.sensor_colours(names)
    used = set()
    for row, solution in enumerate(front.solutions):
        schedule = solution.schedule
        if schedule is None:
            continue
        edges = schedule.edges
        base = np.full(len(schedule.weights), row - 0.4)
        for j, colour in enumerate(colours):
            top = base + 0.8 / front.problem.places * schedule.weights[:, j]
            if np.any(schedule.weights[:, j] > 0):
                used.add(j)
                low, high = np.append(base, base[-1]), np.append(top, top[-1])
                axes.fill_between(edges, low, high, step="post", color=colour, lw=0, alpha=0.95)
            base = top
    axes.set_yticks(range(count), [f"{budget:.3g}" for budget in front.budgets], fontsize=9)
    axes.set_ylabel("cap on the observation cost")
    axes.set_ylim(-0.6, count - 0.4)
    axes.tick_params(axis="y", length=0)
    style.tidy_time_axis(axes, float(front.problem.edges[0]), float(front.problem.edges[-1]))
    if front.problem.discrete:
        axes.set_xlabel("step k")
    if len(set(colours)) > 2 or len(names) <= 3:
        handles = [Patch(color=colours[j], label=style.shorten(names[j])) for j in sorted(used)]
        axes.legend(handles=handles, loc="upper left", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.3)
    return figure

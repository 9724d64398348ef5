"""Pictures of schedules of many targets: who is looked at when, ages and deviations, the dearest targets, prices."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure

from occontrol.core.look_schedule import LookSchedule
from occontrol.core.printed import rounded_down
from occontrol.core.solution import Solution
from occontrol.families.athans.targets.paths import ages, charged
from occontrol.families.athans.targets.problem import TargetsProblem
from occontrol.families.athans.targets.text import priced_by
from occontrol.files.figures import style

NAMED = 40  # targets up to which every row has its name
FINE = 400  # rows that a timeline shows as they are
WORST = 10
SPREAD = 1e3  # largest price by the median of those that are not zero, beyond which the axis is logarithmic
SHARES = (5, 50, 95)


def draw(problem: TargetsProblem, solution: Solution) -> dict[str, Figure]:
    """overview: all panels; looks: the timeline alone.

    Parameters
    ----------
    problem : TargetsProblem
    solution : Solution
    """
    schedule = solution.schedule
    if not isinstance(schedule, LookSchedule):
        return {}
    with style.house_style():
        top = solution.numbers.top
        apart = f"gap {100 * top.relative_gap:.3g} %" if top is not None else ""
        bound = rounded_down(top.lower_bound if top is not None else None, 6)
        text = f"cost {solution.cost:.6g}, no schedule below {bound}, {apart}" if top is not None else ""
        overview = style.new_figure((13.33, 10.0), problem.name, f"{_sizes(problem)}: {text}")
        grid = overview.add_gridspec(3, 2, height_ratios=[1.7, 1, 1])
        timeline(overview.add_subplot(grid[0, :]), problem, schedule)
        _shares(overview.add_subplot(grid[1, 0]), problem, ages(problem, schedule), "time since the last look")
        deviation = np.sqrt(np.maximum(charged(problem, schedule), 0.0))
        _shares(overview.add_subplot(grid[1, 1]), problem, deviation, "weighted deviation, sqrt(w tr(R Σ))")
        _worst(overview.add_subplot(grid[2, 0]), problem, solution)
        _prices(overview.add_subplot(grid[2, 1]), problem, solution)
        looks = style.new_figure((13.33, 7.5), problem.name, _sizes(problem))
        timeline(looks.subplots(), problem, schedule)
    return {"overview": overview, "looks": looks}


def draw_compare(problem: TargetsProblem, solutions: Mapping[str, Solution]) -> Figure:
    """Costs of several methods beside the best bound that any of them proved.

    Parameters
    ----------
    problem : TargetsProblem
    solutions : Solution by method name
    """
    with style.house_style():
        count = len(solutions)
        figure = style.new_figure((13.33, min(12.0, 2.4 + 0.6 * count)), problem.name, _sizes(problem))
        axes = figure.subplots()
        best = max(s.certificate.lower_bound for s in solutions.values() if s.certificate is not None)
        costs = np.array([s.cost for s in solutions.values()])
        places = np.arange(count)[::-1]
        axes.barh(places, costs, height=0.6, color=style.ACCENT, alpha=0.85)
        for place, cost, solution in zip(places, costs, solutions.values(), strict=True):
            split = solution.schedule is not None and not solution.schedule.is_integer
            apart = 100 * (cost - best) / best if best > 0 else np.nan
            beside = "shares of looks" if split else f"{apart:.3g} % above the bound"
            axes.text(cost, place, f" {cost:.6g}  ({beside})", va="center", fontsize=10)
        axes.axvline(best, color=style.SECOND, linewidth=1.5)
        axes.set_title(f"cost (line: no schedule costs less than {rounded_down(best, 6)})")
        axes.set_yticks(places, list(solutions))
        axes.set_xlim(0, float(np.max(costs)) * 1.35 if np.max(costs) > 0 else None)
        axes.tick_params(axis="y", length=0)
        return figure


def _sizes(problem: TargetsProblem) -> str:
    count = style.count_of
    resources = count(len(problem.resources), "resource")
    return " · ".join((count(problem.targets, "target"), resources, count(problem.intervals, "interval")))


def timeline(axes: Axes, problem: TargetsProblem, schedule: LookSchedule) -> None:
    """One row a target; a mark in the colour of the resource that looks at it.

    Parameters
    ----------
    axes : to draw on
    problem : TargetsProblem
    schedule : its looks
    """
    T, edges, names = problem.targets, schedule.edges, schedule.resources
    if len(names) <= len(style.PALETTE):
        colours = list(style.sensor_colours(names))
    else:
        ramp = style.colour_map()
        colours = [ramp(j / max(1, len(names) - 1)) for j in range(len(names))]
    full = np.zeros((T, len(edges) - 1))
    order = np.argsort(schedule.share, kind="stable")
    full[schedule.target[order], schedule.interval[order]] = schedule.resource[order] + 1
    for _ in range(min(T // FINE, 8)):  # thick enough to be seen: into rows without a look
        for here, there in ((slice(1, None), slice(None, -1)), (slice(None, -1), slice(1, None))):
            full[here] = np.where(full[here] == 0, full[there], full[here])
    shown = np.ma.masked_equal(full, 0)
    scale = Normalize(0.5, len(names) + 0.5)
    axes.pcolormesh(edges, np.arange(T + 1) - 0.5, shown, cmap=ListedColormap(colours), norm=scale, rasterized=True)
    if T <= NAMED:
        axes.set_yticks(range(T), style.labels(problem.target_names), fontsize=9 if T <= 20 else 6)
    else:
        axes.set_ylabel("target")
    axes.tick_params(axis="y", length=0)
    axes.set_ylim(T - 0.5, -0.5)
    fractions = "" if schedule.is_integer else " (also fractions of looks)"
    axes.set_title(f"who is looked at when{fractions}")
    style.tidy_time_axis(axes, edges[0], edges[-1])
    if len(names) <= len(style.PALETTE):
        for colour, name in zip(colours, names, strict=True):
            axes.fill_between([], [], color=colour, label=style.shorten(name))
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(names), frameon=False)


def _shares(axes: Axes, problem: TargetsProblem, values: np.ndarray, title: str) -> None:
    """Percentiles over the targets of (N, targets) values."""
    times = problem.edges[1:]
    low, middle, high = np.percentile(values, SHARES, axis=1)
    axes.fill_between(times, low, high, color=style.ACCENT, alpha=0.2, linewidth=0, label="5 % to 95 % of the targets")
    axes.plot(times, middle, color=style.ACCENT, label="median")
    axes.plot(times, np.max(values, axis=1), color=style.SECOND, linewidth=1, label="largest")
    axes.set_title(title)
    axes.set_ylim(0, 1.35 * float(np.max(values)) or None)
    axes.legend(fontsize=8, loc="upper left", frameon=False, ncols=3)
    style.tidy_time_axis(axes, problem.edges[0], problem.edges[-1])


def _worst(axes: Axes, problem: TargetsProblem, solution: Solution) -> None:
    """The targets that cost most, and how often they were looked at."""
    costs = solution.arrays["per_target_cost"]
    schedule = solution.schedule
    assert isinstance(schedule, LookSchedule)
    worst = np.argsort(-costs)[:WORST]
    looks = np.bincount(schedule.target, weights=schedule.share, minlength=problem.targets)
    places = np.arange(len(worst))[::-1]
    axes.barh(places, costs[worst], color=style.ACCENT, alpha=0.85, height=0.7)
    for place, i in zip(places, worst, strict=True):
        text = f" {looks[i]:.4g} {'look' if looks[i] == 1 else 'looks'}"
        axes.text(float(costs[i]), float(place), text, va="center", fontsize=8)
    names = style.labels([problem.target_names[i] for i in worst])
    axes.set_yticks(places, names, fontsize=8)
    axes.set_xlim(0, float(np.max(costs)) * 1.2 if np.max(costs) > 0 else 1.0)
    share = float(np.sum(costs[worst]) / np.sum(costs)) if np.sum(costs) else 0.0
    axes.set_title(f"the {len(worst)} dearest targets, {100 * share:.3g} % of the cost")
    axes.tick_params(axis="y", length=0)


def _prices(axes: Axes, problem: TargetsProblem, solution: Solution) -> None:
    """What one more look would save on every interval."""
    prices = solution.arrays["prices"]
    names = problem.resource_names
    shown = np.argsort(-np.sum(prices, axis=0))[: len(style.PALETTE)]
    for j, colour in zip(np.sort(shown), style.PALETTE, strict=False):
        axes.stairs(prices[:, j], problem.edges, color=colour, baseline=None, label=style.shorten(names[j]))
    axes.set_title(f"price of one more look, by {priced_by(solution)}")
    positive, most = prices[prices > 0], float(np.max(prices, initial=0.0))
    if len(positive) and most > SPREAD * float(np.median(positive)):
        axes.set_yscale("log")
        axes.set_ylim(most / SPREAD**2, 300 * most)  # room for the names
    else:
        axes.set_ylim(bottom=0)
    if len(names) > 1:
        axes.legend(fontsize=8, frameon=False, ncols=3, loc="upper right")
    style.tidy_time_axis(axes, problem.edges[0], problem.edges[-1])

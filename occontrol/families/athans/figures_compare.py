"""One picture of several methods on one problem in continuous time: their schedules and their costs."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from occontrol.core.printed import rounded_down
from occontrol.core.solution import Solution
from occontrol.families.athans.base import AthansProblem
from occontrol.families.athans.nonlinear.linearise import linearisation_of
from occontrol.files.figures import style

SAME = 1e-6  # percent by which rounding may put a cost below a bound


def sizes(problem: AthansProblem) -> str:
    """The size of a problem in words.

    Parameters
    ----------
    problem : AthansProblem
    """

    def count(number: int, word: str) -> str:
        return f"{number} {word}{'s' * (number != 1)}"

    parts = [
        count(problem.states, "state"),
        count(len(problem.listed) if problem.takes_readings else len(problem.sensors), "sensor"),
        count(problem.readings, "reading") if problem.takes_readings else count(problem.intervals, "interval"),
    ]
    if problem.places > 1:
        parts.append(f"{problem.places} at a time")
    return " · ".join(parts)


def draw_compare(problem: AthansProblem, solutions: Mapping[str, Solution]) -> Figure:
    """Cost of several methods against the best bound that any of them proved, with their schedules.

    Parameters
    ----------
    problem : AthansProblem
    solutions : Solution by method name
    """
    with style.house_style():
        count = len(solutions)
        figure = style.new_figure((13.33, min(12.0, 2.2 + 0.85 * count)), problem.name, sizes(problem))
        left, right = figure.subplots(1, 2, width_ratios=[1.6, 1])
        _compared_schedules(left, problem, solutions)
        tops = [s.numbers.top or s.certificate for s in solutions.values()]
        bounds = [top.lower_bound for top in tops if top is not None]
        best = max(bounds, default=float("nan"))
        costs = np.array([s.cost if top is None else top.cost for s, top in zip(solutions.values(), tops, strict=True)])
        places = np.arange(count)[::-1]
        right.barh(places, costs, height=0.6, color=style.ACCENT, alpha=0.85)
        for place, cost in zip(places, costs, strict=True):
            size, unit = (1.0, "") if problem.logarithmic else (abs(cost) / 100, " %")
            apart = (cost - best) / size if best == best and size else np.nan
            # below a bound for whole readings lie only policies that split them
            beside = "  (shares)" if apart < -SAME else f"  (+{max(apart, 0.0):.2g}{unit})" if apart == apart else ""
            text = f" {cost:.6g}{beside}"
            right.text(cost, place, text, va="center", fontsize=10)
        if best == best:
            right.axvline(best, color=style.SECOND, linewidth=1.5)
            of = ", linearised" if linearisation_of(problem) is not None else ""
            right.set_title(f"cost (line: no schedule costs less than {rounded_down(best, 6)}{of})")
        low, high = min(0.0, float(np.min(costs))), max(0.0, float(np.max(costs)))
        right.set_xlim(low, high + 0.45 * (high - low) if high > low else None)
        right.set_yticks([])
        right.spines["left"].set_visible(False)
        right.set_ylim(-0.6, count - 0.4)
        return figure


def _compared_schedules(axes: Axes, problem: AthansProblem, solutions: Mapping[str, Solution]) -> None:
    """One row per method, the sensors stacked by weight in their colours."""
    colours = style.sensor_colours(problem.sensors.names)
    many = len(set(colours)) < len(colours)
    if many:
        ramp = style.colour_map()
        colours = [ramp(j / max(1, len(colours) - 1)) for j in range(len(colours))]  # type: ignore[misc]
    for row, solution in enumerate(solutions.values()):
        schedule = solution.schedule
        if schedule is None:
            continue
        base = np.full(len(schedule.edges), len(solutions) - 1 - row - 0.35)
        for j in range(len(schedule.names)):
            share = np.append(schedule.weights[:, j], schedule.weights[-1, j]) / problem.places * 0.7
            if np.any(share > 0):
                axes.fill_between(schedule.edges, base, base + share, step="post", color=colours[j], linewidth=0)
            base = base + share
    axes.set_yticks(range(len(solutions)), [style.shorten(name) for name in reversed(list(solutions))])
    axes.set_ylim(-0.6, len(solutions) - 0.4)
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.set_title("schedules" + (", one shade per sensor" if many else ""))
    if not many:
        for colour, name in zip(colours, problem.sensors.names, strict=True):
            axes.fill_between([], [], color=colour, label=style.shorten(name))
        axes.figure.legend(loc="outside lower left", ncols=min(6, len(colours)))
    style.tidy_time_axis(axes, problem.edges[0], problem.edges[-1])
    if problem.discrete:
        axes.set_xlabel("step k")

"""A picture of a schedule under rules: uses with their shortest length, slews and warm-up; budgets with their price."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from occontrol.core.solution import Solution, gap_words
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.families.athans.result import AthansResult
from occontrol.families.athans.rules.columns import on_of
from occontrol.families.athans.rules.frame import spelt
from occontrol.families.athans.rules.setting import frame_of
from occontrol.files.figures import style
from occontrol.scheduling.rules.check import changes, uses, within_windows
from occontrol.scheduling.rules.rules import Rules

TALL, MOST_BUDGETS = 0.7, 12


def draw_rules(problem: SchedulingProblem, solution: Solution) -> Figure:
    """The schedule with what its rules say of it, above the budgets.

    Parameters
    ----------
    problem : with rules
    solution : with a whole schedule
    """
    numbers: AthansResult = solution.numbers  # type: ignore[assignment]
    edges = np.asarray(solution.arrays["edges"])
    problem = problem.with_edges([(float(t), "") for t in edges[~np.isin(edges, problem.edges)]])
    rules = frame_of(problem).rules
    on = on_of(np.asarray(solution.arrays["weights"]), rules)
    budgets = _budgets(problem, rules, on, numbers)[:MOST_BUDGETS]
    real = [j for j in range(rules.sensors) if np.any(on[:, j]) or not rules.idle[j]]
    size = (13.33, min(10.0, 2.2 + 0.42 * len(real) + 0.42 * max(len(budgets), 1)))
    gap = gap_words(numbers.relative_gap, problem.logarithmic, 2)
    proven = "proven optimal" if numbers.proven_optimal else gap
    with style.house_style():
        figure = style.new_figure(size, problem.name, f"{numbers.switches} changes, {proven}")
        above, below = figure.subplots(2, 1, height_ratios=[len(real) + 0.8, max(len(budgets), 1) + 0.8])
        _uses(above, solution, rules, on, real)
        _bars(below, budgets)
    return figure


def _uses(axes: Axes, solution: Solution, rules: Rules, on: np.ndarray, real: list[int]) -> None:
    """A row for every sensor; the length that a use owes is dark, the rest of it pale."""
    edges = np.asarray(solution.arrays["edges"])
    measuring = np.asarray(solution.arrays["measuring"])
    colours = style.sensor_colours(rules.names)
    handles = {}
    for row, j in enumerate(real):
        for a, b in uses(on[:, j]):
            begin, end = edges[a], edges[b]
            axes.barh(row, end - begin, left=begin, height=TALL, color=colours[j], alpha=0.45, lw=0)
            owed = min(float(rules.min_on[j]), end - begin)
            if owed > 0:
                axes.barh(row, owed, left=begin, height=TALL, color=colours[j], lw=0)
                handles["min_on"] = Patch(color=style.GREY, label="owed by min_on")
            cold = [k for k in range(a, b) if measuring[k, j] < 0.5]
            if cold:
                width = edges[cold[-1] + 1] - begin
                axes.barh(row, width, left=begin, height=TALL, fill=False, hatch="xxx", edgecolor=style.INK, lw=0)
                handles["warm"] = Patch(fill=False, hatch="xxx", edgecolor=style.INK, lw=0, label="warming up")
    place = {j: row for row, j in enumerate(real)}
    for a, stopped, started, b in changes(rules, on):
        if b > a:
            axes.axvspan(edges[a], edges[b], facecolor="none", hatch="///", edgecolor=style.GREY, lw=0)
            handles["slew"] = Patch(fill=False, hatch="///", edgecolor=style.GREY, lw=0, label="slewing")
            if stopped and started and stopped[0] in place and started[0] in place:
                axes.plot(edges[[a, b]], [place[stopped[0]], place[started[0]]], color=style.INK, lw=1.2)
    axes.set_yticks(range(len(real)), style.labels([rules.names[j] for j in real]))
    axes.set_ylim(len(real) - 0.5, -0.5)
    axes.tick_params(axis="y", length=0)
    style.tidy_time_axis(axes, float(edges[0]), float(edges[-1]))
    if handles:
        axes.legend(handles=list(handles.values()), loc="upper left", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.3)


def _budgets(
    problem: SchedulingProblem, rules: Rules, on: np.ndarray, numbers: AthansResult
) -> list[tuple[str, float, float, float]]:
    """(what, used, allowed, price of one more unit) of every budget."""
    found, prices = [], numbers.multipliers or {}

    def add(rule: str, j: int | None, used: float, limit: float) -> None:
        name = spelt(rule, None if j is None else rules.names[j])
        if np.isfinite(limit):
            found.append((name, used, float(limit), float(prices.get(name, 0.0))))

    for j in range(rules.sensors):
        add("max_uses", j, float(len(uses(on[:, j]))), float(rules.max_uses[j]))
        add("max_time", j, float(problem.steps @ on[:, j]), float(rules.max_time[j]))
        if np.isfinite(rules.duty_time[j]):
            _, most = within_windows(problem.edges, uses(on[:, j]), float(rules.duty_window[j]))
            add("duty_time", j, float(np.max(most, initial=0.0)), float(rules.duty_time[j]))
    if rules.max_switches is not None:
        add("max_switches", None, float(numbers.switches), float(rules.max_switches))
    add("max_observation", None, float(numbers.observation_cost), rules.max_observation)
    add("max_error", None, float(numbers.prediction_error + numbers.running_cost), rules.max_error)
    return found


def _bars(axes: Axes, budgets: list[tuple[str, float, float, float]]) -> None:
    """A bar for every budget, full where nothing is left of it."""
    if not budgets:
        axes.axis("off")
        axes.text(0.0, 0.5, "no budget", color=style.GREY, transform=axes.transAxes)
        return
    for row, (_, used, limit, price) in enumerate(budgets):
        share = used / limit if limit > 0 else 1.0
        axes.barh(row, 1.0, height=TALL, color=style.PALE, lw=0)
        axes.barh(row, min(share, 1.0), height=TALL, color=style.ACCENT, lw=0)
        worth = f"   one more saves about {price:.3g}" if price > 0 else ""
        axes.text(1.02, row, f"{used:.4g} of {limit:.4g}{worth}", va="center", fontsize=10)
    axes.set_yticks(range(len(budgets)), [style.shorten(name, 34) for name, *_ in budgets])
    axes.set_ylim(len(budgets) - 0.5, -0.5)
    axes.set_xlim(0, 1.7)
    axes.set_xticks([0, 0.5, 1], ["0", "50 %", "100 %"])
    axes.tick_params(axis="y", length=0)
    axes.set_xlabel("used of the budget", loc="left")

"""Pictures of a selection: who was chosen, how the errors went, where they were largest, and methods side by side."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from occontrol.core.printed import rounded_down
from occontrol.core.solution import Solution
from occontrol.core.state_labels import state_labels
from occontrol.families.vlambda.result import numbers_of
from occontrol.files.figures import style
from occontrol.files.figures.axes import alike, together, value_axis
from occontrol.files.figures.panels import curves_panel, map_panel, schedule_panel

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    from occontrol.families.vlambda.problem import Problem

MOST_CURVES = 7  # curves that can be told apart
MOST_STATES = 48  # states that have a panel each
LEGEND_LINE, LEGEND_NAME = 50, 10  # letters of a legend of one line, and of a name in one that has more
MOST_LINES_BETWEEN = 100  # choices that are parted by lines


def draw(problem: Problem, solution: Solution) -> dict[str, Figure]:
    """The overview, and every state's standard deviation by itself.

    Parameters
    ----------
    problem : Problem of the family vlambda
    solution : Solution
    """
    with style.house_style():
        return {"overview": _overview(problem, solution), "deviations": _deviations(problem, solution)}


def draw_compare(problem: Problem, solutions: Mapping[str, Solution]) -> Figure:
    """What several methods chose, what it cost, and the largest eigenvalue over k.

    Parameters
    ----------
    problem : Problem of the family vlambda
    solutions : Solution by method name
    """
    with style.house_style():
        count = len(solutions)
        figure = style.new_figure((13.33, min(14.0, 4.6 + 0.42 * count)), problem.name, _subtitle(problem))
        grid = figure.add_gridspec(2, 2, height_ratios=[max(1.0, 0.15 * count), 1.3], width_ratios=[2.2, 1])
        _strips(figure.add_subplot(grid[0, 0]), problem, solutions)
        _costs(figure.add_subplot(grid[0, 1]), problem, solutions)
        _eigenvalue_curves(figure.add_subplot(grid[1, :]), solutions)
    return figure


def _subtitle(problem: Problem) -> str:
    parts = [style.count_of(problem.states, "state"), style.count_of(len(problem.sensors), "sensor")]
    parts.append(f"{problem.select} at a time")
    every = "a choice every step" if problem.epoch == 1 else f"a choice every {problem.epoch} steps"
    return " · ".join([*parts, every, f"cost: sum of {_criterion(problem)}"])


def _criterion(problem: Problem) -> str:
    return "tr P(k|k)" if problem.criterion == "trace" else "λmax P(k|k)"


def _steps(axes: Axes, problem: Problem, label: bool = True) -> None:
    style.step_axis(axes, problem.steps, label)


def _overview(problem: Problem, solution: Solution) -> Figure:
    figure = style.new_figure(style.SLIDE, problem.name, f"method {solution.method} · {_subtitle(problem)}")
    movable = problem.movable and any(e.locations for e in numbers_of(solution).schedule)
    heights = [max(1.0, min(2.2, 0.2 * len(problem.sensors))), *([1.0] if movable else []), 1.4, 1.4]
    grid = figure.add_gridspec(len(heights), 2, width_ratios=[4.2, 1], height_ratios=heights)
    top = figure.add_subplot(grid[0, 0])
    top.set_title("chosen")
    if solution.schedule is not None:
        schedule_panel(top, solution.schedule)
    _steps(top, problem, False)
    if movable:
        _locations(figure.add_subplot(grid[1, 0]), problem, solution)
    middle = figure.add_subplot(grid[-2, 0])
    _all_deviations(middle, problem, solution)
    _steps(middle, problem, False)
    bottom = figure.add_subplot(grid[-1, 0])
    _eigenvalues(bottom, solution)
    _steps(bottom, problem)
    text = figure.add_subplot(grid[:, 1])
    text.axis("off")
    text.text(0, 1, "result", fontweight="bold", fontsize=12, va="top")
    text.text(0, 0.95, _text(problem, solution), va="top", fontsize=11, linespacing=1.5)
    return figure


def _text(problem: Problem, solution: Solution) -> str:
    r = numbers_of(solution)
    lines = [f"status {solution.status}", "", f"cost {r.cost:.8g}"]
    if r.lower_bound is not None:
        lines.append(f"bound {rounded_down(r.lower_bound, 8)}")
        lines += [] if r.relative_gap is None else [f"gap {100 * r.relative_gap:.3g} %"]
        if r.bound_holds_for:
            lines.append("(on a grid of locations)")
    lines += ["", f"sum of traces {r.sum_trace:.6g}", f"sum of λmax {r.sum_largest_eigenvalue:.6g}"]
    lines += [
        f"peak λmax {r.peak_largest_eigenvalue:.6g}",
        "",
        style.count_of(problem.epochs, "choice"),
        f"{r.switches} switch{'es' * (r.switches != 1)}",
    ]
    return "\n".join(lines)


def _locations(axes: Axes, problem: Problem, solution: Solution) -> None:
    names = problem.sensors.names
    colours = style.sensor_colours(names)
    for entry in numbers_of(solution).schedule:
        begin, end = problem.starts[entry.epoch], problem.starts[entry.epoch + 1]
        for name, place in (entry.locations or {}).items():
            for i, x in enumerate(place):
                dashes = ("-", "--", ":")[min(i, 2)]
                axes.plot([begin, end], [x, x], color=colours[names.index(name)], linewidth=3, linestyle=dashes)
    axes.set_ylabel("location")
    axes.grid(axis="y")
    _steps(axes, problem, False)


def _all_deviations(axes: Axes, problem: Problem, solution: Solution) -> None:
    deviations, n = solution.arrays["standard_deviations"], problem.states
    names = state_labels(problem)
    if n <= MOST_CURVES:
        curves_panel(axes, solution.arrays["times"], deviations, names, "standard deviation")
    else:
        edges = np.arange(problem.steps + 1, dtype=float)
        map_panel(axes, edges, deviations, names, "standard deviation", ends=True)


def _eigenvalues(axes: Axes, solution: Solution) -> None:
    k, values = solution.arrays["times"], solution.arrays["eigenvalues"]
    columns = {"λmax": values[:, 0], "λmax predicted": solution.arrays["predicted_eigenvalues"][:, 0]}
    if values.shape[1] > 1:
        columns["trace"] = values.sum(axis=1)
    curves_panel(axes, k, np.column_stack(list(columns.values())), list(columns), "P(k|k)",
                 (style.ACCENT, style.GREY, style.SECOND))  # fmt: skip


def _deviations(problem: Problem, solution: Solution) -> Figure:
    shown = min(problem.states, MOST_STATES)
    rows, columns = style.grid_of(shown)
    subtitle = f"standard deviation of every state · method {solution.method}"
    subtitle += f"; the first {shown} of {problem.states}" if shown < problem.states else ""
    figure = style.new_figure((13.33, max(7.5, 1.3 * rows)), problem.name, subtitle)
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True)
    k, deviations, names = solution.arrays["times"], solution.arrays["standard_deviations"], state_labels(problem)
    for i, one in enumerate(axes.T.ravel()):
        if i >= shown:
            one.axis("off")
            continue
        one.plot(k, deviations[:, i], color=style.ACCENT)
        style.dot_if_alone(one)
        value_axis(one, deviations[:, i])
        one.set_ylabel(names[i])
        one.grid(axis="y")
        for start in problem.starts[1:-1] if problem.epochs <= 60 else []:
            one.axvline(start, color=style.PALE, linewidth=0.8, zorder=0)
        style.step_axis(one, problem.steps, False)
    for one in axes[-1]:
        one.tick_params(labelbottom=True)
        one.set_xlabel("step k")
    return figure


def _strips(axes: Axes, problem: Problem, solutions: Mapping[str, Solution]) -> None:
    """One row per method, one colour per sensor; with several at a time the row is shared among them.

    Of many sensors the most used have a colour, the others are grey; a white line ends every choice.
    """
    names, count = problem.sensors.names, len(solutions)
    colours = style.sensor_colours(names)
    shown = list(range(len(names)))
    if len(names) > MOST_CURVES:
        use = sum(s.schedule.weights.sum(axis=0) for s in solutions.values() if s.schedule is not None)
        shown = sorted(np.argsort(-np.asarray(use), kind="stable")[: MOST_CURVES - 1].tolist())
        palette = dict(zip(shown, style.PALETTE, strict=False))
        colours = [palette.get(j, style.GREY) for j in range(len(names))]
    for row, solution in enumerate(solutions.values()):
        if solution.schedule is None:
            continue
        edges, weights = solution.schedule.edges, solution.schedule.weights
        for j, colour in enumerate(colours):
            on = weights[:, j] > 0.5
            rank = np.cumsum(weights > 0.5, axis=1)[:, j] - 1
            height = 0.74 / problem.select
            axes.bar(
                edges[:-1][on],
                np.full(int(np.sum(on)), height),
                np.diff(edges)[on],
                count - 1 - row - 0.37 + rank[on] * height,
                align="edge",
                color=colour,
                edgecolor="white",
                linewidth=0.5 if len(names) > MOST_CURVES and problem.epochs <= MOST_LINES_BETWEEN else 0,
            )
    axes.set_yticks(range(count), [style.shorten(name) for name in reversed(list(solutions))])
    axes.tick_params(axis="y", length=0)
    axes.set_ylim(-0.6, count - 0.4)
    axes.spines["left"].set_visible(False)
    axes.set_title("chosen")
    _steps(axes, problem)
    room = style.LONGEST_NAME if sum(map(len, names)) <= LEGEND_LINE else LEGEND_NAME
    few = style.labels(names, room)
    handles, texts = [_patch(colours[j]) for j in shown], [few[j] for j in shown]
    if len(shown) < len(names):
        handles, texts = [*handles, _patch(style.GREY)], [*texts, f"{len(names) - len(shown)} others"]
    axes.legend(
        handles,
        texts,
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=len(texts),
        handlelength=1.0,
        fontsize=9,
        columnspacing=1.0,
    )


def _patch(colour: str) -> Patch:
    from matplotlib.patches import Patch

    return Patch(color=colour)


def _costs(axes: Axes, problem: Problem, solutions: Mapping[str, Solution]) -> None:
    costs = np.array([s.cost for s in solutions.values()])
    places = np.arange(len(costs))[::-1]
    colours = [style.SECOND if name == "optimal" else style.ACCENT for name in solutions]
    axes.barh(places, costs, height=0.6, color=colours, alpha=0.85)
    wide = np.max(costs) > 20 * np.min(costs) > 0
    if wide:
        axes.set_xscale("log")
        axes.set_xlim(np.min(costs) / 2, np.max(costs) * 12)
    else:
        axes.set_xlim(0, np.max(costs) * 1.3)
    for place, cost in zip(places, costs, strict=True):
        axes.text(cost, place, f" {cost:.6g}", va="center", fontsize=10)
    axes.set_yticks([])
    axes.set_ylim(-0.6, len(costs) - 0.4)
    axes.spines["left"].set_visible(False)
    axes.set_title(f"cost, sum of {_criterion(problem)}")


def _eigenvalue_curves(axes: Axes, solutions: Mapping[str, Solution]) -> None:
    """Largest eigenvalue of every method; the cheapest few in colour, the others grey."""
    order = sorted(solutions, key=lambda name: (name not in ("eigenspace", "optimal"), solutions[name].cost))
    coloured = [name for name in solutions if name in order[:MOST_CURVES]]
    values = {name: solution.arrays["largest_eigenvalue"] for name, solution in solutions.items()}
    longest = max(map(len, values.values()))
    stacked = np.full((longest, len(values)), np.nan)
    for j, each in enumerate(values.values()):
        stacked[: len(each), j] = each
    names = list(values)
    for group in alike(stacked, value_axis(axes, stacked)):
        first = min(group, key=lambda j: names[j] not in coloured)
        name, known = names[first], names[first] in coloured
        axes.plot(
            np.arange(longest),
            stacked[:, first],
            color=style.PALETTE[coloured.index(name)] if known else style.GREY,
            linewidth=2.4 if name == "eigenspace" else 1.3,
            zorder=3 if known else 1,
            label=together(names, [first, *(j for j in group if j != first)]) if known else None,
        )
    style.step_axis(axes, longest)
    style.dot_if_alone(axes)
    axes.set_ylabel("λmax P(k|k)")
    axes.grid(axis="y")
    others = len(solutions) - len(coloured)
    axes.set_title("largest error variance" + (f" (grey: {style.count_of(others, 'other')})" if others else ""))
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.03), borderaxespad=0.0, handlelength=1.4)

"""Pictures of robust switching: the set of possible states over time, its size, and who measures when."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from occontrol.core.measurement import Estimate
from occontrol.core.printed import rounded_down
from occontrol.core.solution import Solution
from occontrol.core.state_labels import state_labels, state_names, state_units
from occontrol.core.trajectory import Trajectory
from occontrol.families.robust.problem import Problem
from occontrol.families.robust.result import SequenceResult, SharesResult, numbers_of, sequence_of
from occontrol.families.robust.sampling import Truths, sample_truths
from occontrol.files.figures import panels, style
from occontrol.files.figures.axes import value_axis

MOST_STATES = 48  # states that have a panel each
MOST_ELLIPSOIDS = 8  # ellipsoids
SAMPLED_TRUTHS = 150  # sampled admissible truths
MOST_SLOTS = 200  # no truths are sampled beyond


def draw(problem: Problem, solution: Solution, plane: tuple[int, int] = (0, 1)) -> dict[str, Figure]:
    """The figures of one solution, the most telling first.

    Parameters
    ----------
    problem : the robust problem
    solution : Solution
    plane : the two states whose plane shows the ellipsoids
    """
    numbers = numbers_of(solution)
    with style.house_style():
        figures = {}
        if isinstance(numbers, SequenceResult):
            figures["overview"] = _overview(problem, solution, plane)
            figures["states"] = _states(problem, solution)
            if numbers.ranking is not None:
                figures["sequences"] = _ranking(problem, solution.arrays["costs"], numbers.sequence)
        elif isinstance(numbers, SharesResult):
            figures["shares"] = _shares(problem, solution, numbers.lower_bound)
        return figures


def draw_compare(problem: Problem, solutions: Mapping[str, Solution]) -> Figure:
    """Size over time and schedule of several methods.

    Parameters
    ----------
    problem : the robust problem
    solutions : Solution by method name
    """
    shown = {name: s for name, s in solutions.items() if s.schedule is not None and "fine_times" in s.arrays}
    with style.house_style():
        title = f"{problem.name}: methods compared"
        figure = style.new_figure(style.SLIDE, title, _size_words(problem))
        if not shown:
            return figure
        heights = [1.0] * len(shown)
        grid = figure.add_gridspec(len(shown) + 1, 1, height_ratios=[max(2.4, 0.9 * len(shown)), *heights])
        axes = figure.add_subplot(grid[0])
        for k, ((name, solution), colour) in enumerate(zip(shown.items(), style.PALETTE * 3, strict=False)):
            a, cost = solution.arrays, solution.cost
            # methods that agree stay visible: each later line is thinner
            width = max(1.2, 5.0 - 0.9 * k)
            axes.plot(a["fine_times"], a["fine_size"], color=colour, linewidth=width, label=f"{name}  {cost:.5g}")
        axes.set_ylabel("size (worst case)")
        axes.grid(True)
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), title="size at the end")
        style.tidy_time_axis(axes, problem.edges[0], problem.edges[-1], label=False)
        for row, (name, solution) in enumerate(shown.items(), start=1):
            below = figure.add_subplot(grid[row])
            panels.schedule_panel(below, solution.schedule, shares=False)  # type: ignore[arg-type]
            below.set_title(name, fontsize=10)
            style.tidy_time_axis(below, problem.edges[0], problem.edges[-1], label=row == len(shown))
        return figure


def draw_estimate(
    problem: Problem, solution: Solution, estimate: Estimate, truth: Trajectory | None = None
) -> dict[str, Figure]:
    """The set of possible states from a measurement file, state by state, with the truth where it is known.

    Parameters
    ----------
    problem : the robust problem
    solution : of the run
    estimate : Estimate, half widths in standard_deviation
    truth : Trajectory, optional
    """
    n, names = min(estimate.mean.shape[1], MOST_STATES), state_labels(problem)
    with style.house_style():
        subtitle = "the band holds every state that the data allow"
        rows, columns = style.grid_of(n)
        figure = style.new_figure((13.33, 1.7 * rows + 1.6), f"{problem.name}: possible states", subtitle)
        for i in range(n):
            axes = figure.add_subplot(rows, columns, i + 1)
            mean, half = estimate.mean[:, i], estimate.standard_deviation[:, i]
            axes.fill_between(estimate.times, mean - half, mean + half, color=style.ACCENT, alpha=0.2, linewidth=0)
            axes.plot(estimate.times, mean, color=style.ACCENT, label="center")
            if truth is not None:
                axes.plot(truth.times, truth.values[:, i], color=style.SECOND, linewidth=1.3, label="truth")
            axes.set_ylabel(names[i])
            axes.grid(True)
            if i == 0:
                axes.legend(loc="upper right", ncols=2)
            style.tidy_time_axis(axes, estimate.times[0], estimate.times[-1], label=i >= n - columns)
        return {"estimates": figure}


def _size_words(problem: Problem) -> str:
    return f"size: {problem.measure.text}; worst case over all measurements and all admissible uncertainties"


def _subtitle(problem: Problem, solution: Solution) -> str:
    cost, gap = solution.cost, 0.0 if solution.certificate is None else max(solution.certificate.relative_gap, 0.0)
    proven = "proven best" if gap < 1e-9 else f"at most {100 * gap:.2g} % above the best"
    return f"{solution.method}: {problem.measure.text} at the end {cost:.6g}, {proven}"


def _overview(problem: Problem, solution: Solution, plane: tuple[int, int]) -> Figure:
    figure = style.new_figure(style.SLIDE, problem.name, _subtitle(problem, solution))
    rows = max(1.0, 0.35 * len(problem.sensors))
    grid = figure.add_gridspec(2, 2, width_ratios=[1.15, 1], height_ratios=[2.6, rows])
    sets = figure.add_subplot(grid[:, 0])
    if problem.states > 1:
        _ellipsoids(figure, sets, problem, solution, plane)
    else:
        _interval(sets, problem, solution)
    size = figure.add_subplot(grid[0, 1])
    a = solution.arrays
    size.plot(a["fine_times"], a["fine_size"], color=style.ACCENT)
    size.plot(a["fine_times"][-1:], a["fine_size"][-1:], "o", color=style.ACCENT, clip_on=False)
    size.set_title("Size of the set, worst case up to t")
    value_axis(size, a["fine_size"])
    size.set_ylabel("size")
    size.grid(True)
    style.tidy_time_axis(size, problem.edges[0], problem.edges[-1], label=False)
    bars = figure.add_subplot(grid[1, 1])
    panels.schedule_panel(bars, solution.schedule)  # type: ignore[arg-type]
    bars.set_title("Who measures when")
    if problem.slots <= 60:
        bars.set_xticks(problem.edges, minor=True)
    style.tidy_time_axis(bars, problem.edges[0], problem.edges[-1])
    return figure


def _truths(problem: Problem, solution: Solution) -> Truths | None:
    if problem.slots > MOST_SLOTS or problem.states > 12:
        return None
    steps = int(np.clip(400 // problem.slots, 4, 40))
    sequence = sequence_of(solution)
    return sample_truths(problem.flow, problem.plant, problem.edges, sequence, SAMPLED_TRUTHS, 0, steps)


def _ellipsoids(figure: Figure, axes: Axes, problem: Problem, solution: Solution, plane: tuple[int, int]) -> None:
    a, (i, j) = solution.arrays, plane
    colours, span = style.colour_map(), Normalize(problem.edges[0], problem.edges[-1])
    truths = _truths(problem, solution)
    if truths is not None:
        away = truths.states - truths.centers
        for r in range(away.shape[1]):
            axes.plot(away[:, r, i], away[:, r, j], color="#c8c8c8", linewidth=0.3, zorder=1)
    circle = np.linspace(0, 2 * np.pi, 181)
    points = np.array([np.cos(circle), np.sin(circle)])
    for k in np.unique(np.linspace(0, len(a["fine_times"]) - 1, MOST_ELLIPSOIDS).astype(int)):
        part = a["fine_shape"][k][np.ix_([i, j], [i, j])] * a["fine_level"][k]
        outline = np.linalg.cholesky((part + part.T) / 2 + 1e-300 * np.eye(2)) @ points
        time = a["fine_times"][k]
        axes.plot(*outline, color=colours(span(time)), linewidth=2.0, zorder=3)
        if truths is not None:
            near = int(np.argmin(np.abs(truths.times - time)))
            axes.plot(away[near, :, i], away[near, :, j], ".", color=colours(span(time)), markersize=3, zorder=4)
    axes.axhline(0, color=style.GREY, linewidth=0.6, zorder=0)
    axes.axvline(0, color=style.GREY, linewidth=0.6, zorder=0)
    axes.set_title("Largest sets of possible states, and admissible truths inside")
    names, units = state_names(problem), state_units(problem)
    for k, label in ((i, axes.set_xlabel), (j, axes.set_ylabel)):
        label(f"{names[k]} minus its center" + (f" [{units[k]}]" if units[k] else ""))
    figure.colorbar(ScalarMappable(span, colours), ax=axes, label="time t", fraction=0.04, pad=0.02)


def _interval(axes: Axes, problem: Problem, solution: Solution) -> None:
    a = solution.arrays
    half = np.sqrt(a["fine_level"] * a["fine_shape"][:, 0, 0])
    axes.fill_between(a["fine_times"], -half, half, color=style.ACCENT, alpha=0.2, linewidth=0)
    truths = _truths(problem, solution)
    if truths is not None:
        axes.plot(truths.times, (truths.states - truths.centers)[:, :, 0], color="#808080", linewidth=0.4)
    axes.set_title("Largest set of possible states, and admissible truths inside")
    axes.set_ylabel(f"{state_names(problem)[0]} minus its center")
    style.tidy_time_axis(axes, problem.edges[0], problem.edges[-1])


def _states(problem: Problem, solution: Solution) -> Figure:
    a, n, names = solution.arrays, min(problem.states, MOST_STATES), state_labels(problem)
    title, subtitle = f"{problem.name}: half width of the set along every state", "worst case over all measurements"
    rows, columns = style.grid_of(n)
    figure = style.new_figure((13.33, max(7.5, 1.4 * rows)), title, subtitle)
    half = np.sqrt(a["fine_level"][:, None] * np.diagonal(a["fine_shape"], axis1=1, axis2=2))
    truths = _truths(problem, solution)
    for i in range(n):
        axes = figure.add_subplot(rows, columns, i + 1)
        axes.fill_between(a["fine_times"], 0, half[:, i], color=style.ACCENT, alpha=0.15, linewidth=0)
        axes.plot(a["fine_times"], half[:, i], color=style.ACCENT, label="bound")
        if truths is not None:
            reached = np.max(np.abs((truths.states - truths.centers)[:, :, i]), axis=1)
            label = f"largest of {SAMPLED_TRUTHS} truths"
            axes.plot(truths.times, reached, color=style.SECOND, linewidth=1.2, label=label)
        if i == 0:
            axes.legend(loc="upper right", ncols=2)
        axes.set_ylabel(names[i])
        axes.set_ylim(0, 1.18 * float(np.max(half[:, i])))
        axes.grid(True)
        style.tidy_time_axis(axes, problem.edges[0], problem.edges[-1], label=i >= n - columns)
    return figure


def _shares(problem: Problem, solution: Solution, lower_bound: float) -> Figure:
    subtitle = f"relaxation: no sequence on these slots is smaller than {rounded_down(lower_bound, 6)}"
    figure = style.new_figure((13.33, 1.2 + 0.7 * len(problem.sensors) + 1.0), problem.name, subtitle)
    axes = figure.add_subplot()
    panels.schedule_panel(axes, solution.schedule)  # type: ignore[arg-type]
    axes.set_title("Shares of the sensors in every slot")
    style.tidy_time_axis(axes, problem.edges[0], problem.edges[-1])
    return figure


def _ranking(problem: Problem, costs: np.ndarray, sequence: Sequence[str]) -> Figure:
    figure = style.new_figure((11.0, 6.0), f"{problem.name}: all {len(costs)} sequences", _size_words(problem))
    axes = figure.add_subplot()
    axes.plot(np.arange(1, len(costs) + 1), costs, color=style.ACCENT, drawstyle="steps-mid")
    axes.plot([1], costs[:1], "o", color=style.SECOND)
    best = " ".join(sequence[:12]) + (" .." if len(sequence) > 12 else "")
    axes.annotate(f"best: {best}", (1.5, costs[0]), xytext=(16, -5), textcoords="offset points", color=style.SECOND)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel("rank")
    axes.set_ylabel("size at the end")
    axes.set_xlim(0, len(costs) + 1)
    axes.set_ylim(bottom=costs[0] - 0.08 * max(costs[-1] - costs[0], 1e-12 * abs(costs[0])))
    axes.grid(True)
    return figure

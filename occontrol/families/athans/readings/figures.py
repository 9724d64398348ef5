"""Pictures of a schedule of readings: who is read when, deviations, switching functions, convergence."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from occontrol.core.sensor import IDLE
from occontrol.core.solution import Solution
from occontrol.core.state_labels import state_labels
from occontrol.families.athans.overview import compress, convergence, overview, subtitle
from occontrol.families.athans.readings.problem import ReadingsProblem
from occontrol.files.figures import style
from occontrol.files.figures.axes import alike, name_rows, together
from occontrol.files.figures.panels import curves_panel, legend, map_panel
from occontrol.files.page.usual import deviations

MOST_COUNTED = 10  # sensors whose readings are listed
UNEVEN = 10.0  # times as far apart later: then the axis of time is drawn by square roots


def draw(problem: ReadingsProblem, solution: Solution) -> dict[str, Figure]:
    """Every figure of one solution.

    Parameters
    ----------
    problem : ReadingsProblem
    solution : Solution with a schedule

    Returns overview, schedule, deviations, switching and, for iterative methods, convergence.
    """
    with style.house_style():
        figures = {
            "overview": overview(
                problem, solution, (draw_schedule, _draw_states, _draw_switching), counts_of(problem, solution)
            ),
            "schedule": _one(problem, solution, draw_schedule, min(10.0, 2.2 + 0.36 * min(len(problem.sensors), 30))),
            "deviations": _one(problem, solution, _draw_states, 6.0 + style.rows_height(problem.states)),
            "switching": _one(problem, solution, _draw_switching, 6.0 + style.rows_height(len(problem.sensors))),
        }
        last = convergence(problem, solution)
        return figures if last is None else {**figures, "convergence": last}


def _one(problem: ReadingsProblem, solution: Solution, draw_panel, height: float) -> Figure:
    figure = style.new_figure((12, height), problem.name, subtitle(problem, solution))
    draw_panel(figure.subplots(), problem, solution)
    return figure


def time_axis(axes: Axes, problem: ReadingsProblem, label: bool) -> None:
    """The axis of steps or time; of times that lie far more densely at the start, by their square root.

    Parameters
    ----------
    axes : to draw on
    problem : of readings
    label : whether the axis is labelled
    """
    clock, edges = problem.clock, problem.edges
    if problem.discrete:
        style.step_axis(axes, max(int(edges[-1]) - 1, 1), label)
        return
    start, end = float(min(clock.start, edges[0])), float(clock.end)
    gaps = np.diff(clock.times)
    half = len(gaps) // 2
    if len(gaps) > 3 and UNEVEN * np.mean(gaps[:half]) < np.mean(gaps[half:]):

        def root(t: np.ndarray) -> np.ndarray:
            return np.sqrt(np.maximum(np.asarray(t, dtype=float) - start, 0.0))

        axes.set_xscale("function", functions=(root, lambda r: np.asarray(r) ** 2 + start))
        ticks = start + (end - start) * np.linspace(0, 1, 7) ** 2
        rounded = [float(f"{t:.1g}") if t < 0.9 * end else t for t in ticks]
        axes.set_xticks(sorted({t for t in rounded if start <= t <= end}))
    style.tidy_time_axis(axes, start, end, label)


def _map(axes: Axes, problem: ReadingsProblem, values: np.ndarray, names: Sequence[str], words: str, label: bool,
         ends: bool = False) -> None:  # fmt: skip
    """A map (N, rows) with one column for every reading; that of step k is centred on k."""
    shift = 0.5 if problem.discrete else 0.0
    map_panel(axes, problem.edges - shift, values, names, words, ends=ends)
    time_axis(axes, problem, label)
    if problem.discrete:
        axes.set_xlim(-shift, float(problem.edges[-1]) - shift)


def draw_schedule(axes: Axes, problem: ReadingsProblem, solution: Solution, label: bool = True) -> None:
    """A dot for every reading; pale bars where a sensor may be read.

    Parameters
    ----------
    axes : to draw on
    problem : of readings
    solution : with a schedule
    label : whether the axis of time is labelled
    """
    names = [name for name in problem.sensors.names if name != IDLE]
    colours = dict(zip(problem.sensors.names, style.sensor_colours(problem.sensors.names), strict=True))
    times, weights = problem.clock.times, solution.arrays["weights"]
    axes.set_title("who is read when" + (" (grey: may be read)" if np.any(problem.upper == 0) else ""))
    size = float(np.clip(600 / max(len(times), 1), 6, 60))
    upper = problem.upper[problem.clock.owner]
    for place, name in enumerate(names):
        j = problem.sensors.names.index(name)
        if np.any(problem.upper == 0):
            open_ = times[upper[:, j] > 0]
            axes.scatter(
                open_, np.full(len(open_), place), s=size, marker="s", color=style.PALE, lw=0, zorder=1, clip_on=False
            )
        used = weights[:, j] > 1e-6
        shares = size * np.clip(weights[used, j], 0.05, 1.0)
        axes.scatter(
            times[used], np.full(int(used.sum()), place), s=shares, color=colours[name], lw=0, zorder=2, clip_on=False
        )
    axes.set_ylim(len(names) - 0.3, -0.7)  # the first on top
    name_rows(axes, names)
    time_axis(axes, problem, label)


def _draw_states(axes: Axes, problem: ReadingsProblem, solution: Solution, label: bool = True) -> None:
    """Deviations just before and just after every reading, joined."""
    times = problem.clock.times
    after, names = deviations(solution.arrays["covariance"]), state_labels(problem)
    title = "standard deviation of the estimation error"
    if problem.states <= style.MOST_LINES:
        prior = deviations(solution.arrays["prior_covariance"][:-1])
        both = np.stack([prior, after], axis=1).reshape(2 * len(times), -1)
        axes.set_title(f"{title}, before and after every reading")
        curves_panel(axes, np.repeat(times, 2), both, names, "deviation")
        time_axis(axes, problem, label)
    else:
        axes.set_title(f"{title} just after every reading")
        _map(axes, problem, after, names, "deviation", label, ends=True)


def _draw_switching(axes: Axes, problem: ReadingsProblem, solution: Solution, label: bool = True) -> None:
    """What one more reading would change to first order; marked where it is taken."""
    names, times = problem.sensors.names, problem.clock.times
    upper, taken = problem.upper[problem.clock.owner], solution.arrays["weights"] > 0.5
    switching = np.where(upper > 0, solution.arrays["switching"], np.nan)
    if len(names) <= style.MOST_LINES:
        axes.set_title("switching functions: price less first-order saving (dots: read)")
        colours = style.sensor_colours(names)
        for group in alike(switching, log=False):
            colour = colours[group[0]]
            axes.plot(times, switching[:, group[0]], color=colour, lw=0.8, label=together(names, group))
            for j in group:
                axes.plot(times[taken[:, j]], switching[taken[:, j], j], "o", ms=3.5, color=colour, clip_on=False)
        compress(axes, switching)
        axes.set_ylabel("cost of a reading")
        axes.grid(axis="y")
        legend(axes, len(names))
        time_axis(axes, problem, label)
    else:
        axes.set_title("switching functions above the smallest (dots: read)")
        smallest = np.min(np.where(np.isfinite(switching), switching, np.inf), axis=1, keepdims=True)
        _map(axes, problem, switching - smallest, names, "cost of a reading", label)
        shift = 0.0 if problem.discrete else np.diff(problem.edges)[np.nonzero(taken)[0]] / 2
        size = float(np.clip(400 / max(len(times), 1), 2, 20))
        axes.scatter(times[np.nonzero(taken)[0]] + shift, np.nonzero(taken)[1], s=size, color=style.SECOND, lw=0)


def counts_of(problem: ReadingsProblem, solution: Solution) -> list[str]:
    """How often each sensor is read in a `solution` of a `problem`."""
    counts = np.sum(solution.arrays["weights"], axis=0)
    named = zip(problem.sensors.names, counts, strict=True)
    return ["", "readings", *[f"{style.shorten(name)}: {x:.4g}" for name, x in named if name != IDLE][:MOST_COUNTED]]

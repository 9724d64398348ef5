"""Pictures of a schedule of readings: who is read when, deviations, switching functions, convergence."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from occontrol.core.plant import state_names
from occontrol.core.sensor import IDLE
from occontrol.core.solution import Solution
from occontrol.families.athans.figures_compare import sizes
from occontrol.families.athans.readings.problem import ReadingsProblem
from occontrol.files.figures import style
from occontrol.files.figures.panels import convergence_panel, curves_panel, legend, map_panel

MOST_NAMED = 40  # sensors whose rows carry a name
WIDEST_LINEAR = 20.0  # largest switching function over the median before the axis is compressed


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
            "overview": _overview(problem, solution),
            "schedule": _one(problem, solution, _draw_schedule, 2.2 + 0.36 * min(len(problem.sensors), 30)),
            "deviations": _one(problem, solution, _draw_states, 6.0),
            "switching": _one(problem, solution, _draw_switching, 6.0),
        }
        figure = style.new_figure((12, 5.0), problem.name, _subtitle(problem, solution))
        if convergence_panel(figure.subplots(), solution.history, getattr(problem.method, "relative_gap", None)):
            figures["convergence"] = figure
        return figures


def _subtitle(problem: ReadingsProblem, solution: Solution) -> str:
    c = solution.certificate
    text = f"method {solution.method} · {sizes(problem)}"
    if c is None or not np.isfinite(c.lower_bound):
        return text
    return f"{text} · cost {c.cost:.7g}, proven bound {c.lower_bound:.7g}, gap {100 * c.relative_gap:.2g} %"


def _one(problem: ReadingsProblem, solution: Solution, draw_panel, height: float) -> Figure:
    figure = style.new_figure((12, min(10.0, height)), problem.name, _subtitle(problem, solution))
    draw_panel(figure.subplots(), problem, solution)
    return figure


def _axis(axes: Axes, problem: ReadingsProblem, label: bool) -> None:
    edges = problem.edges
    if problem.discrete:
        style.step_axis(axes, max(int(edges[-1]) - 1, 1), label)
    else:
        style.tidy_time_axis(axes, float(min(problem.clock.start, edges[0])), float(edges[-1]), label)


def _draw_schedule(axes: Axes, problem: ReadingsProblem, solution: Solution, label: bool = True) -> None:
    """A dot for every reading; pale bars where a sensor may be read."""
    names = [name for name in problem.sensors.names if name != IDLE]
    colours = dict(zip(problem.sensors.names, style.sensor_colours(problem.sensors.names), strict=True))
    times, weights = problem.clock.times, solution.arrays["weights"]
    axes.set_title("who is read when" + (" (grey: may be read)" if np.any(problem.upper == 0) else ""))
    size = float(np.clip(600 / max(len(times), 1), 6, 60))
    upper = problem.upper[problem.clock.owner]
    for row, name in enumerate(names):
        j = problem.sensors.names.index(name)
        place = len(names) - 1 - row
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
    axes.set_ylim(-0.7, len(names) - 0.3)
    if len(names) <= MOST_NAMED:
        axes.set_yticks(range(len(names)), [style.shorten(name) for name in reversed(names)])
    else:
        axes.set_yticks([])
        axes.set_ylabel(f"{len(names)} sensors, the first on top")
    _axis(axes, problem, label)


def _draw_states(axes: Axes, problem: ReadingsProblem, solution: Solution, label: bool = True) -> None:
    """Deviations just before and just after every reading, joined."""
    times = problem.clock.times
    prior = np.einsum("kii->ki", solution.arrays["prior_covariance"][:-1])
    after = np.einsum("kii->ki", solution.arrays["covariance"])
    names = state_names(problem.states)
    axes.set_title("standard deviation of the estimation error, before and after every reading")
    if problem.states <= style.MOST_LINES:
        both = np.sqrt(np.maximum(np.stack([prior, after], axis=1).reshape(2 * len(times), -1), 0.0))
        curves_panel(axes, np.repeat(times, 2), both, names, "deviation")
    else:
        deviation = np.sqrt(np.maximum(after, 0.0))
        largest = np.max(deviation, axis=0)
        relative = deviation / np.where(largest > 0, largest, 1.0)
        map_panel(axes, problem.edges, relative, names, "share of its largest")
    _axis(axes, problem, label)


def _draw_switching(axes: Axes, problem: ReadingsProblem, solution: Solution, label: bool = True) -> None:
    """What one more reading would change to first order; ringed where it is taken."""
    names = problem.sensors.names
    upper = problem.upper[problem.clock.owner]
    switching = np.where(upper > 0, solution.arrays["switching"], np.nan)
    if len(names) <= style.MOST_LINES:
        axes.set_title("switching functions: price of a reading less what it saves to first order (dots: read)")
        colours = style.sensor_colours(names)
        for j, name in enumerate(names):
            axes.plot(problem.clock.times, switching[:, j], color=colours[j], lw=0.8, label=style.shorten(name))
            used = solution.arrays["weights"][:, j] > 0.5
            axes.plot(problem.clock.times[used], switching[used, j], "o", ms=3.5, color=colours[j], clip_on=False)
        finite = np.abs(switching[np.isfinite(switching) & (switching != 0)])
        if len(finite) and np.max(finite) > WIDEST_LINEAR * np.median(finite):
            axes.set_yscale("symlog", linthresh=10.0 ** np.ceil(np.log10(np.median(finite))))
        axes.set_ylabel("cost of a reading")
        axes.grid(axis="y")
        legend(axes, len(names))
    else:
        axes.set_title("switching functions above the smallest (dark: to be read, white: not available)")
        above = switching - np.nanmin(switching, axis=1, keepdims=True)
        positive = above[above > 0]
        scale = float(np.median(positive)) if len(positive) else 1.0
        map_panel(axes, problem.edges, np.log10(1 + above / scale), names, "log₁₀(1 + distance/median)", log=False)
    _axis(axes, problem, label)


def _overview(problem: ReadingsProblem, solution: Solution) -> Figure:
    figure = style.new_figure(style.SLIDE, problem.name, f"method {solution.method} · {sizes(problem)}")
    grid = figure.add_gridspec(
        3, 2, width_ratios=[3.5, 1], height_ratios=[max(1.0, min(2.2, 0.16 * len(problem.sensors))), 1, 1]
    )
    _draw_schedule(figure.add_subplot(grid[0, 0]), problem, solution, label=False)
    _draw_states(figure.add_subplot(grid[1, 0]), problem, solution, label=False)
    _draw_switching(figure.add_subplot(grid[2, 0]), problem, solution)
    text = figure.add_subplot(grid[:2, 1])
    text.axis("off")
    text.text(0, 1, "certificate", fontweight="bold", fontsize=12, va="top")
    c, lines = solution.certificate, [f"status {solution.status}", "", "of all schedules of these readings"]
    lines.append(f"cost {solution.cost:.7g}")
    if c is not None and np.isfinite(c.lower_bound):
        lines += [f"proven bound {c.lower_bound:.7g}", f"gap {100 * c.relative_gap:.3g} %"]
    counts = np.sum(solution.arrays["weights"], axis=0)
    used = [f"{style.shorten(n)}: {x:.4g}" for n, x in zip(problem.sensors.names, counts, strict=True) if n != IDLE]
    lines += ["", "readings", *used[:10]]
    text.text(0, 0.94, "\n".join(lines), va="top", fontsize=11, linespacing=1.5)
    corner = figure.add_subplot(grid[2, 1])
    if convergence_panel(corner, solution.history, getattr(problem.method, "relative_gap", None)):
        corner.set_title("convergence")
    else:
        corner.axis("off")
    return figure

"""Pictures of a jumping-mode solution: where the target was and was thought to be, errors over time, modes, sensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from occontrol.core.errors import plural
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Solution
from occontrol.core.state_labels import state_labels
from occontrol.families.hybrid.problem import Problem
from occontrol.families.hybrid.result import numbers_of
from occontrol.families.hybrid.text import plus_minus
from occontrol.files.figures import style
from occontrol.files.figures.axes import name_rows, share_axis, value_axis
from occontrol.files.figures.panels import schedule_panel

MOST_MARKS = 60
WIDEST = 4  # a path that is wider than this many times its height has no equal axes
MODES_TITLE = "run 1: the more probable a mode the darker; line: the true mode"


def draw(problem: Problem, solution: Solution) -> dict[str, Figure]:
    """Every figure of one solution.

    Parameters
    ----------
    problem : Problem
    solution : Solution

    Returns overview, trajectory, rms, modes and sensors; all but rms show the first run.
    """
    with style.house_style():
        figures = {"overview": _overview(problem, solution)}
        for name, size, panel, title in (
            ("trajectory", (9, 6.5), trajectory_panel, "run 1: truth and estimate"),
            ("rms", (10, 4.5), rms_panel, _counted(solution)),
            ("modes", (10, 4.5), modes_panel, MODES_TITLE),
        ):
            figure = style.new_figure(size, problem.name, title)
            panel(figure.subplots(), problem, solution)
            figures[name] = figure
        figure = style.new_figure((10, 2.6 + 0.45 * min(len(problem.sensors), 12)), problem.name, _use_text(solution))
        upper, lower = figure.subplots(2, 1, sharex=True)
        sensors_panel(upper, problem, solution)
        use_panel(lower, problem, solution)
        upper.set_xlabel("")
        upper.tick_params(labelbottom=False)
        figures["sensors"] = figure
        return figures


def draw_compare(problem: Problem, solutions: Mapping[str, Solution]) -> Figure:
    """Errors over time of several methods, and their averages with standard errors.

    Parameters
    ----------
    problem : Problem
    solutions : Solution by method name
    """
    with style.house_style():
        runs = {numbers_of(s).runs for s in solutions.values()}
        text = f"{min(runs)} runs of {problem.steps} steps each; bars: one standard error"
        figure = style.new_figure((13.33, 6.5), problem.name, text)
        left, middle, right = figure.subplots(1, 3, width_ratios=[2.2, 1, 1])
        colours = [style.PALETTE[i % len(style.PALETTE)] for i in range(len(solutions))]
        for i, (name, solution) in enumerate(solutions.items()):
            # every other curve is dashed, so that one which coincides with its neighbour still shows
            dashes, label = ("-", "--")[i % 2], style.shorten(_label(name, solution))
            left.plot(
                solution.arrays["times"][1:],
                solution.arrays["rms"],
                dashes,
                color=colours[i],
                label=label,
                zorder=3 + i % 2,
            )
        left.set_title("RMS position error over time")
        left.set_ylabel("RMS position error")
        value_axis(left, np.concatenate([solution.arrays["rms"] for solution in solutions.values()]))
        left.grid(axis="y")
        left.legend(loc="lower center", bbox_to_anchor=(0.5, -0.28), ncols=3)
        style.dot_if_alone(left)
        style.step_axis(left, problem.steps)
        found = [numbers_of(solution) for solution in solutions.values()]
        averages = [(r.average_rms, r.average_rms_standard_error) for r in found]
        errors = [(r.mode_errors, r.mode_errors_standard_error) for r in found]
        _bars(middle, solutions, averages, "average RMS", colours, named=True)
        _bars(right, solutions, errors, "wrong-mode steps", colours, named=False)
        return figure


def _bars(
    axes: Axes,
    solutions: Mapping[str, Solution],
    numbers: Sequence[tuple[float, float]],
    title: str,
    colours: list[str],
    named: bool,
) -> None:
    """Bars of a number and its standard error, one of each solution."""
    places = np.arange(len(solutions))[::-1]
    values = np.array([value for value, _ in numbers])
    bars = np.array([float(e) if isinstance(e, int | float) and np.isfinite(e) else 0.0 for _, e in numbers])
    axes.barh(places, values, height=0.6, color=colours, xerr=bars, error_kw={"ecolor": style.INK, "elinewidth": 1.2})
    for place, value, bar in zip(places, values, bars, strict=True):
        axes.text(value + bar, place, f"  {value:.3g}", va="center", fontsize=10)
    labels = [style.shorten(_label(name, s)) for name, s in solutions.items()]
    axes.set_yticks(places, labels if named else [""] * len(places))
    axes.tick_params(axis="y", length=0)
    axes.set_xlim(0, float(np.max(values + bars)) * 1.3 or 1.0)
    axes.set_title(title)


def _label(name: str, solution: Solution) -> str:
    sensor = numbers_of(solution).sensor
    return f"{name}: {sensor}" if sensor and ":" not in name else name


def _overview(problem: Problem, solution: Solution) -> Figure:
    r = numbers_of(solution)
    text = f"{_label(solution.method, solution)}: average RMS {r.average_rms:.3g}"
    text += f"{plus_minus(r.average_rms_standard_error)}, mode errors {r.mode_errors:.3g}"
    text += f"{plus_minus(r.mode_errors_standard_error)} of {problem.steps} steps"
    figure = style.new_figure(style.SLIDE, problem.name, text)
    grid = figure.add_gridspec(3, 2, width_ratios=[1.1, 1.25], height_ratios=[1.15, 1, 0.35 + 0.18 * _rows(problem)])
    panels = [figure.add_subplot(place) for place in (grid[:, 0], grid[0, 1], grid[1, 1], grid[2, 1])]
    for panel, axes in zip((trajectory_panel, rms_panel, modes_panel, sensors_panel), panels, strict=True):
        panel(axes, problem, solution)
    panels[0].set_title("run 1: truth and estimate")
    panels[1].set_title(_counted(solution))
    panels[2].set_title(MODES_TITLE)
    panels[3].set_title("run 1: the sensors in use, and their share over all runs")
    for axes in panels[1:3]:
        axes.set_xlabel("")
        axes.tick_params(labelbottom=False)
    return figure


def _rows(problem: Problem) -> int:
    return min(len(problem.sensors), 8)


def _counted(solution: Solution) -> str:
    return f"RMS position error of {plural(numbers_of(solution).runs, 'run')}; band: two standard errors"


def _use_text(solution: Solution) -> str:
    use = numbers_of(solution).use
    names = dict(zip(use, style.labels(list(use)), strict=True))
    most = list(use) if len(use) <= 5 else sorted((n for n in use if use[n] > 0), key=lambda name: -use[name])[:4]
    text = ", ".join(f"{names[n]} {100 * use[n]:.3g} %" for n in use if n in most)
    return f"use over all runs: {text}" + (f", {len(use) - len(most)} others" if len(most) < len(use) else "")


def trajectory_panel(axes: Axes, problem: Problem, solution: Solution) -> None:
    """Truth and estimate of the first run: in the plane of two position components, otherwise over time.

    Parameters
    ----------
    axes : matplotlib Axes
    problem : Problem
    solution : Solution
    """
    truth, estimate, times = (solution.arrays[name] for name in ("truth", "estimate", "times"))
    position, names = list(problem.position or ()), state_labels(problem)
    if len(position) == 2:
        a, b = position
        axes.plot(truth[:, a], truth[:, b], color=style.INK, label="truth")
        axes.plot(estimate[:, a], estimate[:, b], color=style.SECOND, linewidth=1.2, label="estimate")
        gap = max(1, len(times) // MOST_MARKS)
        axes.plot(estimate[::gap, a], estimate[::gap, b], ".", color=style.SECOND, markersize=5)
        axes.plot(*truth[0, [a, b]], "o", color=style.INK, markersize=7)
        spans = np.ptp(np.concatenate([truth, estimate])[:, [a, b]], axis=0)
        if np.max(spans) <= WIDEST * np.min(spans):
            axes.set_aspect("equal", adjustable="datalim")
        right = truth[0, a] > np.mean([np.min(truth[:, a]), np.max(truth[:, a])])
        axes.annotate(
            "start", (truth[0, a], truth[0, b]), textcoords="offset points", xytext=(-7 if right else 7, 7),
            ha="right" if right else "left",
        )  # fmt: skip
        axes.set_xlabel(names[a])
        axes.set_ylabel(names[b])
        axes.grid(True)
        axes.legend(loc="best")
        return
    deviation = np.sqrt(np.maximum(np.diagonal(solution.arrays["covariance"], axis1=1, axis2=2), 0.0))
    for i, component in enumerate(position[: style.MOST_LINES]):
        colour, mean, sd = style.PALETTE[i], estimate[:, component], deviation[:, component]
        axes.fill_between(times, mean - 2 * sd, mean + 2 * sd, color=colour, alpha=0.18, linewidth=0)
        axes.plot(times, mean, color=colour, linewidth=1.2, label=f"{names[component]}, band: two standard deviations")
        axes.plot(times, truth[:, component], color=style.INK, linewidth=1.2, label="truth" if i == 0 else None)
    axes.legend(loc="best")
    axes.grid(axis="y")
    style.step_axis(axes, problem.steps)


def rms_panel(axes: Axes, problem: Problem, solution: Solution) -> None:
    """RMS position error over time, with a band of two standard errors.

    Parameters
    ----------
    axes : matplotlib Axes
    problem : Problem
    solution : Solution
    """
    steps, rms, error = solution.arrays["times"][1:], solution.arrays["rms"], solution.arrays["rms_standard_error"]
    axes.fill_between(steps, rms - 2 * error, rms + 2 * error, color=style.ACCENT, alpha=0.2, linewidth=0)
    axes.plot(steps, rms, color=style.ACCENT)
    if len(steps) == 1:
        axes.errorbar(steps, rms, 2 * error, color=style.ACCENT, capsize=4, clip_on=False)
    style.dot_if_alone(axes)
    average = numbers_of(solution).average_rms
    axes.axhline(average, color=style.GREY, linewidth=1, linestyle="--")
    axes.text(1.01, average, f"average\n{average:.3g}", transform=axes.get_yaxis_transform(), va="center", fontsize=10)
    value_axis(axes, np.concatenate([rms - 2 * error, rms + 2 * error]))
    axes.set_ylabel("RMS position error")
    axes.grid(axis="y")
    style.step_axis(axes, problem.steps)


def modes_panel(axes: Axes, problem: Problem, solution: Solution) -> None:
    """Mode probabilities of the first run as shades, one row per mode, and the true mode as a line through the rows.

    Parameters
    ----------
    axes : matplotlib Axes
    problem : Problem
    solution : Solution
    """
    chances, truth = solution.arrays["mode_probabilities"], solution.arrays["truth_mode"]
    names = problem.plant.names
    edges = np.arange(problem.steps + 2.0) - 0.5
    axes.pcolormesh(edges, np.arange(len(names) + 1) - 0.5, chances.T, cmap="Blues", vmin=0, vmax=1)
    axes.step(np.arange(problem.steps + 1), truth, where="mid", color=style.SECOND, linewidth=1.3)
    name_rows(axes, names)
    axes.invert_yaxis()
    style.step_axis(axes, problem.steps)


def sensors_panel(axes: Axes, problem: Problem, solution: Solution) -> None:
    """Which sensors the first run used, one row per sensor; at the right their share over all runs.

    Parameters
    ----------
    axes : matplotlib Axes
    problem : Problem
    solution : Solution
    """
    schedule = solution.schedule
    if schedule is None:
        schedule = Schedule(solution.arrays["edges"], solution.arrays["weights"], tuple(problem.sensors.names))
    use = numbers_of(solution).use
    schedule_panel(axes, schedule, shares=[f"{100 * use[name]:.3g} %" for name in schedule.names])
    style.step_axis(axes, problem.steps)


def use_panel(axes: Axes, problem: Problem, solution: Solution) -> None:
    """Share of the runs that use each sensor, over time.

    Parameters
    ----------
    axes : matplotlib Axes
    problem : Problem
    solution : Solution
    """
    use, steps = solution.arrays["use"], solution.arrays["times"][1:]
    names = style.labels(problem.sensors.names)
    colours, shown = style.sensor_colours(names), list(range(len(names)))
    if len(names) > style.MOST_LINES:  # the most used in colour, the others grey
        most = np.argsort(-use.mean(axis=0), kind="stable")[: style.MOST_LINES - 1].tolist()
        shown = sorted(j for j in most if np.any(use[:, j] > 0))
        palette = dict(zip(shown, style.PALETTE, strict=False))
        colours = [palette.get(j, style.GREY) for j in range(len(names))]
    for j, (name, colour) in enumerate(zip(names, colours, strict=True)):
        known = j in shown
        axes.plot(steps, use[:, j], color=colour, linewidth=1.2, label=name if known else None, zorder=2 + known)
    if len(shown) < len(names):
        axes.plot([], [], color=style.GREY, linewidth=1.2, label=f"{len(names) - len(shown)} others")
    style.dot_if_alone(axes)
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.03), handlelength=1.2)
    share_axis(axes)
    axes.set_ylabel("share of runs")
    axes.grid(axis="y")
    style.step_axis(axes, problem.steps)

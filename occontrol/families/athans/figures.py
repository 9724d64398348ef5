"""Pictures of a schedule in continuous time: overview, schedule, deviations, switching functions, convergence."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from occontrol.core.schedule import Schedule
from occontrol.core.solution import Solution
from occontrol.core.state_labels import state_labels
from occontrol.families.athans.discretise import half_predicts
from occontrol.families.athans.figures_compare import draw_compare
from occontrol.families.athans.overview import compress, convergence, overview, subtitle
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.files.figures import style
from occontrol.files.figures.axes import alike, together
from occontrol.files.figures.panels import curves_panel, legend, map_panel, schedule_panel
from occontrol.files.page.thin import runs
from occontrol.files.page.usual import column_edges, deviations
from occontrol.numerics.transition import transitions

__all__ = ["draw", "draw_compare"]


def draw(problem: SchedulingProblem, solution: Solution) -> dict[str, Figure]:
    """Every figure of one solution.

    Parameters
    ----------
    problem : SchedulingProblem
    solution : Solution with a schedule

    Returns overview, schedule, deviations, switching and, for iterative methods, convergence.
    """
    with style.house_style():
        figures = {
            "overview": overview(
                problem, solution, (draw_schedule, _draw_states, _draw_switching), switches_of(solution)
            ),
            "schedule": _schedule(problem, solution),
            "deviations": _deviations(problem, solution),
            "switching": _switching(problem, solution),
        }
        if problem.ruled and "measuring" in solution.arrays and solution.schedule is not None:
            from occontrol.families.athans.rules.figures import draw_rules

            if solution.schedule.is_integer or problem.slews:
                figures["rules"] = draw_rules(problem, solution)
        last = convergence(problem, solution)
        return figures if last is None else {**figures, "convergence": last}


def output_deviation(problem: SchedulingProblem, covariance: np.ndarray) -> np.ndarray:
    """Standard deviation of the error of the prediction of w = D x(Tp) made at each node.

    cov = D [Phi(Tp,t) Sigma(t) Phi(Tp,t)' + int_t^Tp Phi Xi Phi' ds] D'

    Parameters
    ----------
    problem : SchedulingProblem
    covariance : (N+1, n, n) at the nodes

    Returns (N+1, p). Athans (1971), equation (3.12) with the plant noise between t and Tp.
    """
    halves, at = half_predicts(problem), float(problem.predict_at or 0.0)
    F, Q = halves.transition[halves.index], halves.noise[halves.index]
    last, noise = transitions(problem.plant.A, problem.plant.noise, problem.edges[-1:], np.array([at]))
    D = problem.output.at(at)
    row, variance = D @ last[0], np.einsum("pi,ij,pj->p", D, noise[0], D)
    result = np.empty((len(covariance), len(D)))
    for k in range(len(covariance) - 1, -1, -1):
        result[k] = np.sqrt(np.maximum(np.einsum("pi,ij,pj->p", row, covariance[k], row) + variance, 0.0))
        for half in (2 * k - 1, 2 * k - 2) if k else ():
            variance = variance + np.einsum("pi,ij,pj->p", row, Q[half], row)
            row = row @ F[half]
    return result


def _windows(problem: SchedulingProblem, schedule: Schedule) -> np.ndarray | None:
    """Which sensor may be used when; None when every one always may."""
    available = problem.upper > 0
    return None if np.all(available) or len(available) != len(schedule.weights) else available


def draw_schedule(axes: Axes, problem: SchedulingProblem, solution: Solution, label: bool = True) -> None:
    """Who measures when, and inside which windows.

    Parameters
    ----------
    axes : Axes
    problem : SchedulingProblem
    solution : Solution with a schedule
    label : whether the axis of time is labelled
    """
    schedule = solution.schedule
    if schedule is None:
        return
    windows = _windows(problem, schedule)
    title = "who measures when"
    if windows is not None:
        title += " (pale: inside a window)"
    if not schedule.is_integer:
        title += "; height: share of the time"
    axes.set_title(title)
    schedule_panel(axes, schedule, windows)
    style.tidy_time_axis(axes, problem.edges[0], problem.edges[-1], label)


def _draw_states(axes: Axes, problem: SchedulingProblem, solution: Solution, label: bool = True) -> None:
    times, values = solution.arrays["times"], deviations(solution.arrays["covariance"])
    names = state_labels(problem)
    axes.set_title("standard deviation of the estimation error")
    if problem.states <= style.MOST_LINES:
        curves_panel(axes, times, values, names, "deviation")
    else:
        map_panel(axes, column_edges(times, len(times)), values, names, "deviation", ends=True)
    style.tidy_time_axis(axes, problem.edges[0], problem.edges[-1], label)


def predicts(problem: SchedulingProblem, solution: Solution) -> bool:
    """Whether there is a prediction to draw: an output of which something is not known.

    Parameters
    ----------
    problem : SchedulingProblem
    solution : Solution
    """
    return bool(np.any(output_deviation(problem, solution.arrays["covariance"]) > 0))


def _draw_output(axes: Axes, problem: SchedulingProblem, solution: Solution, label: bool = True) -> None:
    times = solution.arrays["times"]
    deviation = output_deviation(problem, solution.arrays["covariance"])
    names = [f"w{i + 1}" for i in range(deviation.shape[1])]
    axes.set_title(f"standard deviation of the prediction for t = {problem.predict_at:g}, made at time t")
    if len(names) <= style.MOST_LINES:
        curves_panel(axes, times, deviation, names, "deviation")
    else:
        map_panel(axes, column_edges(times, len(times)), deviation, names, "deviation", ends=True)
    style.tidy_time_axis(axes, problem.edges[0], problem.edges[-1], label)


def _draw_switching(axes: Axes, problem: SchedulingProblem, solution: Solution, label: bool = True) -> None:
    switching = np.where(problem.upper > 0, solution.arrays["switching"], np.nan)
    names, edges, schedule = problem.sensors.names, problem.edges, solution.schedule
    used = None if schedule is None or schedule.weights.shape != switching.shape else schedule.weights > 1e-3
    if len(names) <= style.MOST_LINES:
        axes.set_title(_switching_title(switching, used))
        colours = style.sensor_colours(names)
        for group in alike(switching, log=False):
            for j in group:
                line = np.append(switching[:, j], switching[-1, j])
                text = together(names, group) if j == group[0] else None
                axes.step(edges, line, where="post", color=colours[group[0]], linewidth=1.0, label=text)
                if used is not None:
                    thick = np.where(used[:, j], switching[:, j], np.nan)
                    thick = np.append(thick, thick[-1])
                    axes.step(edges, thick, where="post", color=colours[group[0]], linewidth=3.2, alpha=0.8)
        compress(axes, switching)
        axes.set_ylabel("cost / time")
        axes.grid(axis="y")
        legend(axes, len(names))
    else:
        axes.set_title("switching functions above the smallest (line: in use)")
        smallest = np.min(np.where(np.isfinite(switching), switching, np.inf), axis=1, keepdims=True)
        map_panel(axes, edges, switching - smallest, names, "cost / time")
        for j, first, last in () if used is None else runs(used):
            axes.hlines(np.full(len(first), j), edges[first], edges[last], color=style.SECOND, linewidth=1.6)
    style.tidy_time_axis(axes, edges[0], edges[-1], label)


def _switching_title(switching: np.ndarray, used: np.ndarray | None) -> str:
    """What the picture shows; that the smallest measures only as far as it is true of this schedule."""
    if used is None:
        return "switching functions"
    usable = np.isfinite(switching)
    largest = np.max(np.where(used & usable, switching, -np.inf), axis=1)
    smallest = np.min(np.where(~used & usable, switching, np.inf), axis=1)
    rounding = 1e-9 * float(np.max(np.abs(switching[usable]), initial=0.0))
    above = float(np.max((largest - smallest)[np.isfinite(largest - smallest)], initial=0.0))
    if above <= rounding:
        return "switching functions (thick: in use, always the smallest)"
    return f"switching functions (thick: in use, at most {above:.2g} above the smallest)"


def _schedule(problem: SchedulingProblem, solution: Solution) -> Figure:
    rows = min(len(problem.sensors), 40)
    figure = style.new_figure((12, min(9.0, 2.2 + 0.36 * rows)), problem.name, subtitle(problem, solution))
    draw_schedule(figure.subplots(), problem, solution)
    return figure


def _deviations(problem: SchedulingProblem, solution: Solution) -> Figure:
    height = 3.2 + style.rows_height(problem.states)
    if not predicts(problem, solution):
        figure = style.new_figure((12, height), problem.name, subtitle(problem, solution))
        _draw_states(figure.subplots(), problem, solution)
        return figure
    outputs = 3.2 + style.rows_height(problem.output.shape[0])
    figure = style.new_figure((12, height + outputs), problem.name, subtitle(problem, solution))
    upper, lower = figure.subplots(2, 1, height_ratios=[height, outputs])
    _draw_states(upper, problem, solution, label=False)
    _draw_output(lower, problem, solution)
    return figure


def _switching(problem: SchedulingProblem, solution: Solution) -> Figure:
    height = 6 + style.rows_height(len(problem.sensors))
    figure = style.new_figure((12, height), problem.name, subtitle(problem, solution))
    _draw_switching(figure.subplots(), problem, solution)
    return figure


def switches_of(solution: Solution) -> list[str]:
    """Lines on the switches of a `solution` for its overview."""
    schedule = solution.schedule
    if schedule is None:
        return []
    count = getattr(solution.numbers, "switches", schedule.switches)  # rules do not count slewing as a change
    lines = ["", f"{count} switch{'es' * (count != 1)}"]
    if schedule.singular_fraction:
        lines += [f"singular {100 * schedule.singular_fraction:.3g} % of the time"]
    return lines

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
from occontrol.files.figures.panels import (
    curves_panel,
    legend,
    map_panel,
    schedule_panel,
)
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
                problem, solution, (_draw_schedule, _draw_states, _draw_switching), _switches(solution)
            ),
            "schedule": _schedule(problem, solution),
            "deviations": _deviations(problem, solution),
            "switching": _switching(problem, solution),
        }
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


def _draw_schedule(axes: Axes, problem: SchedulingProblem, solution: Solution, label: bool = True) -> None:
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
    times, covariance = solution.arrays["times"], solution.arrays["covariance"]
    deviation = np.sqrt(np.maximum(np.einsum("kii->ki", covariance), 0.0))
    names = state_labels(problem)
    axes.set_title("standard deviation of the estimation error")
    if problem.states <= style.MOST_LINES:
        curves_panel(axes, times, deviation, names, "deviation")
    else:
        largest = np.max(deviation, axis=0)
        relative = deviation / np.where(largest > 0, largest, 1.0)
        middles = np.concatenate([times[:1], (times[1:] + times[:-1]) / 2, times[-1:]])
        map_panel(axes, middles, relative, names, "share of its largest")
    style.tidy_time_axis(axes, problem.edges[0], problem.edges[-1], label)


def _draw_output(axes: Axes, problem: SchedulingProblem, solution: Solution, label: bool = True) -> None:
    times = solution.arrays["times"]
    deviation = output_deviation(problem, solution.arrays["covariance"])
    p = deviation.shape[1]
    shown = np.sort(np.argsort(-deviation[-1])[: style.MOST_LINES])
    axes.set_title(f"standard deviation of the prediction for t = {problem.predict_at:g}, made at time t")
    if p > len(shown):
        axes.set_title(f"{axes.get_title(loc='left')} (the {len(shown)} largest of {p})")
    curves_panel(axes, times, deviation[:, shown], [f"w{i + 1}" for i in shown], "deviation")
    style.tidy_time_axis(axes, problem.edges[0], problem.edges[-1], label)


def _draw_switching(axes: Axes, problem: SchedulingProblem, solution: Solution, label: bool = True) -> None:
    switching = np.where(problem.upper > 0, solution.arrays["switching"], np.nan)
    names, edges = problem.sensors.names, problem.edges
    if len(names) <= style.MOST_LINES:
        axes.set_title(_switching_title(solution, switching))
        colours = style.sensor_colours(names)
        for j, name in enumerate(names):
            line = np.append(switching[:, j], switching[-1, j])
            axes.step(edges, line, where="post", color=colours[j], linewidth=1.0, label=style.shorten(name))
            if solution.schedule is not None:
                used = np.where(solution.schedule.weights[:, j] > 1e-3, switching[:, j], np.nan)
                axes.step(edges, np.append(used, used[-1]), where="post", color=colours[j], linewidth=3.2, alpha=0.8)
        compress(axes, switching)
        axes.set_ylabel("cost / time")
        axes.grid(axis="y")
        legend(axes, len(names))
    else:
        axes.set_title("switching functions above the smallest (dark: to be used, white: not available)")
        smallest = np.min(np.where(np.isfinite(switching), switching, np.inf), axis=1, keepdims=True)
        above = switching - smallest
        positive = above[above > 0]  # not-a-number compares as false
        scale = float(np.median(positive)) if len(positive) else 1.0
        map_panel(axes, edges, np.log10(1 + above / scale), names, "log₁₀(1 + distance/median)", log=False)
    style.tidy_time_axis(axes, edges[0], edges[-1], label)


def _switching_title(solution: Solution, switching: np.ndarray) -> str:
    """What the picture shows: that the smallest measures is true but on singular arcs, and where a gap is left."""
    schedule = solution.schedule
    if schedule is None or schedule.weights.shape != switching.shape:
        return "switching functions"
    used, usable = schedule.weights > 1e-3, np.isfinite(switching)
    largest = np.max(np.where(used & usable, switching, -np.inf), axis=1)
    smallest = np.min(np.where(~used & usable, switching, np.inf), axis=1)
    lengths = np.diff(schedule.edges)
    share = float(np.sum(lengths[largest > smallest]) / np.sum(lengths))
    if share == 0:
        return "switching functions: the smallest measures (thick: in use)"
    return f"switching functions (thick: in use, the smallest but for {100 * share:.2g} % of the time)"


def _schedule(problem: SchedulingProblem, solution: Solution) -> Figure:
    rows = min(len(problem.sensors), 40)
    figure = style.new_figure((12, min(9.0, 2.2 + 0.36 * rows)), problem.name, subtitle(problem, solution))
    _draw_schedule(figure.subplots(), problem, solution)
    return figure


def _deviations(problem: SchedulingProblem, solution: Solution) -> Figure:
    figure = style.new_figure((12, 7), problem.name, subtitle(problem, solution))
    upper, lower = figure.subplots(2, 1)
    _draw_states(upper, problem, solution, label=False)
    _draw_output(lower, problem, solution)
    return figure


def _switching(problem: SchedulingProblem, solution: Solution) -> Figure:
    figure = style.new_figure((12, 6), problem.name, subtitle(problem, solution))
    _draw_switching(figure.subplots(), problem, solution)
    return figure


def _switches(solution: Solution) -> list[str]:
    schedule = solution.schedule
    if schedule is None:
        return []
    lines = ["", f"{schedule.switches} switch{'es' * (schedule.switches != 1)}"]
    if schedule.singular_fraction:
        lines += [f"singular {100 * schedule.singular_fraction:.3g} % of the time"]
    return lines

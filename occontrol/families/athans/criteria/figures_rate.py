"""Pictures of continuous sensing without a prior: who measures when, what it tells, and what is known from when on."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from occontrol.core.sensor import IDLE
from occontrol.core.solution import Solution
from occontrol.core.state_labels import state_names
from occontrol.families.athans.figures import draw_schedule, switches_of
from occontrol.families.athans.overview import convergence, overview, subtitle
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.files.figures import style
from occontrol.files.figures.panels import curves_panel, legend

USED = 1e-3  # of the time


def draw_rate_design(problem: SchedulingProblem, solution: Solution) -> dict[str, Figure]:
    """Every figure of one solution without a prior.

    Parameters
    ----------
    problem : without a prior
    solution : with a schedule

    Returns overview, schedule, sensitivity, deviations, with rules their budgets, and convergence where there is any.
    """
    with style.house_style():
        panels = (draw_schedule, _draw_deviations, _draw_sensitivity)
        figures = {
            "overview": overview(problem, solution, panels, switches_of(solution)),
            "schedule": _one(problem, solution, draw_schedule, 2.2 + 0.36 * min(len(problem.sensors), 20)),
            "sensitivity": _one(problem, solution, _draw_sensitivity),
            "deviations": _one(problem, solution, _draw_deviations),
        }
        if problem.ruled and solution.schedule is not None and (solution.schedule.is_integer or problem.slews):
            from occontrol.families.athans.rules.figures import draw_rules

            figures["rules"] = draw_rules(problem, solution)
        last = convergence(problem, solution)
        return figures if last is None else {**figures, "convergence": last}


def _one(problem: SchedulingProblem, solution: Solution, panel: Callable[..., None], height: float = 6.0) -> Figure:
    figure = style.new_figure((12, height), problem.name, subtitle(problem, solution))
    panel(figure.subplots(), problem, solution)
    return figure


def _draw_sensitivity(axes: Axes, problem: SchedulingProblem, solution: Solution, label: bool = True) -> None:
    """The sensitivity function of design theory: what a sensor in use saves, to first order; thick where it is used."""
    arrays, edges, names = solution.arrays, problem.edges, problem.sensors.names
    best = "relaxed_switching" in arrays
    saved = -arrays["relaxed_switching" if best else "switching"]
    saved = np.where(problem.upper > 0, saved, np.nan)
    colours, used = style.sensor_colours(names), arrays["weights"] > USED
    real = [j for j, name in enumerate(names) if name != IDLE]
    for j in real:
        # of a whole interval: a step
        line, thick = (np.append(x, x[-1]) for x in (saved[:, j], np.where(used[:, j], saved[:, j], np.nan)))
        axes.step(edges, line, where="post", color=colours[j], lw=1.0, label=style.shorten(names[j]))
        axes.step(edges, thick, where="post", color=colours[j], lw=3.2, alpha=0.8)
    axes.set_title("sensitivity: what a sensor saves" + (" at the best shares" if best else "") + " (thick: in use)")
    axes.set_ylabel("saving / time")
    axes.grid(axis="y")
    legend(axes, len(real))
    style.tidy_time_axis(axes, edges[0], edges[-1], label)


def _draw_deviations(axes: Axes, problem: SchedulingProblem, solution: Solution, label: bool = True) -> None:
    """Deviations at the edges, from where all states are determined."""
    variances = np.einsum("kii->ki", solution.arrays["covariance"])
    axes.set_title("standard deviation, from where all states are determined")
    known = np.isfinite(variances[:, 0])
    if np.any(known) and problem.states <= style.MOST_LINES:
        deviations = np.sqrt(np.maximum(variances[known], 0.0))
        curves_panel(axes, problem.edges[known], deviations, state_names(problem), "deviation")
        axes.set_yscale("log")
    style.tidy_time_axis(axes, problem.edges[0], problem.edges[-1], label)

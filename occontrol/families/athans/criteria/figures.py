"""Pictures of an experiment without a prior: what every reading tells, which are chosen, what is known after each."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from occontrol.core.sensor import IDLE
from occontrol.core.solution import Solution
from occontrol.core.state_labels import state_names
from occontrol.families.athans.overview import convergence, overview, subtitle
from occontrol.families.athans.readings.figures import counts_of, draw_schedule, time_axis
from occontrol.families.athans.readings.problem import ReadingsProblem
from occontrol.files.figures import style
from occontrol.files.figures.panels import curves_panel, legend

USED = 1e-6
SHARED = 1e-2  # a share of the best shares that sets the threshold
FEW = 60  # readings that are marked one by one


def draw_design(problem: ReadingsProblem, solution: Solution) -> dict[str, Figure]:
    """Every figure of one solution without a prior.

    Parameters
    ----------
    problem : without a prior
    solution : with a schedule

    Returns overview, schedule, sensitivity, deviations and, for iterative methods, convergence.
    """
    with style.house_style():
        panels = (draw_schedule, _draw_deviations, _draw_sensitivity)
        figures = {
            "overview": overview(problem, solution, panels, counts_of(problem, solution)),
            "sensitivity": _one(problem, solution, _draw_sensitivity),
            "deviations": _one(problem, solution, _draw_deviations),
        }
        last = convergence(problem, solution)
        return figures if last is None else {**figures, "convergence": last}


def _one(problem: ReadingsProblem, solution: Solution, panel: Callable[..., None]) -> Figure:
    figure = style.new_figure((12, 6.0), problem.name, subtitle(problem, solution))
    panel(figure.subplots(), problem, solution)
    return figure


def _draw_sensitivity(axes: Axes, problem: ReadingsProblem, solution: Solution, label: bool = True) -> None:
    """The sensitivity function of design theory: what a reading saves to first order; dots where it is chosen."""
    arrays, times = solution.arrays, problem.clock.times
    shared = "relaxed_switching" in arrays
    switching = arrays["relaxed_switching" if shared else "switching"]
    names = problem.sensors.names
    idle = names.index(IDLE) if IDLE in names else None
    real = [j for j, name in enumerate(names) if name != IDLE]
    colours = style.sensor_colours(names)
    upper = problem.upper[problem.clock.owner]
    for j in real:
        saved = -switching[:, j] + (switching[:, idle] if idle is not None else 0.0)
        saved = np.where(upper[:, j] > 0, saved, np.nan)
        dots = "." if len(times) <= FEW else None
        axes.plot(times, saved, color=colours[j], lw=1.0, marker=dots, ms=4, label=style.shorten(names[j]))
        used = arrays["weights"][:, j] > USED
        size = 40 * np.clip(arrays["weights"][used, j], 0.1, 1.0) if np.sum(used) <= FEW else 6.0
        axes.scatter(times[used], saved[used], s=size, color=colours[j], zorder=3, clip_on=False)
        if shared and names[j] in (problem.budget or {}):  # its own number of readings has its own threshold
            part = arrays["relaxed_weights"][:, j] > SHARED
            if np.any(part):
                axes.axhline(np.min(saved[part]), color=colours[j], linestyle="--", linewidth=1)
    check = solution.numbers.extra.get("equivalence") or {}
    if "used_save_at_least" in check and "total" in (problem.budget or {}):
        axes.axhline(check["used_save_at_least"], color=style.GREY, linestyle="--", linewidth=1)
    axes.set_title(
        "sensitivity: what a reading saves at the best shares (dots: chosen)"
    )
    axes.set_ylabel("saving of a reading")
    axes.grid(axis="y")
    legend(axes, len(real))
    time_axis(axes, problem, label)


def _draw_deviations(axes: Axes, problem: ReadingsProblem, solution: Solution, label: bool = True) -> None:
    """Deviations after every reading, from where all states are determined."""
    variances = np.einsum("kii->ki", solution.arrays["covariance"])
    axes.set_title("standard deviation after every reading, from where all states are determined")
    known = np.isfinite(variances[:, 0])
    if np.any(known) and problem.states <= style.MOST_LINES:
        deviations = np.sqrt(np.maximum(variances[known], 0.0))
        curves_panel(axes, problem.clock.times[known], deviations, state_names(problem), "deviation")
        axes.set_yscale("log")
    time_axis(axes, problem, label)

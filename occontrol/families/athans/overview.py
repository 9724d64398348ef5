"""What the pictures of both kinds of problems share: the overview, the certificate in words, convergence."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from occontrol.core.printed import rounded_down
from occontrol.core.solution import Solution, gap_words
from occontrol.families.athans.base import AthansProblem
from occontrol.families.athans.figures_compare import sizes
from occontrol.families.athans.nonlinear.linearise import linearisation_of
from occontrol.files.figures import style
from occontrol.files.figures.convergence import convergence_panel, history_columns
from occontrol.files.figures.panels import MOST_ROWS

Panel = Callable[[Axes, Any, Solution, bool], None]
HOLDS_FOR = {
    "continuous": "whenever it switches",
    "grid": "with changes at these edges",
    "problem": "for every schedule",
}
MOST_LINES = 17  # beside the panels, above the picture of convergence
MOST_ON_SLIDE = 4.0  # heights of all panels, in the least that one has, before the overview grows
WIDEST_LINEAR = 20.0  # the largest switching function may be this many times the median before the axis is compressed


def subtitle(problem: AthansProblem, solution: Solution) -> str:
    """Method, sizes and the pair at the top in one line, for a `solution` of a `problem`."""
    text = f"method {solution.method} · {sizes(problem)}"
    c = solution.numbers.top or solution.certificate
    if c is None or not np.isfinite(c.lower_bound):
        return f"{text} · cost {solution.cost:.7g}"
    of = ", linearised" if linearisation_of(problem) is not None else ""
    pair = f"cost {c.cost:.7g}, proven bound {rounded_down(c.lower_bound, 7)}"
    return f"{text} · {pair}, {gap_words(c.relative_gap, problem.logarithmic, 2)}{of}"


def _target(problem: AthansProblem) -> float | None:
    return getattr(problem.method, "relative_gap", None)


def convergence(problem: AthansProblem, solution: Solution) -> Figure | None:
    """Cost from above and bound from below over the iterations of a `solution` of a `problem`; None without any."""
    figure = style.new_figure((12, 5.5), problem.name, subtitle(problem, solution))
    left, right = figure.subplots(1, 2)
    if not convergence_panel(right, solution.history, _target(problem), problem.logarithmic):
        return None
    right.set_title("gap between best cost and best bound")
    cost, bound = history_columns(solution.history)
    steps = np.arange(1, len(cost) + 1)
    left.plot(steps, cost, color=style.ACCENT, label="cost")
    left.plot(steps, bound, color=style.SECOND, label="lower bound")
    # early bounds can be far below; the picture is about where the two meet
    low, high = (
        np.nanmax(np.where(np.isfinite(bound), bound, -np.inf)),
        np.nanmax(np.where(np.isfinite(cost), cost, np.nan)),
    )
    least = np.nanmin(cost)
    room = max(high - low, 1e-6 * abs(least))
    left.set_ylim(
        max(np.nanmin(np.where(np.isfinite(bound), bound, low)), low - 2 * room) - 0.05 * room, high + 0.05 * room
    )
    left.set_title("cost from above, bound from below")
    left.xaxis.set_major_locator(MaxNLocator(5, integer=True, min_n_ticks=1))
    left.set_xlabel("iteration")
    left.set_ylabel("cost")
    left.grid(axis="y")
    left.legend()
    return figure


def overview(problem: AthansProblem, solution: Solution, panels: Sequence[Panel], further: Sequence[str]) -> Figure:
    """Three panels over one axis of time, the certificate in words beside them, and how it was reached.

    Parameters
    ----------
    problem : of either kind
    solution : of the problem
    panels : draw(axes, problem, solution, label) of schedule, deviations and switching functions
    further : lines below the certificate
    """
    rows = (min(len(problem.sensors), MOST_ROWS), problem.states, len(problem.sensors))
    heights = [max(1.0, min(2.2, 0.16 * rows[0])), *(1.0 + 0.4 * style.rows_height(n) for n in rows[1:])]
    size = style.SLIDE[0], style.SLIDE[1] * max(1.0, sum(heights) / MOST_ON_SLIDE)
    figure = style.new_figure(size, problem.name, f"method {solution.method} · {sizes(problem)}")
    grid = figure.add_gridspec(3, 2, width_ratios=[3.5, 1], height_ratios=heights)
    for i, panel in enumerate(panels):
        panel(figure.add_subplot(grid[i, 0]), problem, solution, i == len(panels) - 1)
    text = figure.add_subplot(grid[:2, 1])
    text.axis("off")
    text.text(0, 1, "certificate", fontweight="bold", fontsize=12, va="top")
    lines = [*_certificate_lines(solution), *further]
    if len(lines) > MOST_LINES:
        lines = [*lines[: MOST_LINES - 1], f"and {len(lines) - MOST_LINES + 1} more"]
    small = len(lines) > 13  # the picture of convergence begins below
    text.text(0, 0.94, "\n".join(lines), va="top", fontsize=9 if small else 11, linespacing=1.3 if small else 1.5)
    corner = figure.add_subplot(grid[2, 1])
    if convergence_panel(corner, solution.history, _target(problem), problem.logarithmic):
        corner.set_title("convergence")
    else:
        corner.axis("off")
    return figure


def _certificate_lines(solution: Solution) -> list[str]:
    """Status and the pair at the top with what it holds for; the grid's beside one in continuous time."""
    c, top = solution.certificate, solution.numbers.top
    lines = [f"status {solution.status}"]
    if linearisation_of(solution.problem) is not None:
        lines.append("of the linearised problem")
    if top is not None:
        lines += ["", HOLDS_FOR[top.of], *_pair(top.cost, top.lower_bound, top.relative_gap, top.absolute)]
    if top is None or top.of == "continuous":
        bound, gap = (c.lower_bound, c.relative_gap) if c is not None else (-np.inf, np.inf)
        lines += ["", HOLDS_FOR["grid"], *_pair(solution.cost, bound, gap, c is not None and c.absolute)]
    return lines


def _pair(cost: float, bound: float, gap: float, absolute: bool = False) -> list[str]:
    lines = [f"cost {cost:.7g}"]
    return [*lines, f"proven bound {rounded_down(bound, 7)}", gap_words(gap, absolute)] if np.isfinite(bound) else lines


def compress(axes: Axes, values: np.ndarray) -> None:
    """A vertical axis that is linear up to a power of ten where a few of `values` (N, M) would flatten all others."""
    finite = np.abs(values[np.isfinite(values) & (values != 0)])
    if len(finite) and np.max(finite) > WIDEST_LINEAR * np.median(finite):
        # so that its ticks keep clear of the zero
        axes.set_yscale("symlog", linthresh=10.0 ** np.ceil(np.log10(np.median(finite))))

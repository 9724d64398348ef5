"""Pictures of the precision family: who measures how precisely, and how the posterior lies within its bound."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from occontrol.core.kinds import PlainDict
from occontrol.core.printed import rounded_down
from occontrol.core.solution import Solution
from occontrol.core.state_labels import default_names, state_names
from occontrol.families.precision.problem import Problem
from occontrol.families.precision.result import BatchRecord, PrecisionResult, PruningRecord, numbers_of
from occontrol.files.figures.axes import name_rows, value_axis
from occontrol.files.figures.style import (
    ACCENT,
    GREY,
    INK,
    PALETTE,
    SECOND,
    SLIDE,
    house_style,
    new_figure,
    shorten,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_LABELS = 60


def draw(problem: Problem, solution: Solution) -> dict[str, Figure]:
    """The overview, and where there are any: the batches of a sequence and the price of pruning.

    Parameters
    ----------
    problem : Problem of the family precision
    solution : Solution
    """
    if "precisions" not in solution.arrays:
        return {}
    numbers = numbers_of(solution)
    with house_style():
        figures = {"overview": _overview(problem, solution, numbers)}
        if numbers.batches is not None and len(solution.arrays["precisions"]) > 1:
            figures["sequence"] = _sequence(problem, solution, numbers.batches)
        if numbers.pruning is not None and len(numbers.pruning.removals) > 1:
            figures["pruning"] = _pruning(problem, numbers.pruning)
    return figures


def draw_compare(problem: Problem, solutions: Mapping[str, Solution]) -> Figure:
    """The precisions of several methods side by side.

    Parameters
    ----------
    problem : Problem of the family precision
    solutions : Solution by method name
    """
    with house_style():
        usable = {name: s for name, s in solutions.items() if "precisions" in s.arrays}
        figure = new_figure(SLIDE, problem.name, "precision of every measurement, by method (first batch)")
        axes = figure.add_subplot()
        labels = problem.labels()
        width = 0.8 / max(1, len(usable))
        for j, (name, solution) in enumerate(usable.items()):
            values = solution.arrays["precisions"][0]
            text = f"{name}: objective {numbers_of(solution).objective:.6g}"
            axes.bar(np.arange(len(values)) + (j + 0.5) * width - 0.4, values, width, color=PALETTE[j], label=text)
        _name_measurements(axes, labels)
        axes.set_ylabel("precision λ = 1 / noise variance")
        axes.set_yscale(_scale(np.concatenate([s.arrays["precisions"][0] for s in usable.values()] or [np.ones(1)])))
        if usable:
            axes.legend(loc="lower right", bbox_to_anchor=(1, 1.0), ncols=4)
        else:
            axes.annotate("no method met the bound", (0.5, 0.5), xycoords="axes fraction", ha="center", color=GREY)
    return figure


def _scale(values: np.ndarray) -> str:
    positive = values[values > 0]
    return "log" if len(positive) and positive.max() > 1e3 * np.median(positive) else "linear"


def _name_columns(axes: Axes, names: Sequence[str], places: np.ndarray) -> None:
    """Every column by its name, the smaller the more there are; of very many every few."""
    step = -(-len(names) // MOST_LABELS)
    size = 10.0 if len(names) <= 15 else max(6.0, 10.0 - 0.08 * len(names))
    upright = len(names) > 15 or max(map(len, names)) > 4
    axes.set_xticks(places[::step], [shorten(t, 14) for t in names[::step]], fontsize=size)
    axes.tick_params(axis="x", labelrotation=90 if len(names) > 15 else 30 if upright else 0)


def _name_measurements(axes: Axes, labels: list[str]) -> None:
    _name_columns(axes, labels, np.arange(len(labels)))
    axes.set_xlim(-0.6, len(labels) - 0.4)


def _overview(problem: Problem, solution: Solution, numbers: PrecisionResult) -> Figure:
    text = (
        f"objective {numbers.objective:.6g}, proven bound {rounded_down(numbers.lower_bound, 6)}; "
        f"{numbers.active} of {solution.arrays['precisions'].size} measurements are used"
    )
    figure = new_figure(SLIDE, problem.name, text)
    left, right = figure.subplots(1, 2, gridspec_kw={"width_ratios": [1.35, 1]})
    grid = solution.arrays["precisions"].reshape(-1, problem.sensor_count)
    priced = len(set(problem.prices)) > 1  # sensors in different units cannot be compared otherwise
    if priced and len(grid) > 1:
        grid = grid * problem.prices[: problem.sensor_count]
    if len(grid) == 1:
        _bars(left, problem, grid[0])
    else:
        _map(left, problem, grid, "price × precision" if priced else "precision λ")
    _deviations(right, problem, solution)
    return figure


def _bars(axes: Axes, problem: Problem, precisions: np.ndarray) -> None:
    axes.set_title("How precise each sensor must be")
    axes.bar(np.arange(len(precisions)), precisions, 0.7, color=ACCENT)
    capped = np.isfinite(problem.caps) & (problem.caps <= 3 * max(np.max(precisions), 1e-300))
    if np.any(capped):
        where = np.flatnonzero(capped)
        axes.hlines(problem.caps[capped], where - 0.45, where + 0.45, color=SECOND, lw=2, label="cap")
        axes.legend(loc="upper right")
    _name_measurements(axes, list(problem.names))
    if _scale(precisions) == "log":
        axes.set_yscale("log")
    for i in np.flatnonzero(precisions == 0):
        axes.annotate("0", (i, 0), xycoords=("data", "axes fraction"), xytext=(0, 3), textcoords="offset points",
                      ha="center", color=GREY, fontsize=9)  # fmt: skip
    axes.set_ylabel("precision λ = 1 / noise variance")


def _map(axes: Axes, problem: Problem, grid: np.ndarray, what: str) -> None:
    from matplotlib.colors import LogNorm

    axes.set_title("How precise each sensor must be at each step")
    positive = grid[grid > 0]
    log = _scale(grid.ravel()) == "log"
    shown = np.where(grid > 0, grid, np.nan)
    norm = LogNorm(positive.min(), positive.max()) if log else None
    options: PlainDict = {"norm": norm} if log else {"vmin": 0.0}
    image = axes.imshow(shown.T, aspect="auto", cmap="Blues", interpolation="nearest", **options)
    bar = axes.figure.colorbar(image, ax=axes, pad=0.02)
    bar.set_label(f"{what} (white: not used)")
    steps = len(grid)
    name_rows(axes, list(problem.names))
    stride = -(-steps // 12)
    axes.set_xticks(np.arange(0, steps, stride), [str(k + 1) for k in range(0, steps, stride)])
    ends = "" if len(grid) == problem.batch else " (lines: end of a batch, where the bound holds)"
    axes.set_xlabel(f"step{ends}")
    for k in range(problem.batch, steps, problem.batch):
        axes.axvline(k - 0.5, color=INK, lw=1)
    axes.spines[:].set_visible(False)


def _deviations(axes: Axes, problem: Problem, solution: Solution) -> None:
    prior, posterior, bound = (np.asarray(solution.arrays[k]) for k in ("prior", "posterior", "bound"))
    root = np.sqrt(np.diag(bound))
    x = np.arange(1, len(root) + 1)
    axes.set_title("Standard deviations against the bound's")
    axes.axhline(1, color=SECOND, lw=1.5, label="bound")
    last = len(posterior) - 1
    which = "" if last == 0 else f", batch {last + 1}"
    axes.plot(x, np.sqrt(np.diag(prior[last])) / root, "o", color=GREY, mfc="white", ms=7, label=f"before{which}")
    axes.plot(x, np.sqrt(np.diag(posterior[last])) / root, "o", color=ACCENT, ms=7, label=f"after{which}")
    lower = np.linalg.cholesky(bound)
    inverse = np.linalg.inv(lower)
    spectrum = np.sqrt(np.maximum(np.linalg.eigvalsh(inverse @ posterior[last] @ inverse.T)[::-1], 0))
    axes.plot(x, spectrum, "_", color=INK, ms=11, mew=1.6, label="after, principal directions")
    known = state_names(problem)
    named = known if len(known) == len(root) else default_names(len(root))
    _name_columns(axes, named, x)
    drawn = [np.ones(1), np.sqrt(np.diag(prior[last])) / root, np.sqrt(np.diag(posterior[last])) / root, spectrum]
    value_axis(axes, np.concatenate(drawn))
    axes.set_ylabel("standard deviation / its bound")
    axes.set_xlabel("state (directions: from the worst on)")
    axes.legend(loc="best", fontsize=9)
    axes.grid(axis="y")


def _sequence(problem: Problem, solution: Solution, batches: Sequence[BatchRecord]) -> Figure:
    records = [r for r in batches if r.objective is not None]
    from matplotlib.ticker import MaxNLocator

    figure = new_figure(SLIDE, problem.name, "batches one after another, measured with the precisions that were chosen")
    top, bottom = figure.subplots(2, 1, sharex=True)
    k = [r.batch for r in records]
    top.set_title("What each batch costs")
    top.bar(k, [r.objective for r in records], 0.6, color=ACCENT)
    for r in records:
        top.annotate(f"{r.active} used", (r.batch, r.objective), xytext=(0, 3), textcoords="offset points",
                     ha="center", fontsize=9, color=GREY)  # fmt: skip
    top.set_ylabel("objective")
    bottom.xaxis.set_major_locator(MaxNLocator(integer=True))
    bottom.set_title("True error against what was promised")
    n = problem.states
    promised = np.sqrt(np.trace(solution.arrays["posterior"], axis1=1, axis2=2) / n)
    allowed = np.sqrt(np.trace(problem.bound) / n)
    bottom.plot(k, [r.rms_error for r in records], "o-", color=INK, label="true error of this run")
    bottom.plot(k, promised[: len(k)], "s-", color=ACCENT, label="expected (posterior covariance)")
    bottom.axhline(allowed, color=SECOND, label="largest that the bound allows")
    bottom.set_ylabel("root mean square over the states")
    bottom.set_xlabel("batch")
    bottom.set_ylim(0, None)
    bottom.legend(loc="best")
    return figure


def _pruning(problem: Problem, pruning: PruningRecord) -> Figure:
    figure = new_figure(SLIDE, problem.name, f"pruning ended: {pruning.reason}")
    from matplotlib.ticker import MaxNLocator

    axes = figure.add_subplot()
    axes.set_title("What it costs to do with fewer sensors")
    before, removals = pruning.objective_before, pruning.removals
    left, cost = [r.remaining for r in removals], [r.objective for r in removals]
    axes.plot(left, cost, "o-", color=ACCENT)
    for r in removals:
        if r.price <= 1e-3 * before:
            continue
        name = shorten(", ".join(r.removed), 18)
        axes.annotate(f"without {name}", (r.remaining, r.objective), xytext=(-7, 4), textcoords="offset points",
                      ha="right", fontsize=8.5, color=GREY)  # fmt: skip
    axes.axhline(before, color=SECOND, lw=1.2, label="all sensors")
    if max(cost) > 30 * before:
        axes.set_yscale("log")
    axes.invert_xaxis()
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel("sensors that may be used")
    axes.set_ylabel("objective")
    axes.legend(loc="upper left")
    axes.grid(axis="y")
    return figure

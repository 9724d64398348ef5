"""How cost and bound of a method came together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator

from occontrol.core.kinds import PlainMapping
from occontrol.files.figures import style


def convergence_panel(
    axes: Axes, history: Sequence[PlainMapping], target: float | None = None, absolute: bool = False
) -> bool:
    """How the relative gap between cost and proven bound closed.

    Parameters
    ----------
    axes : matplotlib Axes
    history : records {iteration, cost, lower_bound}
    target : relative gap aimed at, drawn as a line
    absolute : whether gaps are differences and not shares: the cost holds a logarithm

    Returns False, and draws nothing, when there are fewer than two iterations.
    """
    cost, bound = history_columns(history)
    if len(cost) < 2:
        return False
    stages = [str(record.get("stage") or "") for record in history]
    best = np.maximum.accumulate(np.where(np.isfinite(bound), bound, -np.inf))
    if stages[-1] == "check" and np.isfinite(bound[-1]):
        best[-1] = bound[-1]  # what is proven in the end, rounding taken off
    with np.errstate(invalid="ignore", divide="ignore"):
        gap = cost - best if absolute else (cost - best) / np.abs(cost)
    gap = np.where(np.isfinite(gap) & (gap > 0), gap, np.nan)
    if not np.any(np.isfinite(gap)):
        return False
    steps = np.arange(1, len(gap) + 1)
    axes.set_yscale("log")
    for i, stage in enumerate(dict.fromkeys(stages)):
        here = np.array([s == stage for s in stages])
        if not np.any(np.isfinite(gap[here])):
            continue  # nothing of it would be seen
        # the stages differ in what they vary (shares, then schedules), so their costs are not one curve
        marker = "D" if np.sum(here) == 1 else "o" if len(gap) <= 60 else None
        colour = style.PALETTE[i % len(style.PALETTE)]
        # several rounded policies are polished one after the other: the best so far
        shown = np.fmin.accumulate(gap[here]) if stage == "polish" else gap[here]
        axes.plot(steps[here], shown, color=colour, marker=marker, markersize=4, label=stage or None)
    if target:
        axes.axhline(target, color=style.GREY, linestyle="--", linewidth=1)
        over = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 0.5}  # curves may pass behind the word
        axes.annotate("target", (steps[0], target), va="bottom", fontsize=9, color="#666666", bbox=over)
    few_decades = np.nanmax(gap) < 100 * np.nanmin(gap)
    written = FuncFormatter(_plain if absolute else _percent)
    axes.yaxis.set_major_formatter(written)
    axes.yaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0) if few_decades else ()))
    axes.yaxis.set_minor_formatter(written)
    axes.xaxis.set_major_locator(MaxNLocator(5, integer=True, min_n_ticks=1))
    axes.set_xlabel("iteration")
    axes.set_ylabel("cost less bound" if absolute else "relative gap")
    axes.grid(axis="y", which="both")
    if len(set(stages)) > 1:
        axes.legend(loc="best", fontsize=9)
    return True


def _percent(value: float, position: int | None = None) -> str:
    return f"{100 * value:.3g} %"


def _plain(value: float, position: int | None = None) -> str:
    return f"{value:.3g}"


def history_columns(history: Sequence[PlainMapping]) -> tuple[np.ndarray, np.ndarray]:
    """Cost and bound of every record as arrays, not-a-number where a record has none.

    Parameters
    ----------
    history : records of a Solution
    """

    def column(key: str) -> np.ndarray:
        values = [record.get(key) for record in history]
        return np.array([float(v) if isinstance(v, int | float) else np.nan for v in values])

    return column("cost"), column("lower_bound")

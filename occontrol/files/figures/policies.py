"""A picture of a Monte Carlo comparison: error of each policy, its difference to the plan, divergence."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from occontrol.core.result import ResultData
from occontrol.files.figures import style


def draw(found: ResultData) -> Figure:
    """Three panels side by side, one row a policy.

    Parameters
    ----------
    found : Comparison
    """
    names = list(found.policies)
    rows = [found.policies[name] for name in names]
    with style.house_style():
        figure = style.new_figure((13.33, 2.4 + 0.45 * len(names)), found.name, f"{found.runs} runs, bars: 95 %")
        left, middle, right = figure.subplots(1, 3, sharey=True)
        _errors(left, rows)
        _differences(middle, rows, found.judged)
        values = [100 * row["diverged"] for row in rows]
        right.barh(range(len(rows)), values, color=style.GREY, height=0.5)
        right.set_xlim(0, max(5.0, 1.15 * max(values)))
        if not any(values):
            right.text(0.5, 0.5, "none", transform=right.transAxes, ha="center", color="#555555")
        right.set_xlabel("runs that diverged, %")
        left.set_yticks(range(len(names)), names)
        left.invert_yaxis()
    return figure


def _errors(axes: Axes, rows: list[dict]) -> None:
    for i, row in enumerate(rows):
        if row["mean"] is not None:
            axes.errorbar(row["mean"], i, xerr=1.96 * (row["standard_error"] or 0.0), fmt="o", color=style.ACCENT, ms=5)
        axes.plot(row["median"], i, "|", color=style.INK, ms=12)
    means = [row["mean"] for row in rows if row["mean"]]
    if means and max(means) > 20 * min(means) > 0:
        axes.set_xscale("log")
    axes.set_xlabel("squared error, dot: mean, tick: median")
    axes.grid(axis="x")


def _differences(axes: Axes, rows: list[dict], judged: str) -> None:
    axes.axvline(0, color="#555555", lw=0.8)
    keys = ("difference", "difference_error")
    shown = [(i, *(row[key] for key in keys)) for i, row in enumerate(rows) if row.get(keys[1])]
    for i, mean, error in shown:
        axes.errorbar(mean, i, xerr=1.96 * error, fmt="o", color=style.SECOND, ms=5)
    size = max((abs(mean) + 2 * error for _, mean, error in shown), default=1.0)
    if shown and size > 50 * min(abs(mean) + 2 * error for _, mean, error in shown):
        axes.set_xscale("symlog", linthresh=size / 100)
    else:
        axes.locator_params(axis="x", nbins=5)  # signs and digits need room
    axes.set_xlabel(f"difference in {judged} to the nominal plan, paired")
    axes.grid(axis="x")

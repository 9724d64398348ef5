"""A picture of what each sensor's price and noise are worth, for whoever buys sensors."""

from __future__ import annotations

import math
from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from occontrol.families.athans.sensitivity import Sensitivities
from occontrol.files.figures import style

MOST = 20  # sensors that are shown, those worth most


def draw(found: Sensitivities) -> Figure:
    """Three panels: share of time in use, change of the optimum for 1 % more noise, entry prices.

    Parameters
    ----------
    found : Sensitivities
    """
    worth = found.sensors
    names = sorted(worth, key=lambda name: (-worth[name]["noise"], -worth[name]["share"]))[:MOST]
    rows = [worth[name] for name in names]
    with style.house_style():
        title = "what the sensors are worth at the optimum" + (f"; the first {MOST}" if len(worth) > MOST else "")
        figure = style.new_figure((13.33, min(12.0, 2.2 + 0.38 * max(3, len(names)))), found.name, title)
        each = 100 / abs(found.cost) if found.cost else 1.0
        unit = "% of the optimal cost" if found.cost else "cost"
        panels = [
            ([100 * row["share"] for row in rows], "share in use, %", style.ACCENT),
            ([each * 0.01 * row["noise"] for row in rows], f"1 % more noise costs, {unit}", style.SECOND),
        ]
        if any("entry_price" in row for row in rows):
            falls = [-row["entry_price"] if "entry_price" in row else math.nan for row in rows]
            panels.append((falls, "to be used, its price must fall by", style.PALETTE[2]))
        grid = figure.subplots(1, len(panels), sharey=True)
        for axes, panel in zip(grid, panels, strict=True):
            _bars(axes, *panel)
        grid[0].set_yticks(range(len(names)), style.labels(names))
        grid[0].invert_yaxis()
    return figure


def _bars(axes: Axes, values: Sequence[float], label: str, colour: str) -> None:
    shown = [(i, value) for i, value in enumerate(values) if math.isfinite(value)]
    axes.barh([i for i, _ in shown], [value for _, value in shown], color=colour, height=0.6)
    for i, value in shown:
        axes.annotate(f"{value:.3g}", (value, i), (4, 0), textcoords="offset points", va="center", fontsize=9)
    axes.set_xlim(0, 1.25 * max((value for _, value in shown), default=0.0) or 1.0)
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.set_xlabel(label)
    axes.tick_params(axis="y", length=0)

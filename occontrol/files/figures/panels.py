"""Panels that several families share: who measures when, curves or maps over time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize

from occontrol.core.schedule import Schedule
from occontrol.files.figures import style
from occontrol.files.figures.axes import SMALLEST, WIDE_RANGE, alike, name_rows, together, value_axis

MOST_ROWS = 40
MANY = 25  # more sensors than this are shown only where they are used


def schedule_panel(
    axes: Axes, schedule: Schedule, available: np.ndarray | None = None, shares: bool | Sequence[str] = True
) -> None:
    """Who measures when: one row per sensor; the height of a bar is the weight, so that fractions show.

    Of many sensors only those that are used have a row.

    Parameters
    ----------
    axes : matplotlib Axes
    schedule : Schedule
    available : (K, M) of bool, drawn as a pale band behind the bars; None where there are no windows
    shares : whether to write each sensor's share of the horizon at the right, or what to write there for each
    """
    edges, weights = schedule.edges, schedule.weights
    lengths = np.diff(edges)
    use = lengths @ weights / np.sum(lengths)
    rows = list(range(len(schedule.names)))
    if len(rows) > MANY:
        rows = [j for j in rows if use[j] > 0] or rows
    used = len(rows)
    if used > MOST_ROWS:  # the most used ones, in the user's order
        rows = sorted(sorted(rows, key=lambda j: -use[j])[:MOST_ROWS])
    colours = style.sensor_colours(schedule.names)
    height = 0.8
    thickest = max(1.0, float(np.max(weights, initial=1.0)))  # idle may fill several places at a time
    for row, j in enumerate(rows):
        base = len(rows) - 1 - row - height / 2
        if available is not None:
            _band(axes, edges, available[:, j] * height, base, style.PALE)
        _band(axes, edges, weights[:, j] / thickest * height, base, colours[j])
        if len(rows) <= MANY and shares is not False:
            text = _share(float(use[j])) if shares is True else shares[j]
            at = axes.get_yaxis_transform()
            axes.text(1.008, base + height / 2, text, transform=at, va="center", fontsize=9, color="#555555")
    size = 10 if len(rows) <= 12 else 8 if len(rows) <= MANY else 6
    names = style.labels(schedule.names)
    axes.set_yticks(range(len(rows)), [names[j] for j in reversed(rows)], fontsize=size)
    axes.tick_params(axis="y", length=0)
    axes.set_ylim(-0.6, len(rows) - 0.4)
    axes.spines["left"].set_visible(False)
    hidden = len(schedule.names) - len(rows)
    if hidden:
        which = "in use" if used == len(rows) else "most used"
        axes.set_title(f"{axes.get_title(loc='left')} (the {len(rows)} {which}; {hidden} more)".strip())


def _share(use: float) -> str:
    return "–" if use <= 0 else "< 0.1 %" if use < 1e-3 else f"{100 * use:.3g} %"


def _band(axes: Axes, edges: np.ndarray, heights: np.ndarray, base: float, colour: str) -> None:
    shown = heights > 0
    if not np.any(shown):
        return
    # both ends of every interval: with step="post" the last interval of a run would be lost
    ends, tops = np.repeat(edges, 2)[1:-1], base + np.repeat(heights, 2)
    axes.fill_between(ends, base, tops, where=np.repeat(shown, 2).tolist(), color=colour, linewidth=0)


def curves_panel(
    axes: Axes, times: np.ndarray, values: np.ndarray, names: Sequence[str], label: str, colours: Sequence[str] = ()
) -> None:
    """A few curves over time with their names beside their ends; curves that lie on one another have one name.

    Parameters
    ----------
    axes : matplotlib Axes
    times : (K,)
    values : (K, C) one column per curve
    names : of the C curves
    label : of the vertical axis
    colours : of the curves; the palette's if left out
    """
    colours = colours or style.PALETTE
    groups = alike(values, value_axis(axes, values))
    for group in groups:
        j = group[0]
        axes.plot(times, values[:, j], color=colours[j % len(colours)], label=together(names, group))
    axes.set_ylabel(label)
    axes.grid(axis="y")
    style.dot_if_alone(axes)
    legend(axes, len(groups))


def legend(axes: Axes, entries: int) -> None:
    """The names of the curves at the right of the panel, outside of it.

    Parameters
    ----------
    axes : matplotlib Axes
    entries : how many there are
    """
    if entries:
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.03), borderaxespad=0.0, handlelength=1.2)


def map_panel(
    axes: Axes,
    edges: np.ndarray,
    values: np.ndarray,
    names: Sequence[str],
    label: str,
    log: bool = True,
    ends: bool = False,
) -> None:
    """Many curves over time as a map, one row each.

    Parameters
    ----------
    axes : matplotlib Axes
    edges : (K+1,) ends of the K columns
    values : (K, C); not-a-number stays white
    names : of the C rows
    label : of the colours
    log : whether colours go by the logarithm where the values are positive and far apart
    ends : whether to write the last value of every row at the right
    """
    finite = values[np.isfinite(values)]
    positive = finite[finite > 0]
    if log and len(positive) and np.max(positive) > WIDE_RANGE * np.min(positive):
        low = max(float(np.min(positive)), float(np.max(positive)) * 1e-6)
        norm: Normalize = LogNorm(low, float(np.max(positive)), clip=True)
        values = np.where(np.isfinite(values), np.maximum(values, low), np.nan)
    else:
        low, high = (float(np.min(finite)), float(np.max(finite))) if len(finite) else (0.0, 1.0)
        norm = Normalize(low, high if high > low else low + 1.0)
    count = len(names)
    mesh = axes.pcolormesh(
        edges, np.arange(count + 1) - 0.5, np.ma.masked_invalid(values.T), cmap=style.colour_map(), norm=norm
    )
    axes.invert_yaxis()
    size = name_rows(axes, names)
    if ends and size >= SMALLEST:
        axes.set_title("at the end", loc="right", fontsize=8, color="#555555", fontweight="normal")
        for row in range(count):
            at = axes.get_yaxis_transform()
            text = f" {values[-1, row]:.2g}"
            axes.text(1.0, row, text, transform=at, va="center", fontsize=size, color="#555555")
    bar = axes.figure.colorbar(mesh, ax=axes, pad=0.07 if ends else 0.01, aspect=18)  # type: ignore[union-attr]
    bar.set_label(label, fontsize=9)
    bar.outline.set_visible(False)  # type: ignore[operator]

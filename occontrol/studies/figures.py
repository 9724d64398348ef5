"""Figures of a study: lines over a number, a map over two, parallel coordinates over more, and the front."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from occontrol.core.kinds import Plain, PlainDict
from occontrol.files.figures import style
from occontrol.studies.collect import Table

SIZE = (13.33, 6.8)
MOST_PANELS = 4


def draw(table: Table) -> dict[str, Figure]:
    """Every figure that the table has the numbers for, by name.

    Parameters
    ----------
    table : from `collect`

    Empty where no task has a cost or another number to show.
    """
    value = _value(table)
    if value is None:
        return {}
    numeric = [axis for axis in table.axes if _numbers(table, axis) and len(_levels(table, axis)) > 1]
    others = [axis for axis in table.axes if axis not in numeric and len(_levels(table, axis)) > 1]
    found: dict[str, Figure] = {}
    with style.house_style():
        if numeric:
            found["lines"] = _lines(table, value, max(numeric, key=lambda a: len(_levels(table, a))))
        elif others:
            found["bars"] = _bars(table, value, others)
        if len(numeric) == 2 and not others:
            found["map"] = _map(table, value, numeric)
        if len(numeric) + len(others) > 2:
            found["parallel"] = _parallel(table, value, [*numeric, *others])
        if any(_is(row.get("observation_cost")) and _is(row.get("prediction_error")) for row in table.rows):
            found["front"] = _front(table)
    return found


def _is(value: Plain) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _value(table: Table) -> str | None:
    """The column that is drawn: the cost, else the first number that a result has and no axis is."""
    for column in ("cost", *table.columns):
        if column not in ("task", "seed", *table.axes) and any(_is(row.get(column)) for row in table.rows):
            return column
    return None


def _levels(table: Table, axis: str) -> list[Plain]:
    seen: list[Plain] = []
    for row in table.rows:
        if row.get(axis) not in seen:
            seen.append(row.get(axis))
    return seen


def _numbers(table: Table, axis: str) -> bool:
    return all(_is(row.get(axis)) for row in table.rows)


def _said(value: Plain) -> str:
    if _is(value):
        return f"{value:.4g}"
    if isinstance(value, dict):
        return style.shorten(", ".join(f"{key}: {entry}" for key, entry in value.items()))
    return style.shorten(str(value))


def _logarithmic(values: Sequence[float]) -> bool:
    return min(values) > 0 and max(values) > 30 * min(values)


def _groups(rows: Sequence[PlainDict], axes_named: Sequence[str]) -> dict[tuple[str, ...], list[PlainDict]]:
    """The rows by their values of some axes; seeds stay together."""
    groups: dict[tuple[str, ...], list[PlainDict]] = {}
    for row in rows:
        groups.setdefault(tuple(f"{axis}: {_said(row.get(axis))}" for axis in axes_named), []).append(row)
    return groups


def _lines(table: Table, value: str, along: str) -> Figure:
    """The value over one axis, a line for each level of the others; one panel a level of the last where lines crowd."""
    others = [axis for axis in table.axes if axis != along and len(_levels(table, axis)) > 1]
    apart: list[str] = []
    if len(_groups(table.rows, others)) > style.MOST_LINES and len(_levels(table, others[-1])) <= MOST_PANELS:
        apart, others = others[-1:], others[:-1]
    bounded = any(_is(row.get("lower_bound")) for row in table.rows) and value == "cost"
    subtitle = f"{value.replace('_', ' ')} over {along}" + ("; dashed: what no schedule undercuts" if bounded else "")
    figure = style.new_figure(SIZE, table.name, subtitle)
    panels = _groups(table.rows, apart)
    grid = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    for axes, (title, rows) in zip(grid, panels.items(), strict=True):
        _panel(axes, rows, along, value, _groups(rows, others), bounded)
        axes.set_title(" ".join(title))
        axes.set_xlabel(along)
        if _logarithmic([float(row[along]) for row in table.rows]):
            axes.set_xscale("log")
    shown = [float(row[value]) for row in table.rows if _is(row.get(value))]
    if _logarithmic(shown):
        grid[0].set_yscale("log")
    grid[0].set_ylabel(value.replace("_", " "))
    handles, names = grid[0].get_legend_handles_labels()
    if len(names) > 1:
        figure.legend(handles, names, loc="outside right upper")
    return figure


def _panel(
    axes: Axes,
    rows: list[PlainDict],
    along: str,
    value: str,
    groups: dict[tuple[str, ...], list[PlainDict]],
    bounded: bool,
) -> None:
    many = len(groups) > style.MOST_LINES
    for number, (name, own) in enumerate(groups.items()):
        colour = style.ACCENT if many else style.PALETTE[number]
        x, y = _means(own, along, value)
        label = "\n".join(name) if name and not many else None
        axes.plot(x, y, "o-", color=colour, ms=4, alpha=0.5 if many else 1, label=label)
        if bounded:
            x, y = _means(own, along, "lower_bound")
            axes.plot(x, y, "--", color=colour, lw=1.1, alpha=0.5 if many else 1)
    axes.grid()


def _means(rows: list[PlainDict], along: str, value: str) -> tuple[list[float], list[float]]:
    """Mean of `value` at each place of the axis, sorted: over the seeds."""
    at: dict[float, list[float]] = {}
    for row in rows:
        if _is(row.get(value)):
            at.setdefault(float(row[along]), []).append(float(row[value]))
    x = sorted(at)
    return x, [float(np.mean(at[place])) for place in x]


def _bars(table: Table, value: str, axes_named: list[str]) -> Figure:
    names = [" · ".join(_said(row.get(axis)) for axis in axes_named) for row in table.rows]
    kept = [(name, float(row[value])) for name, row in zip(names, table.rows, strict=True) if _is(row.get(value))]
    figure = style.new_figure((13.33, min(12.0, 1.6 + 0.35 * max(3, len(kept)))), table.name, " · ".join(axes_named))
    axes = figure.subplots()
    axes.barh(range(len(kept)), [number for _, number in kept], color=style.ACCENT, height=0.6)
    axes.set_yticks(range(len(kept)), [name for name, _ in kept])
    axes.invert_yaxis()
    axes.set_xlabel(value.replace("_", " "))
    return figure


def _map(table: Table, value: str, numeric: list[str]) -> Figure:
    down, across = (sorted(map(float, _levels(table, axis))) for axis in numeric)
    cells: dict[tuple[float, float], list[float]] = {}
    for row in table.rows:
        if _is(row.get(value)):
            cells.setdefault((float(row[numeric[0]]), float(row[numeric[1]])), []).append(float(row[value]))
    grid = np.array([[float(np.mean(cells.get((a, b), [np.nan]))) for b in across] for a in down])
    figure = style.new_figure(SIZE, table.name, f"{value.replace('_', ' ')} of every task")
    axes = figure.subplots()
    image = axes.imshow(grid, aspect="auto", origin="lower", cmap="viridis")
    axes.set_xticks(range(len(across)), [_said(x) for x in across], rotation=45 if len(across) > 8 else 0)
    axes.set_yticks(range(len(down)), [_said(y) for y in down])
    axes.set_xlabel(numeric[1])
    axes.set_ylabel(numeric[0])
    if grid.size <= 150:
        middle = (np.nanmin(grid) + np.nanmax(grid)) / 2
        for (i, j), number in np.ndenumerate(grid):
            if math.isfinite(number):
                ink = "white" if number < middle else "black"
                axes.text(j, i, f"{number:.3g}", ha="center", va="center", fontsize=9, color=ink)
    figure.colorbar(image, ax=axes, label=value.replace("_", " "))
    return figure


def _parallel(table: Table, value: str, axes_named: list[str]) -> Figure:
    """One line a task across an upright scale for each axis and the value; its colour is the value."""
    from matplotlib import colormaps

    columns = [*axes_named, value]
    places, ticks = zip(*(_upright(table, column) for column in columns), strict=True)
    figure = style.new_figure(SIZE, table.name, f"one line a task; its colour is its {value.replace('_', ' ')}")
    axes = figure.subplots()
    last = places[-1]
    for number in range(len(table.rows)):
        heights = [place[number] for place in places]
        if all(math.isfinite(h) for h in heights):
            axes.plot(range(len(columns)), heights, color=colormaps["viridis"](last[number]), lw=1.2, alpha=0.8)
    for i, marks in enumerate(ticks):
        axes.axvline(i, color="#555555", lw=0.8)
        for height, text in marks:
            axes.text(i + 0.02, height, text, fontsize=9, va="center")
    axes.set_xticks(range(len(columns)), [style.shorten(c, 30) for c in columns])
    axes.set_yticks([])
    axes.set_xlim(-0.05, len(columns) - 1 + 0.35)
    axes.spines["left"].set_visible(False)
    return figure


def _upright(table: Table, column: str) -> tuple[list[float], list[tuple[float, str]]]:
    """Heights in 0..1 of every row and the marks beside the scale."""
    levels = _levels(table, column)
    if all(_is(v) for v in levels if v is not None) and any(_is(v) for v in levels):
        numbers = [float(v) for v in levels if v is not None]
        scale = math.log if _logarithmic(numbers) else float
        low, high = scale(min(numbers)), scale(max(numbers))
        span = (high - low) or 1.0
        heights = [(scale(float(r[column])) - low) / span if _is(r.get(column)) else math.nan for r in table.rows]
        shown = sorted(numbers) if len(numbers) <= 8 else [min(numbers), max(numbers)]
        return heights, [((scale(x) - low) / span, _said(x)) for x in shown]
    place = {_said(level): i / max(1, len(levels) - 1) for i, level in enumerate(levels)}
    return [place[_said(row.get(column))] for row in table.rows], [(h, text) for text, h in place.items()]


def _front(table: Table) -> Figure:
    """Observation cost against prediction error of every task."""
    figure = style.new_figure(SIZE, table.name, "what each task pays for its measurements, and what it gets")
    axes = figure.subplots()
    rows = [r for r in table.rows if _is(r.get("observation_cost")) and _is(r.get("prediction_error"))]
    names = list(dict.fromkeys(str(row.get("method", "")) for row in rows))
    for number, name in enumerate(names):
        own = [row for row in rows if str(row.get("method", "")) == name]
        x, y = ([float(row[key]) for row in own] for key in ("observation_cost", "prediction_error"))
        axes.plot(x, y, "o", ms=5, color=style.PALETTE[number % len(style.PALETTE)], label=name)
    if _logarithmic([float(row["prediction_error"]) for row in rows]):
        axes.set_yscale("log")
    axes.set_xlabel("observation cost")
    axes.set_ylabel("prediction error  tr(W Σ(T))")
    axes.grid()
    if len(names) > 1:
        axes.legend()
    return figure

"""Panels as Bokeh models: drawn on a canvas, zooming together, with what is under the pointer in words.

Only `item` is called from elsewhere, and only there is Bokeh imported.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from bokeh.embed import json_item
from bokeh.layouts import gridplot
from bokeh.models import (
    AdaptiveTicker,
    ColorBar,
    ColorMapper,
    ColumnDataSource,
    CrosshairTool,
    CustomJSHover,
    CustomJSTickFormatter,
    FixedTicker,
    HoverTool,
    LinearColorMapper,
    LogColorMapper,
    Range1d,
    Span,
    Title,
)
from bokeh.palettes import Cividis256
from bokeh.plotting import figure
from bokeh.transform import linear_cmap

from occontrol.core.kinds import PlainDict
from occontrol.core.sensor import IDLE
from occontrol.files.page.content import Bars, Curves, Group, Panel, Shades
from occontrol.files.page.thin import columns, runs, thinned

# each has a contrast of 3 at least both on white and on the dark page
COLOURS = ("#0072B2", "#D55E00", "#008A64", "#B9629A", "#3A8FC4", "#A87000", "#7A7A7A")
INK, SOFT, LINE, PAPER = "#1b1e23", "#555b64", "#d5d8dc", "#ffffff"
QUIET, BAND = "#8a8a8a", 0.22
ROW, HEIGHT = 18, 210  # pixels of a row of bars, and of a panel of curves
WIDE = 50.0  # above this ratio of the largest to the smallest value an axis is logarithmic
TOOLS = "xpan,box_zoom,xwheel_zoom,reset,save"


def item(group: Group, target: str) -> PlainDict:
    """What BokehJS needs to draw a group of panels.

    Parameters
    ----------
    group : the panels
    target : id of the element to draw into
    """
    low, high = _horizon(group)
    axis = Range1d(start=low, end=high, bounds=(low, high))
    line = Span(dimension="height", line_color=QUIET, line_dash="dotted", line_width=1)
    plots = []
    for i, panel in enumerate(group.panels):
        last = i == len(group.panels) - 1
        plots.append(_plot(panel, group, axis, line, last))
    for renderer in (r for plot in plots for r in plot.renderers):
        renderer.nonselection_glyph = renderer.muted_glyph = None  # nothing is selected: half the models
    grid = gridplot(
        [[plot] for plot in plots], merge_tools=True, toolbar_location="above", sizing_mode="stretch_width",
        toolbar_options={"logo": None},
    )  # fmt: skip
    return dict(json_item(grid, target))  # type: ignore[arg-type]


def _horizon(group: Group) -> tuple[float, float]:
    ends = [p.times if isinstance(p, Curves) else p.edges for p in group.panels]
    low, high = min(float(np.min(e)) for e in ends), max(float(np.max(e)) for e in ends)
    room = 0.0 if group.log else 0.01 * (high - low)
    return (low - room, high + room) if high > low else (low - 0.5, high + 0.5)


def _plot(panel: Panel, group: Group, axis: Range1d, line: Span, last: bool) -> figure:
    rows = len(panel.names)
    height = HEIGHT if isinstance(panel, Curves) else int(np.clip(60 + ROW * rows, 110, 620))
    options: PlainDict = {"y_range": (-0.6, rows - 0.4)}
    if isinstance(panel, Curves):
        options = {"y_axis_type": _scale(panel)}
    plot = figure(
        height=height + 26 * last, sizing_mode="stretch_width", x_range=axis, tools=TOOLS, active_scroll="xwheel_zoom",
        active_drag="xpan", title=Title(text=panel.title, text_color=INK), min_border_left=60, output_backend="canvas",
        x_axis_type="log" if group.log else "linear", **options,
    )  # fmt: skip
    plot.add_tools(CrosshairTool(dimensions="height", overlay=line))
    plot.xaxis.axis_label = group.axis if last else None
    if group.whole:
        plot.xaxis.ticker = AdaptiveTicker(base=10, mantissas=[1, 2, 5], min_interval=1, num_minor_ticks=0)
    plot.xaxis.major_label_text_font_size = "11px" if last else "0px"
    plot.xaxis.axis_label_text_font_style = "normal"
    plot.background_fill_alpha = plot.border_fill_alpha = 0.0
    plot.outline_line_color = None
    plot.xgrid.visible = False
    _dye(plot)
    if isinstance(panel, Bars):
        _bars(plot, panel, group.axis)
    elif isinstance(panel, Shades):
        _shades(plot, panel, group.axis)
    else:
        _curves(plot, panel, group.axis, height + 26 * last)
    return plot


def _dye(plot: figure) -> None:
    """The colours of the light page; page.js knows them and puts those of the dark one in their place."""
    for axis in plot.axis:
        axis.axis_label_text_color = INK
        axis.major_label_text_color = axis.axis_line_color = axis.major_tick_line_color = SOFT
        axis.minor_tick_line_color = None
    plot.grid.grid_line_color = LINE


def _short(values: np.ndarray, around: np.ndarray) -> np.ndarray:
    """Half the bytes where a screen cannot tell: not for dates, whose span is far smaller than they are."""
    span = float(np.ptp(around)) if len(around) else 0.0
    fits = span > 0 and float(np.max(np.abs(around))) < 500 * span and float(np.max(np.abs(around))) < 1e37
    return np.asarray(values, dtype=np.float32 if fits else np.float64)


def colours(names: Sequence[str]) -> list[str]:
    """One colour for every name, again from the first when there are more; idle is grey."""
    active = iter(range(len(names)))
    return [QUIET if name == IDLE else COLOURS[next(active) % (len(COLOURS) - 1)] for name in names]


def _bars(plot: figure, panel: Bars, axis: str) -> None:
    """Bars between edges, or marks at instants; pale where a name may be used."""
    M, edges = len(panel.names), panel.edges
    half = 0.4
    if panel.allowed is not None and not np.all(panel.allowed):
        parts = [(edges[a], edges[b], np.full(len(a), M - 1 - j)) for j, a, b in runs(panel.allowed)]
        left, right, rows = (np.concatenate(x) for x in zip(*parts, strict=True)) if parts else (np.zeros(0),) * 3
        pale = {"left": _short(left, edges), "right": _short(right, edges), "y": rows.astype(np.int16)}
        plot.hbar(y="y", left="left", right="right", height=0.9, source=ColumnDataSource(pale), line_color=None,
                  fill_color=QUIET, fill_alpha=BAND, name="window")  # fmt: skip
    parts = []
    for j, a, b in runs(panel.weights):
        if panel.instants:
            k = np.concatenate([np.arange(s, e) for s, e in zip(a, b, strict=True)])
            parts.append((k, k, np.full(len(k), j)))
        else:
            parts.append((a, b, np.full(len(a), j)))
    a, b, j = (np.concatenate(x).astype(int) for x in zip(*parts, strict=True)) if parts else (np.zeros(0, int),) * 3
    weights = panel.weights[a, j]
    data = {"left": _short(edges[a], edges), "y": (M - 1 - j).astype(np.int16), "row": j.astype(np.int16)}
    tips = [("", "@row{custom}"), (axis, "@left{0.[000000]}")]
    if not panel.instants:
        data["right"] = _short(edges[b], edges)
        tips = [("", "@row{custom}"), (axis, "@left{0.[000000]} to @right{0.[000000]}")]
    if np.any(np.abs(weights - np.round(weights)) > 1e-6):
        data["share"] = weights.astype(np.float32)
        tips.append(("share", "@share{0.[0000]}"))
    if panel.rates is not None:
        data["rate"] = panel.rates[a, j].astype(np.float32)
        tips.append((panel.rate, "@rate"))
    fill: PlainDict = {"fill_color": linear_cmap("row", colours(panel.names), -0.5, M - 0.5)}
    if "share" in data:
        data["height"] = (2 * half * np.clip(weights, 0, 1)).astype(np.float32)
    source = ColumnDataSource(data)
    if panel.instants:
        drawn = plot.scatter(x="left", y="y", source=source, size=7, line_color=None, name="schedule", **fill)
    else:
        drawn = plot.hbar(y="y", left="left", right="right", height="height" if "share" in data else 2 * half,
                          source=source, line_color=None, name="schedule", **fill)  # fmt: skip
    words = CustomJSHover(args={"names": list(panel.names)}, code="return names[value]")
    plot.add_tools(HoverTool(renderers=[drawn], tooltips=tips, formatters={"@row": words}))
    _name_rows(plot, panel.names)


def _name_rows(plot: figure, names: Sequence[str]) -> None:
    count = len(names)
    shown = [name if len(name) <= 24 else name[:23] + "…" for name in reversed(names)]
    plot.yaxis.ticker = FixedTicker(ticks=list(range(count)))
    plot.yaxis.formatter = CustomJSTickFormatter(args={"names": shown}, code="return names[Math.round(tick)] ?? ''")
    plot.yaxis.major_tick_line_color = None
    plot.yaxis.major_label_text_font_size = "11px" if count <= 40 else "8px"
    plot.ygrid.visible = False


def _shades(plot: figure, panel: Shades, axis: str) -> None:
    """A map with one row for every name, the first on top."""
    M, edges = len(panel.names), panel.edges
    values = columns(edges, panel.values, panel.smallest)[:, ::-1].T.astype(np.float32)
    finite = values[np.isfinite(values)]
    low, high = (float(np.min(finite)), float(np.max(finite))) if len(finite) else (0.0, 1.0)
    if _wide(finite):
        low = max(low, high * 1e-6)
        mapper: ColorMapper = LogColorMapper(palette=Cividis256, low=low, high=high, nan_color="rgba(0,0,0,0)")
    else:
        high = high if high > low else low + 1.0
        mapper = LinearColorMapper(palette=Cividis256, low=low, high=high, nan_color="rgba(0,0,0,0)")
    start, end = float(edges[0]), float(edges[-1])
    drawn = plot.image(image=[values], x=start, y=-0.5, dw=end - start, dh=M, color_mapper=mapper)  # type: ignore[call-arg]
    words = CustomJSHover(args={"names": list(reversed(panel.names))}, code="return names[Math.round(value)]")
    tips = [("", "$y{custom}"), (axis, "$x{0.[000000]}"), (panel.label, "@image")]
    plot.add_tools(HoverTool(renderers=[drawn], tooltips=tips, formatters={"$y": words}))
    plot.add_layout(ColorBar(color_mapper=mapper, title=panel.label, width=10, padding=4, background_fill_alpha=0.0,
                             title_text_font_style="normal", title_text_font_size="11px", title_text_color=INK,
                             major_label_text_color=SOFT), "right")  # fmt: skip
    _name_rows(plot, panel.names)


def _wide(values: np.ndarray) -> bool:
    return bool(len(values)) and float(np.min(values)) > 0 and np.max(values) > WIDE * np.min(values)


def _scale(panel: Curves) -> str:
    return "log" if panel.low is None and _wide(panel.values[np.isfinite(panel.values)]) else "linear"


def _curves(plot: figure, panel: Curves, axis: str, height: int) -> None:
    """Lines with their names beside them; a click on a name hides its line."""
    between = len(panel.times) == len(panel.values) + 1
    palette = colours(panel.names) if panel.sensors else [COLOURS[i % len(COLOURS)] for i in range(len(panel.names))]
    lines = []
    for j, name in enumerate(panel.names):
        value = panel.values[:, j]
        kept = thinned(value)
        times = panel.times[kept]
        if between:  # both ends of a step, so that a thinned one keeps its place
            times = np.stack([times, panel.times[kept + 1]], axis=1).ravel()
            kept = np.repeat(kept, 2)
        data = {"t": _short(times, panel.times), "v": value[kept].astype(np.float32)}
        if panel.low is not None and panel.high is not None:
            data |= {"a": panel.low[kept, j].astype(np.float32), "b": panel.high[kept, j].astype(np.float32)}
        if panel.used is not None:
            data["u"] = np.where(panel.used[kept, j], value[kept], np.nan).astype(np.float32)
        source = ColumnDataSource(data)
        style: PlainDict = {"source": source, "color": palette[j], "name": f"sensor:{name}" if panel.sensors else name}
        if panel.low is not None:
            plot.varea("t", "a", "b", source=source, fill_color=palette[j], fill_alpha=BAND, name=style["name"])
        if panel.used is not None:
            plot.line("t", "u", line_width=5, line_alpha=0.45, **style)
        if panel.dots:
            one = plot.scatter("t", "v", size=5, legend_label=name, **style)
        else:
            dash = "solid" if j < len(COLOURS) else "dashed" if j < 2 * len(COLOURS) else "dotted"
            one = plot.line("t", "v", line_width=1.6, line_dash=dash, legend_label=name, **style)
            if len(panel.times) == 1:
                plot.scatter("t", "v", size=6, **style)
        lines.append(one)
    if panel.level is not None:
        plot.add_layout(Span(location=panel.level, dimension="width", line_color=QUIET, line_dash="dashed"))
    tips = [("", "$name"), (axis, "@t{0.[000000]}"), (panel.label, "@v")]
    plot.add_tools(HoverTool(renderers=lines, tooltips=tips, line_policy="nearest"))
    plot.yaxis.axis_label = panel.label
    plot.yaxis.axis_label_text_font_style = "normal"
    if plot.legend:
        box, few = plot.legend[0], len(panel.names) <= 9
        plot.add_layout(box, "right")
        box.click_policy, box.label_text_font_size = "hide", "11px" if few else "8px"
        box.spacing, box.margin = 0, 0
        box.label_text_color, box.inactive_fill_color = INK, PAPER
        box.background_fill_alpha, box.border_line_color = 0.0, None
        plot.height = max(height, 40 + (20 if few else 14) * len(panel.names))

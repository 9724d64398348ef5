"""The common look of every figure: colours that the colour-blind can tell apart, little ink, clear labels."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Colormap
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from occontrol.core.sensor import IDLE

# Okabe and Ito's palette without its yellow, which is lost on white
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")
ACCENT, SECOND, GREY, PALE, INK = PALETTE[0], PALETTE[1], "#8a8a8a", "#ececec", "#222222"
SLIDE = (13.33, 7.5)
MOST_LINES = len(PALETTE)  # more curves than this are drawn as a map
LONGEST_NAME = 22

_SETTINGS: Any = {
    "font.size": 11,
    "font.family": "DejaVu Sans",
    "axes.titlesize": 12,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 11,
    "axes.labelcolor": INK,
    "axes.edgecolor": "#555555",
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.formatter.limits": (-3, 5),
    "axes.formatter.use_mathtext": True,
    "xtick.color": "#444444",
    "ytick.color": "#444444",
    "text.color": INK,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.8,
    "legend.frameon": False,
    "legend.fontsize": 10,
    "figure.constrained_layout.use": True,
}


@contextmanager
def house_style() -> Iterator[None]:
    """Matplotlib's settings of this house, for as long as a figure is being drawn."""
    with matplotlib.rc_context(_SETTINGS):
        yield


def new_figure(size: tuple[float, float], title: str, subtitle: str = "") -> Figure:
    """An empty figure that needs no window system.

    Parameters
    ----------
    size : (width, height) in inches
    title : large, for example the problem's name
    subtitle : smaller, below it
    """
    figure = Figure(figsize=size)
    FigureCanvasAgg(figure)
    left, height = 0.16 / size[0], size[1]
    figure.text(left, 1 - 0.12 / height, shorten(title, 70), ha="left", va="top", fontsize=16, weight="bold")
    if subtitle:
        figure.text(left, 1 - 0.45 / height, subtitle, ha="left", va="top", fontsize=11, color="#555555")
    top = 0.75 if subtitle else 0.5  # inches above the panels
    figure.get_layout_engine().set(rect=(0.005, 0.01, 0.99, 1 - top / height - 0.01))  # type: ignore[union-attr]
    return figure


def rows_height(rows: int) -> float:
    """How many inches a panel grows by when it has a row for each of many curves.

    Parameters
    ----------
    rows : how many there are; few are drawn as curves
    """
    return 0.0 if rows <= MOST_LINES else 0.09 * min(rows, 60)


def grid_of(panels: int) -> tuple[int, int]:
    """Rows and columns of so many small panels: the more there are, the more stand side by side.

    Parameters
    ----------
    panels : how many there are
    """
    columns = 1 if panels <= 3 else 2 if panels <= 8 else 3 if panels <= 15 else 4
    return -(-panels // columns), columns


def sensor_colours(names: Sequence[str]) -> list[str]:
    """One colour per sensor, grey for idle; a single colour when there are too many to tell apart.

    Parameters
    ----------
    names : of the sensors
    """
    active = [name for name in names if name != IDLE]
    if len(active) > MOST_LINES:
        return [GREY if name == IDLE else ACCENT for name in names]
    taken = iter(PALETTE)
    return [GREY if name == IDLE else next(taken) for name in names]


def shorten(name: str, longest: int = LONGEST_NAME) -> str:
    """`name`, cut to a length, and safe from being taken for a formula.

    Parameters
    ----------
    name : what the user called it
    longest : the most characters that are shown
    """
    cut = name if len(name) <= longest else name[: longest - 1] + "…"
    return cut.replace("$", r"\$")


def labels(names: Sequence[str], longest: int = LONGEST_NAME) -> list[str]:
    """The names cut to a length; where that would make two alike, without the words that all begin or end with.

    Parameters
    ----------
    names : what the user called them
    longest : the most characters that are shown
    """
    cut = [shorten(name, longest) for name in names]
    if len(set(cut)) == len(set(names)):
        return cut
    head = _alike(names)
    while head and names[0][head - 1].isalnum():  # whole words only
        head -= 1
    tail = min(_alike([name[::-1] for name in names]), min(map(len, names)) - head)
    while tail > 0 and names[0][-tail].isalnum():
        tail -= 1
    ends = "…" * (head > 0), "…" * (tail > 0)
    return [shorten(f"{ends[0]}{name[head : len(name) - tail].strip()}{ends[1]}", longest) for name in names]


def _alike(names: Sequence[str]) -> int:
    """How many letters all names begin with."""
    first, last = min(names), max(names)
    return next((i for i, (a, b) in enumerate(zip(first, last, strict=False)) if a != b), len(first))


def count_of(number: int, what: str) -> str:
    """'1 choice', '2 choices'.

    Parameters
    ----------
    number, what : how many of which thing, in the singular
    """
    return f"{number} {what}{'s' * (number != 1)}"


def step_axis(axes: Axes, steps: int, label: bool = True) -> None:
    """The horizontal axis of everything that runs over whole steps.

    Parameters
    ----------
    axes : matplotlib Axes
    steps : how many there are
    label : whether to name the axis
    """
    tidy_time_axis(axes, 0, steps, label)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, steps=[1, 2, 5, 10]))
    if label:
        axes.set_xlabel("step k")


def dot_if_alone(axes: Axes) -> None:
    """A curve through one point is nothing to see: a dot in its place.

    Parameters
    ----------
    axes : matplotlib Axes with all its curves
    """
    for line in axes.get_lines():
        if len(line.get_xdata()) == 1 and line.get_marker() in (None, "None", ""):  # type: ignore[arg-type]
            line.set_marker("o")
            line.set_markersize(6)
            line.set_clip_on(False)


def colour_map() -> Colormap:
    """The map for heat maps: even in lightness and safe for the colour-blind."""
    return matplotlib.colormaps["cividis"]


def tidy_time_axis(axes: Axes, start: float, end: float, label: bool = True) -> None:
    """The horizontal axis of everything that runs over time.

    Parameters
    ----------
    axes : matplotlib Axes
    start, end : the horizon
    label : whether to name the axis
    """
    if end > start:  # an estimate of a single time has no extent
        axes.set_xlim(start, end)
    if label:
        axes.set_xlabel("time t, in the problem's unit")
    else:
        axes.tick_params(labelbottom=False)

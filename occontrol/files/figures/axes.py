"""Axes that fit what is drawn: their scale, their names, and one name for curves that lie on one another."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from occontrol.files.figures import style

WIDE_RANGE = 50.0  # above this ratio of the largest to the smallest value the axis is logarithmic
NEAR_ZERO = 0.4  # an axis begins at zero where the smallest value is at most this share of the largest
HIDDEN = 0.004  # curves nearer to each other than this share of an axis are one line
SMALLEST = 4.5  # size of letters that can still be read


def value_axis(axes: Axes, values: np.ndarray) -> bool:
    """The vertical axis of values: logarithmic where they are far apart, from zero only where they come near it.

    Parameters
    ----------
    axes : matplotlib Axes
    values : (K,) or (K, C) everything that is drawn

    Returns whether the axis is logarithmic.
    """
    finite = values[np.isfinite(values)]
    low, high = (float(np.min(finite)), float(np.max(finite))) if len(finite) else (0.0, 0.0)
    if low > 0 and high > WIDE_RANGE * low:
        axes.set_yscale("log")
        return True
    if 0 <= low <= NEAR_ZERO * high and high > 0:
        axes.set_ylim(0, 1.05 * high)
    return False


def share_axis(axes: Axes) -> None:
    """A vertical axis from 0 to 1; lines on its ends are drawn whole.

    Parameters
    ----------
    axes : matplotlib Axes with all its curves
    """
    axes.set_ylim(0, 1)
    for line in axes.get_lines():
        line.set_clip_on(False)


def alike(values: np.ndarray, log: bool) -> list[list[int]]:
    """Which curves lie on one another as far as a picture shows.

    Parameters
    ----------
    values : (K, C) one column per curve
    log : whether they are drawn on a logarithmic axis

    Returns lists of columns; of each list the first is to be drawn.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        drawn = np.log(values) if log else values
    finite = drawn[np.isfinite(drawn)]
    thin = HIDDEN * float(np.ptp(finite)) if len(finite) else 0.0
    groups: list[list[int]] = []
    for j in range(values.shape[1]):
        for group in groups:
            a, b = drawn[:, group[0]], drawn[:, j]
            both = np.isfinite(a) & np.isfinite(b)
            same = np.array_equal(np.isfinite(a), np.isfinite(b)) and np.all(np.abs(a[both] - b[both]) <= thin)
            if same:
                group.append(j)
                break
        else:
            groups.append([j])
    return groups


def together(names: Sequence[str], group: Sequence[int]) -> str:
    """The name of one curve that stands for several.

    Parameters
    ----------
    names : of all curves
    group : which of them lie on one another
    """
    told = ", ".join(style.shorten(names[j]) for j in group[:3])
    more = f" and {len(group) - 3} more" if len(group) > 3 else ""
    return told + more + (" (the same)" if len(group) > 1 else "")


def name_rows(axes: Axes, names: Sequence[str]) -> float:
    """Name every row of a map as long as letters can be read, and every few of more rows; returns their size.

    Parameters
    ----------
    axes : matplotlib Axes whose rows are at 0, 1, ..
    names : of all rows
    """
    figure = axes.figure
    share = axes.get_position().height * figure.get_size_inches()[1] * 72  # type: ignore[union-attr]
    size = float(np.clip(0.85 * share / max(len(names), 1), SMALLEST, 9.0))
    every = max(1, int(np.ceil(len(names) * SMALLEST / max(share, 1.0))))
    axes.set_yticks(range(0, len(names), every), style.labels(names, 18)[::every], fontsize=size)
    axes.tick_params(axis="y", length=0)
    return size if every == 1 else 0.0

"""Long data made as short as a screen can show: no extreme is lost, and the files keep everything."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

MOST_POINTS = 1600  # of a curve
MOST_COLUMNS = 720  # of a map


def thinned(values: np.ndarray, most: int = MOST_POINTS) -> np.ndarray:
    """Indices of the points of a curve that are drawn: in every piece its first, smallest, largest and last.

    Parameters
    ----------
    values : (K,); not-a-number is a gap
    most : points

    Returns increasing indices, all of them where there are few.
    """
    if len(values) <= most:
        return np.arange(len(values))
    kept = [np.array([0, len(values) - 1])]
    for piece in np.array_split(np.arange(len(values)), most // 4):
        part = values[piece]
        kept.append(piece[[0, -1]])
        if np.any(np.isfinite(part)):
            kept.append(piece[[int(np.nanargmin(part)), int(np.nanargmax(part))]])
        gaps = np.flatnonzero(np.diff(np.isnan(part)))  # where a curve breaks off
        kept.append(piece[gaps[:2]])
    return np.unique(np.concatenate(kept))


def columns(edges: np.ndarray, values: np.ndarray, smallest: bool, most: int = MOST_COLUMNS) -> np.ndarray:
    """The values on columns of equal width; what is narrower than a column is represented by its extreme.

    Parameters
    ----------
    edges : (K+1,)
    values : (K, M)
    smallest : whether the extreme is the smallest value, otherwise the largest
    most : columns

    Returns (most, M), or `values` where the edges are as many and equally far apart already.
    """
    lengths = np.diff(edges)
    if len(lengths) <= most and np.ptp(lengths) <= 1e-6 * np.max(lengths):
        return values
    ends = np.linspace(edges[0], edges[-1], most + 1)
    first = np.clip(np.searchsorted(edges, ends[:-1], side="right") - 1, 0, len(values) - 1)
    last = np.clip(np.searchsorted(edges, ends[1:], side="left") - 1, first, len(values) - 1)
    take = np.fmin if smallest else np.fmax
    return np.array([take.reduce(values[a : b + 1], axis=0) for a, b in zip(first, last, strict=True)])


def runs(weights: np.ndarray) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Of every column the stretches of equal positive weight.

    Parameters
    ----------
    weights : (K, M) of numbers or of bool

    Yields (column, starts, ends): weights[start:end, column] are equal and positive.
    """
    for j in range(weights.shape[1]):
        column = weights[:, j].astype(float)
        cuts = np.concatenate([[0], np.flatnonzero(np.abs(np.diff(column)) > 1e-6) + 1, [len(column)]])
        positive = column[cuts[:-1]] > 1e-6
        if np.any(positive):
            yield j, cuts[:-1][positive], cuts[1:][positive]

"""Where the data of a problem varies between the nodes: formulas and tables looked at more closely than any grid.

A formula is sampled at as many times as the check for finite values uses. Cells between neighbouring times over which
it bends by more than BEND of its largest value are halved, again and again, so that a pulse of which a single sample
is seen is followed down to its width. What is narrower than the first cells and between their ends is not seen.
"""

from __future__ import annotations

import numpy as np

from occontrol.core.checks import SAMPLES_BETWEEN
from occontrol.core.signal import ExpressionSignal, Signal, TableSignal

BEND = 0.01
LEVELS = 16
MOST_CELLS = 20_000


def samples(signal: Signal, origin: float, end: float) -> tuple[np.ndarray, np.ndarray]:
    """Times since `origin` (K,) that show how a signal varies over [origin, origin + end], and its values there.

    Parameters
    ----------
    signal : (r, c) Signal
    origin : start of the horizon
    end : length of the horizon

    Returns times (K,) increasing, both ends included, and values (K, r, c).
    """
    if signal.constant:
        times = np.array([0.0, end])
    elif isinstance(signal, TableSignal):
        inside = signal.times - origin
        times = np.concatenate([[0.0], inside[(inside > 0) & (inside < end)], [end]])
    else:
        times = np.linspace(0.0, end, SAMPLES_BETWEEN)
    values = signal.sample(origin + times)
    if not isinstance(signal, ExpressionSignal):
        return times, values
    busy = np.arange(len(times) - 1)
    for _ in range(LEVELS):
        middle = (times[busy] + times[busy + 1]) / 2
        between = signal.sample(origin + middle)
        scale = np.maximum(np.max(np.abs(values), axis=0), np.max(np.abs(between), axis=0, initial=0.0))
        bend = np.abs(between - (values[busy] + values[busy + 1]) / 2)
        cut = np.any(bend > BEND * np.where(scale > 0, scale, 1.0), axis=(1, 2))
        if not np.any(cut) or len(times) + np.sum(cut) > MOST_CELLS:
            break
        at = busy[cut] + 1
        times, values = np.insert(times, at, middle[cut]), np.insert(values, at, between[cut], axis=0)
        # both halves of the cells that were cut are looked at again
        first = busy[cut] + np.arange(len(at))
        busy = np.sort(np.concatenate([first, first + 1]))
    return times, values


def features(signal: Signal, origin: float, end: float) -> np.ndarray:
    """Times since `origin` (K,) between which a formula varies little; empty where the first cells show enough.

    Parameters
    ----------
    signal : Signal
    origin, end : start and length of the horizon
    """
    if not isinstance(signal, ExpressionSignal):
        return np.empty(0)
    times, _ = samples(signal, origin, end)
    if len(times) == SAMPLES_BETWEEN:
        return np.empty(0)
    short = np.diff(times) < 0.75 * end / (SAMPLES_BETWEEN - 1)
    return times[np.append(short, False) | np.insert(short, 0, False)]


def varies_between(times: np.ndarray, values: np.ndarray, at_edges: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """(K,) whether a signal leaves the line between the ends of a span by more than 2 BEND of its largest value.

    Parameters
    ----------
    times, values : (L,) and (L, r, c) from `samples`
    at_edges : (K+1, r, c) its values at the ends of the spans
    edges : (K+1,) the ends, since the origin
    """
    found = np.zeros(len(edges) - 1, dtype=bool)
    scale = np.max(np.abs(values), axis=0)
    span = np.clip(np.searchsorted(edges, times, side="right") - 1, 0, len(found) - 1)
    share = ((times - edges[span]) / (edges[span + 1] - edges[span]))[:, None, None]
    line = at_edges[span] * (1 - share) + at_edges[span + 1] * share
    off = np.any(np.abs(values - line) > 2 * BEND * np.where(scale > 0, scale, 1.0), axis=(1, 2))
    found[span[off]] = True
    return found

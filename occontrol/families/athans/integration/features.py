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
ASIDE = 1e-10  # of the horizon, from which a known jump is looked at


def samples(signal: Signal, origin: float, end: float) -> tuple[np.ndarray, np.ndarray]:
    """Times since `origin` (K,) that show how a signal varies over [origin, origin + end], and its values there.

    Parameters
    ----------
    signal : (r, c) Signal
    origin : start of the horizon
    end : length of the horizon

    Returns times (K,) increasing, both ends included, and values (K, r, c).
    """
    return _looked(signal, origin, end)[:2]


def _looked(signal: Signal, origin: float, end: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The same, and how often each of the K - 1 cells between the times was halved."""
    if signal.constant:
        times = np.array([0.0, end])
    elif isinstance(signal, TableSignal):
        inside = signal.times - origin
        times = np.concatenate([[0.0], inside[(inside > 0) & (inside < end)], [end]])
    else:
        times = np.linspace(0.0, end, SAMPLES_BETWEEN)
    breaks = np.empty(0)
    if isinstance(signal, ExpressionSignal):  # a known jump is seen from both sides, and nothing is halved around it
        breaks = _inside(signal, origin, end)
        sides = np.concatenate([breaks - end * ASIDE, breaks + end * ASIDE])
        times = np.union1d(times[~_beside(times, breaks, end)], sides)
    values = signal.sample(origin + times)
    halved = np.zeros(len(times) - 1, dtype=np.int64)
    if not isinstance(signal, ExpressionSignal):
        return times, values, halved
    busy = np.flatnonzero(~_beside((times[1:] + times[:-1]) / 2, breaks, end))
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
        halved[busy[cut]] += 1
        halved = np.insert(halved, at, halved[busy[cut]])
        # both halves of the cells that were cut are looked at again
        first = busy[cut] + np.arange(len(at))
        busy = np.sort(np.concatenate([first, first + 1]))
    return times, values, halved


def _inside(signal: Signal, origin: float, end: float) -> np.ndarray:
    """Jumps of a formula well inside the horizon, since `origin`."""
    breaks = signal.breaks(origin, origin + end) - origin
    return breaks[(breaks > 2 * ASIDE * end) & (breaks < (1 - 2 * ASIDE) * end)]


def _beside(times: np.ndarray, breaks: np.ndarray, end: float) -> np.ndarray:
    """(K,) whether times lie at one of the breaks, or as near as it is looked at."""
    if not len(breaks):
        return np.zeros(len(times), dtype=bool)
    right = np.clip(np.searchsorted(breaks, times), 0, len(breaks) - 1)
    nearest = np.minimum(np.abs(breaks[right] - times), np.abs(breaks[np.maximum(right - 1, 0)] - times))
    return nearest <= 1.5 * ASIDE * end


def features(signal: Signal, origin: float, end: float) -> np.ndarray:
    """Times since `origin` (K,) between which a formula varies little; empty where the first cells show enough.

    Parameters
    ----------
    signal : Signal
    origin, end : start and length of the horizon
    """
    if not isinstance(signal, ExpressionSignal):
        return np.empty(0)
    times, _, halved = _looked(signal, origin, end)
    short = halved > 0
    times = times[np.append(short, False) | np.insert(short, 0, False)]
    return times[~_beside(times, _inside(signal, origin, end), end)]


def sided(signal: Signal, origin: float, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values (K, r, c) where K spans begin and where they end; just inside where the signal is known to jump.

    Parameters
    ----------
    signal : (r, c) Signal
    origin : start of the horizon
    edges : (K+1,) the ends of the spans, since the origin
    """
    if not (isinstance(signal, ExpressionSignal) and len(_inside(signal, origin, float(edges[-1])))):
        values = signal.sample(origin + edges)
        return values[:-1], values[1:]
    aside = ASIDE * float(edges[-1])
    return signal.sample(origin + edges[:-1] + aside), signal.sample(origin + edges[1:] - aside)


def varies_between(
    times: np.ndarray, values: np.ndarray, begins: np.ndarray, ends: np.ndarray, edges: np.ndarray
) -> np.ndarray:
    """(K,) whether a signal leaves the line between the ends of a span by more than 2 BEND of its largest value.

    Parameters
    ----------
    times, values : (L,) and (L, r, c) from `samples`
    begins, ends : (K, r, c) its values just inside the spans, where each begins and ends
    edges : (K+1,) the ends, since the origin
    """
    found = np.zeros(len(edges) - 1, dtype=bool)
    scale = np.max(np.abs(values), axis=0)
    span = np.clip(np.searchsorted(edges, times, side="right") - 1, 0, len(found) - 1)
    share = ((times - edges[span]) / (edges[span + 1] - edges[span]))[:, None, None]
    line = begins[span] * (1 - share) + ends[span] * share
    off = np.any(np.abs(values - line) > 2 * BEND * np.where(scale > 0, scale, 1.0), axis=(1, 2))
    found[span[off]] = True
    return found

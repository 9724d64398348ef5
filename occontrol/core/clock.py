"""When are two times the same? One answer for the whole package.

Times may be counted from anywhere (Unix time stamps) and in any unit (nanoseconds), so a tolerance is a share of the
interval in which a time lies, plus what the number itself cannot resolve:

    |a - b| <= SHARE * spacing + ULPS * ulp(max |a|, |b|)

Lengths are taken from times since the start, where they keep their digits.
"""

from __future__ import annotations

import numpy as np

SHARE = 1e-9  # of an interval: what is left of a time after decimal output with ten digits
ULPS = 4.0  # of the larger time: a few roundings of its own


def resolution(*times: np.ndarray | float) -> float:
    """ULPS units in the last place of the largest of `times`: what arithmetic on them may lose.

    Each of `times` is a number or (K,), in the unit of time.
    """
    largest = max(float(np.max(np.abs(t), initial=0.0)) for t in map(np.atleast_1d, times))
    return ULPS * float(np.spacing(largest))


def tolerance(spacing: float, *times: np.ndarray | float) -> float:
    """How far apart two times may be and still be the same.

    Parameters
    ----------
    spacing : length of the interval, or of the window, that is at stake, in the unit of time
    times : numbers or (K,), in the unit of time, whose own rounding counts
    """
    return SHARE * float(spacing) + resolution(*times)


def nearest_edge(times: np.ndarray, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The nearest edge of each time, and whether the two are one and the same.

    Parameters
    ----------
    times : (K,), in the unit of time
    edges : (N+1,) increasing times

    Returns index (K,) and same (K,). The spacing is that of the shorter interval beside the edge.
    """
    times, edges = np.asarray(times, dtype=float), np.asarray(edges, dtype=float)
    right = np.clip(np.searchsorted(edges, times), 1, len(edges) - 1)
    index = np.where(times - edges[right - 1] < edges[right] - times, right - 1, right)
    steps = np.diff(edges)
    beside = np.minimum(steps[np.maximum(index - 1, 0)], steps[np.minimum(index, len(steps) - 1)])
    ulp = ULPS * np.spacing(np.maximum(np.abs(times), np.abs(edges[index])))
    # four ulps must not swallow an interval that is itself a few ulps long
    return index, np.abs(times - edges[index]) <= np.minimum(SHARE * beside + ulp, 0.25 * beside)


def lengths(edges: np.ndarray) -> np.ndarray:
    """(N,) lengths between edges; exactly equal where `elapsed` finds the edges equally spaced.

    Parameters
    ----------
    edges : (N+1,) increasing times
    """
    since = elapsed(edges)
    steps = np.diff(since)
    equal = since[-1] / len(steps)
    # rounding of the running sum only
    return np.full(len(steps), equal) if np.all(np.abs(steps - equal) <= 2 * np.spacing(since[-1])) else steps


def elapsed(edges: np.ndarray) -> np.ndarray:
    """(N+1,) times since the first edge; equally spaced ones, as the doubles allow to say, are made exactly so.

    Edges such as 1700000000.01, 1700000000.02, .. carry their lengths to 2e-5 only. If no edge is further than its
    own rounding from an equal spacing, that spacing is what was meant.

    Parameters
    ----------
    edges : (N+1,) increasing times
    """
    edges = np.asarray(edges, dtype=float)
    since = edges - edges[0]
    equal = np.linspace(0.0, since[-1], len(edges))
    lost = np.spacing(np.max(np.abs(edges)))
    if np.all(np.abs(since - equal) <= lost) and lost < 1e-3 * since[-1] / (len(edges) - 1):
        return equal
    return since

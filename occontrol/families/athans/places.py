"""Whether every interval has as many sensors as are to be used at a time."""

from __future__ import annotations

import numpy as np

from occontrol.core.errors import InfeasibleError

MOST_GAPS = 10  # of a window plan that are named


def require_places(upper: np.ndarray, select: int, edges: np.ndarray) -> None:
    """Raise InfeasibleError, with the times, where windows leave fewer than `select` places filled.

    Parameters
    ----------
    upper : (N, M) largest weights
    select : how many sensors are used at a time
    edges : (N+1,) of the intervals
    """
    places = np.rint(np.sum(upper, axis=1)).astype(int)
    lacking = places < select
    if not np.any(lacking):
        return
    # neighbours with the same lack are one gap, and all gaps are named at once
    label = np.where(lacking, places, -1)
    starts = np.flatnonzero(np.diff(label, prepend=-2) != 0)
    ends = np.append(starts[1:], len(label))
    gaps = [(a, b) for a, b in zip(starts, ends, strict=True) if lacking[a]]
    shown = [f"{edges[a]:.6g} and {edges[b]:.6g}" for a, b in gaps[:MOST_GAPS]]
    more = f", and in {len(gaps) - MOST_GAPS} more places" if len(gaps) > MOST_GAPS else ""
    count = int(np.min(places[lacking]))
    have = (
        "no sensor is"
        if count == 0
        else f"only {count} of the {select} sensors to select {'is' if count == 1 else 'are'}"
    )
    raise InfeasibleError(
        f"between t = {', '.join(shown)}{more} {have} available\n"
        "  hint: widen a window, put an edge of the grid at the window's end, or add 'idle' to the sensors"
    )

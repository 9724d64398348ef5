"""What the times of rules become on the edges of a grid, as numbers of intervals from every edge on.

min_on, min_off, warm_up and switch_delay are rounded up, max_on is rounded down, both within 1e-9 of the horizon; a use
has at least one interval. On equal steps every edge has the same numbers, also where they reach beyond the end.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occontrol.scheduling.rules.rules import Rules

TOLERANCE = 1e-9  # of the horizon
NEVER = 1 << 30


@dataclass(frozen=True, eq=False)
class Counts:
    """Numbers of intervals, counted from edge k; NEVER where a limit is never met inside the horizon.

    Parameters
    ----------
    need : (N, M) that a use which starts at k has at least
    most : (N, M) that it has at most, 0 where none may start
    off : (N, M) after which a sensor that stops at k may start again
    warm : (N, M) during which a use which starts at k measures nothing
    delay : (N, M, M) between the end of i at k and the start of j
    gap : (N, M) within which a sensor that is last used before k must be used again
    """

    need: np.ndarray
    most: np.ndarray
    off: np.ndarray
    warm: np.ndarray
    delay: np.ndarray
    gap: np.ndarray


class Grid:
    """Edges of a horizon, and searches on them.

    Parameters
    ----------
    edges : (N+1,) increasing times
    """

    def __init__(self, edges: np.ndarray):
        self.times = np.asarray(edges, dtype=float) - float(edges[0])
        self.intervals = len(self.times) - 1
        self.steps = np.diff(self.times)
        self.slack = TOLERANCE * self.times[-1]
        step = self.times[-1] / self.intervals
        equal = np.abs(self.times - step * np.arange(self.intervals + 1)) <= 1e-3 * self.slack
        self.step = step if np.all(equal) else None

    def up(self, length: float) -> np.ndarray:
        """(N,) the fewest intervals from every edge on that last `length` or longer."""
        N, t = self.intervals, self.times
        if self.step is not None:
            return np.full(N, max(int(np.ceil((length - self.slack) / self.step)), 0))
        found = np.searchsorted(t, t[:-1] + length - self.slack, side="left")
        count = np.maximum(found - np.arange(N), 0)
        return np.where(found > N, N + 1 - np.arange(N), count)

    def down(self, length: float) -> np.ndarray:
        """(N,) the most intervals from every edge on that last `length` or less; NEVER where the horizon ends first."""
        if not np.isfinite(length):
            return np.full(self.intervals, NEVER)
        N, t = self.intervals, self.times
        if self.step is not None:
            count = int(np.floor((length + self.slack) / self.step))
            return np.full(N, count if count < N else NEVER)
        found = np.searchsorted(t, t[:-1] + length + self.slack, side="right") - 1
        return np.where(found >= N, NEVER, found - np.arange(N))


def counts(rules: Rules, grid: Grid) -> Counts:
    """All limits of the rules as numbers of intervals.

    Parameters
    ----------
    rules : Rules
    grid : Grid
    """
    N, M = grid.intervals, rules.sensors

    def each(values: np.ndarray, rounded) -> np.ndarray:
        known = {float(v): rounded(float(v)) for v in np.unique(values)}
        return np.stack([known[float(v)] for v in values.ravel()], axis=-1).reshape(N, *values.shape).astype(np.int64)

    gap = each(rules.revisit, grid.down)
    return Counts(
        need=np.maximum(each(rules.min_on, grid.up), 1),
        most=each(rules.max_on, grid.down),
        off=each(rules.min_off, grid.up),
        warm=each(rules.warm_up, grid.up),
        delay=each(rules.switch_delay, grid.up).reshape(N, M, M),
        gap=np.where(gap == NEVER, NEVER, gap + 1),
    )


@dataclass(frozen=True)
class History:
    """What is left of a use that was going on at the start.

    Parameters
    ----------
    sensor : which
    need, most : intervals that it must still last, and may last at most
    """

    sensor: int
    need: int
    most: int


def history(rules: Rules, grid: Grid) -> History | None:
    """The use that `before` states, or None.

    Parameters
    ----------
    rules : Rules
    grid : Grid
    """
    if rules.before is None:
        return None
    j, elapsed = rules.before
    left = rules.min_on[j] - elapsed
    need = 0 if left <= grid.slack else int(grid.up(float(left))[0])
    rest = float(rules.max_on[j] - elapsed)
    most = int(grid.down(rest)[0]) if rest > -grid.slack else 0
    return History(j, need, max(most, 0))

"""Schedules that wait to be bettered by moving blocks, a little at every node of a tree.

The best schedule comes first, until no move betters it; then those that the nodes met, the cheapest first, which lead
to other ends. Evaluations are counted out node by node; where they lead to nothing better they become fewer.
"""

from __future__ import annotations

import heapq

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.scheduling.rules.moves import Mover, Scored

EACH, LEAST = 60.0, 6.0  # evaluations for each node, at first and after many vain attempts
PIECE = 2000  # evaluations of one attempt
WAITING = 40  # schedules
FAR = 0.25  # above the best: what is not worth it


class Pool:
    """What waits.

    Parameters
    ----------
    mover : Mover
    """

    def __init__(self, mover: Mover):
        self.mover = mover
        self._waiting: list[tuple[float, int, Scored]] = []
        self._number, self._left, self._rate = 0, 0.0, EACH

    def offer(self, found: Scored, least: float) -> None:
        """Keep a schedule in mind; `least` is the cost of the best one."""
        if not np.isfinite(found.value) or found.value > least + FAR * abs(least):
            return
        self._number += 1
        heapq.heappush(self._waiting, (found.value, self._number, found))
        if len(self._waiting) > 2 * WAITING:
            self._waiting = heapq.nsmallest(WAITING, self._waiting)

    def spend(self, best: Scored | None, monitor: Monitor) -> Scored | None:
        """A schedule that is better than the best, if this node's evaluations lead to one.

        Parameters
        ----------
        best : the best schedule that is known
        monitor : Monitor
        """
        self._left += self._rate
        if self._left < 0 or best is None:
            return None
        if not best.settled:
            start = best
        elif self._waiting:
            start = heapq.heappop(self._waiting)[2]
        else:
            self._left = 0.0
            return None
        before = self.mover.evaluations
        found = self.mover.improve(start, PIECE, monitor)
        self._left -= self.mover.evaluations - before
        if found.value < best.value:
            self._rate = EACH
            return found
        self._rate = max(0.7 * self._rate, LEAST)
        if start is best:
            best.settled = True
        return None

"""A tree of schedules under rules that grows at several places at once.

Every place keeps a search with tangents of its own, and gets its share of the open nodes, the best bounds dealt out in
turn; after a few nodes all come back. Rounds are counted in nodes, so that what is found does not hang on the clock.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.scheduling.rules.bundle import Bundle
from occontrol.scheduling.rules.master import Tangent
from occontrol.scheduling.rules.moves import Scored
from occontrol.scheduling.rules.plan import Plan
from occontrol.scheduling.rules.task import Task
from occontrol.scheduling.rules.tree import Node, Search, TreeOptions

ROUND = 8  # nodes of a place before nodes are dealt out again


@dataclass
class Part:
    """A search that goes on elsewhere, on nodes that are handed to it.

    Parameters
    ----------
    number : which of the parts it is
    task, options : of the search
    seeds : plans to begin with
    tangents : to begin with
    """

    number: int
    task: Task
    options: TreeOptions
    seeds: list[Plan]
    tangents: list[Tangent]
    search: Search | None = None


def grown(
    part: Part, nodes: list[list[Node]], best: Scored | None, seconds: float, most: int
) -> tuple[list[Node], float, Scored | None, int]:
    """Open nodes, what all others cost at least, the best schedule, and how many nodes were solved.

    Parameters
    ----------
    part : Part
    nodes : of every part
    best : the best schedule that is known
    seconds : after which to stop
    most : nodes
    """
    search = part.search
    if search is None:
        search = part.search = Search(part.task, part.options, Monitor(), [])
        for plan in part.seeds:
            search.bundle.add(plan)  # type: ignore[union-attr]
        for at in part.tangents:
            search.bundle.take(at)  # type: ignore[union-attr]
    search.monitor = Monitor(time_limit=seconds)
    if best is not None and (search.best is None or best.value < search.best.value):
        search.best = best
    heap, closed, before = list(nodes[part.number]), np.inf, search.nodes
    heapq.heapify(heap)
    while heap and search.nodes - before < most and not search.monitor.stop:
        closed = min(closed, search.step(heap))
    return heap, closed, search.best, search.nodes - before


class Apart:
    """The nodes of a search, dealt out to several places round by round; what a round finds does not hang on time.

    Parameters
    ----------
    search : with tangents and schedules of its first node
    """

    def __init__(self, search: Search):
        spread, self.search = search.monitor.spread, search
        bundle: Bundle = search.bundle  # type: ignore[assignment]
        parts = [Part(i, search.task, search.options, bundle.plans, search.tangents) for i in range(spread.count)]
        self._ask, self._worth = spread.hold(grown, parts), 2 * spread.count
        self._count = spread.count

    @property
    def worth(self) -> int:
        """Nodes from which it pays."""
        return self._worth

    def round(self, heap: list[Node], most: int) -> float:
        """Go on for a few nodes at every place; what the schedules cost at least that this leaves."""
        search, limit = self.search, self.search.monitor.time_limit
        seconds = np.inf if limit is None else max(limit - search.monitor.seconds, 0.0)
        order = sorted(heap)
        dealt = [order[i :: self._count] for i in range(self._count)]
        each = max(1, min(ROUND, most // self._count))
        found = self._ask(dealt, search.best, seconds, each)
        heap[:] = [node for part in found for node in part[0]]
        heapq.heapify(heap)
        for _, _, best, nodes in found:
            search.nodes += nodes
            if best is not None and (search.best is None or best.value < search.best.value):
                search.best = best
                search.told(best)
        return min(closed for _, closed, _, _ in found)

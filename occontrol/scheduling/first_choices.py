"""Lower bounds by fixing decisions one after the other, best first: for plans whose first readings decide.

A node is a set of schedules that begin alike. Its bound is that of its relaxation; the node with the lowest bound is
replaced by one node for every choice at its next decision, and the lowest bound of all open nodes holds for every
schedule. With a large initial covariance a relaxation reads all sensors a little at once, and fixing the first decision
alone takes most of the gap away.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.core.solution import Status
from occontrol.scheduling.feasible_set import IntervalPolytopes
from occontrol.scheduling.objective import Objective
from occontrol.scheduling.relaxation import RelaxedOptions, RelaxedOutcome, minimise_relaxed

MOST_CHOICES = 64
MOST_STEPS = 200  # of a node's relaxation
FIXED = 1e-9


@dataclass(frozen=True)
class TreeLimits:
    """When to stop.

    Parameters
    ----------
    relative_gap : of the incumbent, at which its cost counts as reached
    gradients : that may be spent
    node_gap : to which every node's relaxation is solved
    patience : nodes in a row that may be opened without raising the bound by `worth` of the gap; None is no limit
    worth : share of the gap
    nodes : relaxations that may be solved
    absolute : whether gaps are differences: costs that hold a logarithm
    """

    relative_gap: float
    gradients: int
    node_gap: float = 1e-3
    patience: int | None = None
    worth: float = 0.01
    nodes: int = 1_000_000
    absolute: bool = False

    def size(self, cost: float) -> float:
        """What gaps are shares of, for a `cost`."""
        return 1.0 if self.absolute else abs(cost)

    def relaxation(self, steps: int) -> RelaxedOptions:
        """Of one node, in at most `steps`."""
        return RelaxedOptions(self.node_gap, steps, absolute_gap=self.node_gap if self.absolute else None)


@dataclass(frozen=True, eq=False)
class TreeOutcome:
    """What was found.

    Parameters
    ----------
    lower_bound : for every schedule of the set
    weights : (N, M) the best schedule met, or None where none beats the incumbent
    cost : of that
    nodes : relaxations solved
    closed : whether every open node costs at least the incumbent, but for the gap asked for
    """

    lower_bound: float
    weights: np.ndarray | None
    cost: float
    nodes: int
    closed: bool


def choices(upper: np.ndarray, places: int) -> list[np.ndarray] | None:
    """Every integral way (M,) to fill `places` of one decision with at most `upper` (M,); None where there are many.

    Parameters
    ----------
    upper : (M,) largest weights
    places : sum of the weights
    """
    open_ = [j for j in range(len(upper)) if upper[j] > 0.5]
    found: list[list[int]] = [[]]
    for j in open_:
        found = [f + [x] for f, x in product(found, range(round(float(upper[j])) + 1)) if sum(f) + x <= places]
        if len(found) > 64 * MOST_CHOICES:
            return None
    whole = [f for f in found if sum(f) == places]
    if not 1 <= len(whole) <= MOST_CHOICES:
        return None
    result = np.zeros((len(whole), len(upper)))
    result[:, open_] = whole
    return list(result)


def branch(
    objective: Objective,
    feasible_set: IntervalPolytopes,
    root: RelaxedOutcome,
    incumbent: float,
    limits: TreeLimits,
    monitor: Monitor,
) -> TreeOutcome:
    """The best bound that can be had by fixing first decisions.

    Parameters
    ----------
    objective : whose value at a whole schedule is its cost
    feasible_set : IntervalPolytopes of the policies (N, M)
    root : relaxation of all of them, or a policy to start from whose bound may be -inf
    incumbent : cost of the best schedule known
    limits : TreeLimits
    monitor : Monitor

    A bound is never above the least cost of the set; one that is stopped early is that of the nodes still open.
    """
    spent = objective.backward_count + limits.gradients
    best, best_weights, nodes = incumbent, None, 0
    # what stands for `number` keeps the order of nodes with equal bounds
    heap: list[tuple[float, int, int, np.ndarray, np.ndarray]] = []
    first = _open_decision(feasible_set.upper, feasible_set.places, 0)
    heap.append((root.lower_bound, 0, first, feasible_set.upper, root.weights))
    options = limits.relaxation(MOST_STEPS)
    bound, stale, finished = root.lower_bound, 0, np.inf
    while heap and not monitor.stop and objective.backward_count < spent and nodes < limits.nodes:
        lowest, _, depth, upper, weights = heap[0]
        if lowest >= best - limits.relative_gap * limits.size(best) or finished <= lowest:
            break
        if limits.patience is not None and nodes:
            stale = 0 if lowest > bound + limits.worth * (best - bound) else stale + 1
            if stale > limits.patience:
                break
        bound = max(bound, lowest)
        ways = choices(upper[depth], feasible_set.places) if depth < len(upper) else None
        if ways is None:
            break
        heapq.heappop(heap)
        for way in ways:
            child = upper.copy()
            child[depth] = way
            nodes += 1
            following = _open_decision(child, feasible_set.places, depth + 1)
            if following == len(child):  # a whole schedule: its cost is its bound
                whole = feasible_set.vertex(np.where(child > 0.5, -1.0, 0.0))
                cost = objective.cost(whole)
                finished = min(finished, cost - FIXED * limits.size(cost))
            else:
                allowed = replace(feasible_set, upper=child)
                start = weights.copy()
                start[depth] = way
                found = minimise_relaxed(objective, allowed, allowed.project(start), options, monitor.silent())
                value = lowest if found.status is Status.DISAGREES else max(found.lower_bound, lowest)
                heapq.heappush(heap, (value, nodes, following, child, found.weights))
                whole = allowed.round(found.weights)
                cost = objective.cost(whole)
            if cost < best:
                best, best_weights = cost, whole
    lower = min(heap[0][0] if heap else np.inf, finished, best)
    closed = lower >= best - max(limits.relative_gap, FIXED) * limits.size(best)
    return TreeOutcome(max(lower, root.lower_bound), best_weights, best, nodes, closed)


def _open_decision(upper: np.ndarray, places: int, first: int) -> int:
    """The first decision from `first` on at which there is a choice; the number of decisions where there is none."""
    free = np.flatnonzero(np.sum(upper[first:], axis=1) > places + FIXED)
    return first + int(free[0]) if len(free) else len(upper)

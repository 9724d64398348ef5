"""Lower bounds by deciding single readings, best first: for decisions with too many choices to list.

A node fixes some readings as taken and some as left out. The node with the lowest bound is parted at the reading that
is split most, weighted with its gradient, into the node that takes it and the node that leaves it out.
"""

from __future__ import annotations

import heapq

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.core.solution import Status
from occontrol.scheduling.committed import Committed
from occontrol.scheduling.feasible_set import IntervalPolytopes
from occontrol.scheduling.first_choices import FIXED, TreeLimits, TreeOutcome
from occontrol.scheduling.objective import Objective
from occontrol.scheduling.relaxation import RelaxedOutcome, minimise_relaxed

MOST_STEPS = 60  # of a node's relaxation
MOST_BYTES = 4e8  # of open nodes
OPEN, TAKEN, LEFT = -1, 1, 0


def branch_singly(
    objective: Objective,
    feasible_set: IntervalPolytopes,
    root: RelaxedOutcome,
    incumbent: float,
    limits: TreeLimits,
    monitor: Monitor,
) -> TreeOutcome:
    """The best bound that can be had by deciding single readings.

    Parameters
    ----------
    objective : whose value at a whole schedule is its cost
    feasible_set : IntervalPolytopes of the policies (N, M)
    root : relaxation of all of them
    incumbent : cost of the best schedule known
    limits : TreeLimits; patience is not looked at
    monitor : Monitor

    A bound is never above the least cost of the set; one that is stopped early is that of the nodes still open.
    """
    spent = objective.backward_count + limits.gradients
    most = min(limits.nodes, int(MOST_BYTES / (10 * feasible_set.upper.size)))
    best, best_weights, nodes, finished = incumbent, None, 0, np.inf
    options = limits.relaxation(MOST_STEPS)
    single = feasible_set.upper == 1.0
    state = np.where(single, OPEN, LEFT).astype(np.int8)
    heap = [(root.lower_bound, 0, state, root.weights.astype(np.float32), _score(root.weights, root.gradient))]
    while heap and not monitor.stop and objective.backward_count < spent and nodes < most:
        lowest = heap[0][0]
        if lowest >= best - limits.relative_gap * limits.size(best) or finished <= lowest:
            break
        lowest, _, state, weights, score = heapq.heappop(heap)
        k, j = np.unravel_index(np.argmax(np.where(state == OPEN, score, -1.0)), state.shape)
        for way in (LEFT, TAKEN):
            child = state.copy()
            child[k, j] = way
            allowed = _decided(feasible_set, child, single, int(k))
            if allowed is None:
                continue
            nodes += 1
            if not np.any(child == OPEN):  # a whole schedule: its cost is its bound
                whole = allowed.vertex(np.zeros(allowed.shape))
                cost = objective.cost(whole)
                finished = min(finished, cost - FIXED * limits.size(cost))
            else:
                start = allowed.project(weights.astype(float))
                found = minimise_relaxed(objective, allowed, start, options, monitor.silent())
                value = lowest if found.status is Status.DISAGREES else max(found.lower_bound, lowest)
                kept = found.weights.astype(np.float32)
                heapq.heappush(heap, (value, nodes, child, kept, _score(found.weights, found.gradient)))
                whole = allowed.round(found.weights)
                cost = objective.cost(whole)
            if cost < best:
                best, best_weights = cost, whole
    lower = min(heap[0][0] if heap else np.inf, finished, best)
    closed = lower >= best - max(limits.relative_gap, FIXED) * limits.size(best)
    return TreeOutcome(max(lower, root.lower_bound), best_weights, best, nodes, closed)


def _score(weights: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """(N, M) how much a reading is split, weighted with what it is worth; nowhere negative."""
    split = np.clip(weights * (1.0 - weights), 0.0, None)
    return ((split + 1e-9) * np.abs(gradient)).astype(np.float32)


def _decided(feasible_set: IntervalPolytopes, state: np.ndarray, single: np.ndarray, k: int) -> Committed | None:
    """The set of a node; None where interval k cannot be filled. What interval k leaves no choice is decided in state.

    Parameters
    ----------
    feasible_set : of all policies
    state : (N, M) OPEN, TAKEN or LEFT; changed in place
    single : (N, M) which weights are decided; the others are idle's, and closed ones
    k : the interval that was changed
    """
    places, rest = feasible_set.places, feasible_set.upper[k][~single[k]].sum()
    taken, open_ = np.sum(state[k] == TAKEN), np.sum(state[k] == OPEN)
    if taken > places or taken + open_ + rest < places:
        return None
    if taken == places:
        state[k][state[k] == OPEN] = LEFT
    elif taken + open_ + rest == places:
        state[k][state[k] == OPEN] = TAKEN
    upper = np.where(single, (state != LEFT).astype(float), feasible_set.upper)
    full = np.sum(state == TAKEN, axis=1) == places
    upper[full] = np.where(single[full], upper[full], 0.0)
    return Committed(upper, places, feasible_set.edges, feasible_set.names, state == TAKEN)

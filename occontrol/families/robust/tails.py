"""The last slots by themselves: most of the relaxation's gap comes from sharing them, so they are branched on first.

A tail is a choice for the last d slots. Its planes come from the relaxation in which only the slots before may be
shared, so they are higher than those of the whole problem. Tails whose bound reaches the best known size are proven
away; every sequence that is better ends in one of those that remain.
Unknowns: one sensor per slot of the tail, shares (N, M) before it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.families.robust.bound import ExactSweep, Plane, plane_of, value_of, walk
from occontrol.families.robust.slots import Slots
from occontrol.scheduling.feasible_set import IntervalPolytopes

LONGEST_TAIL = 8  # slots of a tail
MOST_TAILS = 24  # tails
RELAXATION_STEPS = 25  # of each relaxation


@dataclass(frozen=True, eq=False)
class Tail:
    """A choice for the last slots.

    Parameters
    ----------
    choices : (d,) sensors of the last d slots
    weights : (N, M) shares, whole in the last d slots
    planes : of the relaxation with this tail
    bound : what they prove at the start
    """

    choices: tuple[int, ...]
    weights: np.ndarray
    planes: tuple[Plane, ...]
    bound: float


def branch_on_tails(
    slots: Slots, weights: np.ndarray, plane: Plane, bound: float, cost: float, target: float, monitor: Monitor
) -> list[Tail]:
    """Tails of equal length that hold every sequence below `cost`.

    Parameters
    ----------
    slots : Slots
    weights, plane, bound : (N, M), and the plane and bound there: the relaxation of the whole problem
    cost : the best known size; tails that cannot beat it are left out
    target : relative gap below which branching ends
    monitor : for time and interruption

    Returns the tails, one of length zero when branching does not pay.
    """
    tails = [Tail((), weights, (plane,), bound)]
    for depth in range(1, min(LONGEST_TAIL, slots.count - 1) + 1):
        least = min(tail.bound for tail in tails)
        if (
            cost - least <= target * abs(cost)
            or len(tails) * slots.sensors > slots.spans.affordable(MOST_TAILS)
            or monitor.stop
        ):
            break
        children = [_child(slots, tail, sensor, depth, monitor) for tail in tails for sensor in range(slots.sensors)]
        left = [child for child in children if child.bound < cost]
        if not left:
            return []
        tails = left
    return tails


def _child(slots: Slots, parent: Tail, sensor: int, depth: int, monitor: Monitor) -> Tail:
    from occontrol.scheduling.relaxation import RelaxedOptions, minimise_relaxed

    slot = slots.count - depth
    upper = np.ones((slots.count, slots.sensors))
    choices = (sensor, *parent.choices)
    for k, choice in enumerate(choices, start=slot):
        upper[k] = np.eye(slots.sensors)[choice]
    weights = parent.weights.copy()
    weights[slot] = upper[slot]
    sweep, allowed, watch = ExactSweep(slots, slots.start), IntervalPolytopes(upper, 1), monitor.child(silent=True)
    options = RelaxedOptions(1e-4, slots.spans.affordable(RELAXATION_STEPS))
    weights = minimise_relaxed(sweep, allowed, weights, options, watch).weights
    power = sweep.power if slots.size.has_kink else np.inf
    plane = plane_of(slots, weights, walk(slots, weights, slots.start, power=power), allowed=allowed)
    # the parent's planes hold for every longer tail
    bound = max(parent.bound, value_of(plane, 0, slots.start))
    return Tail(choices, weights, (*parent.planes, plane)[-3:], bound)


def tail_bounds(
    tails: list[Tail], edge: int, count: int, information: np.ndarray, sequences: np.ndarray, proven: float
) -> np.ndarray:
    """The least bound over the tails that each node may still end in.

    Parameters
    ----------
    tails : of equal length d
    edge, count : the nodes' edge, and N
    information : (R, n, n) N^-1 of the nodes
    sequences : (R, edge) what the nodes have chosen
    proven : the size below which no sequence ends in any other tail

    Returns (R,) bounds, at most `proven`.
    """
    bound = np.full(len(information), proven)
    first = count - (len(tails[0].choices) if tails else 0)
    for tail in tails:
        own = np.full(len(information), -np.inf)
        for plane in tail.planes:
            if np.isfinite(plane.constant[edge]):
                own = np.maximum(own, plane.constant[edge] - np.einsum("ij,rij->r", plane.slope[edge], information))
        if edge > first:
            fits = np.all(sequences[:, first:] == np.array(tail.choices[: edge - first]), axis=1)
            own = np.where(fits, own, np.inf)
        bound = np.minimum(bound, own)
    return bound

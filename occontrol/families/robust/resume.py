"""What a resumed search takes from an earlier solution of its problem: the sequence, and the bound that was proven."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.families.robust.slots import Slots

AGREEMENT = 1e-8  # relative, between the cost that is stated and the one that the sequence has
EXACT = 1e-12  # by so much a weight may miss 0 and 1, and an edge its place in the horizon


@dataclass(frozen=True)
class Earlier:
    """What is gone on from: a sequence of sensors, and a bound for all of them (-inf where there is none)."""

    sequence: list[int]
    lower_bound: float


def earlier_search(slots: Slots, names: list[str], monitor: Monitor) -> Earlier | None:
    """The earlier solution that the monitor brings, or None to begin anew.

    Its cost is computed again. Its bound counts only where that cost is the one it states, where the method was
    `optimal`, and where its own sequence does not cost less than the bound.

    Parameters
    ----------
    slots : Slots of the problem
    names : of its sensors, in their order
    monitor : Monitor, whose `resumed` is set when there is a sequence to go on from
    """
    solution = monitor.resume
    if solution is None or solution.family != "robust" or solution.schedule is None:
        return None
    schedule = solution.schedule
    weights = np.asarray(schedule.weights)
    if list(schedule.names) != names or weights.shape != (slots.count, slots.sensors):
        return None
    if not np.allclose(schedule.edges, slots.edges, rtol=EXACT, atol=EXACT * float(slots.edges[-1])):
        return None
    sequence = [int(i) for i in np.argmax(weights, axis=1)]
    if not np.allclose(weights, np.eye(slots.sensors)[sequence], atol=EXACT):
        return None  # shares are no sequence
    cost, monitor.resumed = slots.cost(sequence), True
    found = solution.certificate
    known = solution.method == "optimal" and found is not None and abs(found.cost - cost) <= AGREEMENT * abs(cost)
    bound = found.lower_bound if known and found is not None and found.lower_bound <= cost * (1 + EXACT) else -np.inf
    return Earlier(sequence, float(bound))

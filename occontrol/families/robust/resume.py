"""What a resumed search takes from an earlier solution of its problem: the sequence, and nothing else.

A run folder may come from anybody. A sequence can be judged, its cost is computed again; a bound cannot, so it is
proven anew.
"""

from __future__ import annotations

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.families.robust.slots import Slots

EXACT = 1e-12  # by so much a weight may miss 0 and 1, and an edge its place in the horizon


def earlier_sequence(slots: Slots, names: list[str], monitor: Monitor) -> list[int] | None:
    """The sensor of every slot (N,) of the earlier solution that the monitor brings, or None to begin anew.

    What it states, cost and bound, is not looked at.

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
    monitor.resumed = True
    return sequence

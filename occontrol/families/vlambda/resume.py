"""What a resumed search takes from an earlier solution of its problem: the choices, and nothing else.

A run folder may come from anybody. Choices can be judged, their cost is computed again; a bound cannot, so it is proven
anew.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.families.vlambda.baselines import SequenceChooser
from occontrol.families.vlambda.result import numbers_of, recorded
from occontrol.families.vlambda.selection import Selection, run_selection

if TYPE_CHECKING:
    from occontrol.families.vlambda.candidates import Candidate
    from occontrol.families.vlambda.problem import Problem


@dataclass(frozen=True, eq=False)
class Earlier:
    """What is gone on from.

    Parameters
    ----------
    selection : the earlier choices, walked again
    chooser : that makes them
    """

    selection: Selection
    chooser: SequenceChooser

    def among(self, candidates: Sequence[Candidate]) -> list[int] | None:
        """The choices as positions among `candidates`, or None where one of them is no candidate."""
        found = []
        for group, places in zip(self.chooser.groups, self.chooser.locations, strict=True):
            fits = [i for i, c in enumerate(candidates) if c.sensors == group and _same(c.locations, places)]
            if not fits:
                return None
            found.append(fits[0])
        return found


def earlier_search(problem: Problem, monitor: Monitor) -> Earlier | None:
    """The earlier solution that the monitor brings, or None to begin anew.

    Its cost is computed again; what it states, cost and bound, is not looked at.

    Parameters
    ----------
    problem : Problem
    monitor : Monitor, whose `resumed` is set when there are choices to go on from
    """
    solution = monitor.resume
    if solution is None or solution.family != problem.family:
        return None
    numbers = numbers_of(solution)
    names = list(problem.sensors.names)
    sizes = {len(set(entry.sensors)) for entry in numbers.schedule}
    if len(numbers.schedule) != problem.epochs or sizes != {problem.select}:
        return None
    if any(name not in names for entry in numbers.schedule for name in (*entry.sensors, *(entry.locations or {}))):
        return None
    chooser = recorded(problem, solution)
    if not all(
        _allowed(problem, int(k), group, places)
        for k, group, places in zip(problem.starts[:-1], chooser.groups, chooser.locations, strict=True)
    ):
        return None
    selection = run_selection(problem.sampled, problem.starts, problem.select, chooser)
    monitor.resumed = True
    return Earlier(selection, chooser)


def _allowed(problem: Problem, step: int, group: tuple[int, ...], places: Mapping[int, np.ndarray]) -> bool:
    """Whether every movable sensor of a group, and no other, has a place that its file allows."""
    for j in group:
        region, place = problem.sensors[j].location, places.get(j)
        if (region is None) != (place is None):
            return False
        if region is not None and place is not None:
            inside = place.shape == (region.coordinates,) and np.all(np.isfinite(place))
            inside = inside and np.all((place >= region.bounds[:, 0]) & (place <= region.bounds[:, 1]))
            if not inside or not region.allowed(step, place[None])[0]:
                return False
    return True


def _same(one: Mapping[int, np.ndarray], other: Mapping[int, np.ndarray]) -> bool:
    return one.keys() == other.keys() and all(np.array_equal(one[j], other[j]) for j in one)

"""A table of states, transitions, actions and events: every schedule that keeps the rules is a path through it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np


class Event(NamedTuple):
    """What happens at the left edge of an interval: sensors that stop and start, and what that costs."""

    stopped: tuple[int, ...]
    started: tuple[int, ...]
    cost: float


@dataclass(frozen=True, eq=False)
class Automaton:
    """States, actions, events and transitions as arrays.

    Parameters
    ----------
    columns : (A, C) weights of every action: M sensors measuring, then those that can warm up, warming
    on : (A, M) whether a sensor is in use
    events : of which the first is that nothing changes
    table : (N,) which table belongs to an interval
    first : (T+1,) where the tables begin among the transitions
    tail, head, action, event : (E,) of every transition
    start : the first state
    final : (Q,) whether a schedule may end in a state
    tracked : the rules that the states keep
    """

    columns: np.ndarray
    on: np.ndarray
    events: tuple[Event, ...]
    table: np.ndarray
    first: np.ndarray
    tail: np.ndarray
    head: np.ndarray
    action: np.ndarray
    event: np.ndarray
    start: int
    final: np.ndarray
    tracked: frozenset[str]

    @property
    def states(self) -> int:
        """Q"""
        return len(self.final)

    @property
    def actions(self) -> int:
        """A"""
        return len(self.on)

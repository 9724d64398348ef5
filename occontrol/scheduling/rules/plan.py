"""A schedule that keeps the rules of an automaton, with everything that rules and prices ask about."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Plan:
    """One schedule.

    Parameters
    ----------
    actions : (N,) of the automaton
    weights : (N, C) of the recursion's columns: sensors measuring, then those that can warm up, warming
    on : (N, M) whether a sensor is in use
    starts, stops : (N, M) whether a sensor starts, or has stopped, at the left edge of an interval
    switching : what its changes cost
    """

    actions: np.ndarray
    weights: np.ndarray
    on: np.ndarray
    starts: np.ndarray
    stops: np.ndarray
    switching: float

    @property
    def key(self) -> bytes:
        """What tells two plans apart."""
        return self.actions.tobytes()

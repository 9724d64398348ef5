"""The line between a running solver and whoever watches it: progress out, 'stop' in."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass
class Monitor:
    """Solvers call `report` once an iteration and look at `stop` at least that often.

    Parameters
    ----------
    show : called with every record {iteration, cost, lower_bound, seconds, stage, ...}; draws the progress
    time_limit : seconds after which `stop` becomes true; None is never
    started : time.perf_counter() at the start
    history : the records so far
    stage : what is being done, in a word
    interrupted : set by a signal handler (to the signal's number); the solver returns its best so far
    resume : an earlier Solution of the same problem to go on from, or None
    resumed : set by the solver that has gone on from it; the others begin anew
    """

    show: Callable[[Mapping], None] | None = None
    time_limit: float | None = None
    interrupted: int = 0
    started: float = field(default_factory=time.perf_counter)
    history: list[dict] = field(default_factory=list)
    stage: str = ""
    resume: Any = None
    resumed: bool = False

    @property
    def seconds(self) -> float:
        """Wall time since the start."""
        return time.perf_counter() - self.started

    @property
    def timed_out(self) -> bool:
        """Whether the time limit has passed."""
        return self.time_limit is not None and self.seconds > self.time_limit

    @property
    def stop(self) -> bool:
        """Whether to return the best so far, now."""
        return bool(self.interrupted) or self.timed_out

    def silent(self) -> Monitor:
        """A Monitor that says stop when this one does, and whose reports nobody sees."""
        return _Silent(parent=self)

    def report(self, iteration: int, cost: float, lower_bound: float, **more) -> None:
        """Record one iteration and show it."""
        record = {
            "iteration": iteration,
            "cost": cost,
            "lower_bound": lower_bound,
            "seconds": self.seconds,
            "stage": self.stage,
            **more,
        }
        self.history.append(record)
        if self.show is not None:
            self.show(record)


@dataclass
class _Silent(Monitor):
    parent: Monitor = field(default_factory=Monitor)

    @property
    def stop(self) -> bool:
        return self.parent.stop

"""The line between a running solver and whoever watches it: progress out, 'stop' in."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from occontrol.core import stopwatch
from occontrol.core.spread import HERE, Spread


@dataclass
class Monitor:
    """Solvers call `report` once an iteration and look at `stop` at least that often.

    A solver that has a time limit, a stage or a history of its own works under a `child`, never on the monitor that it
    was given: what one method sets must not reach the next.

    Parameters
    ----------
    show : called with every record {iteration, cost, lower_bound, seconds, stage, ...}; draws the progress
    time_limit : seconds after which `stop` becomes true; None is never
    started : stopwatch.seconds() at the start
    history : the records so far, those of children included
    stage : what is being done, in a word
    interrupted : set by a signal handler (to the signal's number); the solver returns its best so far
    resume : an earlier Solution of the same problem to go on from, or None
    resumed : set by the solver that has gone on from it; the others begin anew
    spread : where pieces that do not need each other are done
    """

    show: Callable[[Mapping], None] | None = None
    time_limit: float | None = None
    interrupted: int = 0
    started: float = field(default_factory=stopwatch.seconds)
    history: list[dict] = field(default_factory=list)
    stage: str = ""
    resume: Any = None
    resumed: bool = False
    spread: Spread = HERE

    @property
    def seconds(self) -> float:
        """Wall time since the start, without compiling."""
        return stopwatch.seconds() - self.started

    @property
    def timed_out(self) -> bool:
        """Whether the time limit has passed."""
        return self.time_limit is not None and self.seconds > self.time_limit

    @property
    def stop(self) -> bool:
        """Whether to return the best so far, now."""
        return bool(self.interrupted) or self.timed_out

    def child(self, time_limit: float | None = None, silent: bool = False) -> Monitor:
        """A Monitor for one method or one part of it, with clock, limit, stage and history of its own.

        It stops when this one is interrupted or has timed out, and at the tighter of the two limits. An interruption
        concerns everybody, so it goes both ways, and so does the news that an earlier solution was gone on from. Limit,
        clock and stage of this monitor stay as they are.

        Parameters
        ----------
        time_limit : seconds from now on; None adds no limit
        silent : keep the child's records from this monitor's history and from its `show`
        """
        return _Child(self, time_limit, silent)

    def silent(self) -> Monitor:
        """A child whose reports nobody sees."""
        return self.child(silent=True)

    def report(self, iteration: int, cost: float, lower_bound: float, **more) -> None:
        """Record one iteration and show it; `cost` and `lower_bound` are in cost units."""
        self._keep(
            {
                "iteration": iteration,
                "cost": cost,
                "lower_bound": lower_bound,
                "seconds": self.seconds,
                "stage": self.stage,
                **more,
            }
        )

    def _keep(self, record: dict) -> None:
        self.history.append(record)
        if self.show is not None:
            self.show(record)


class _Child(Monitor):
    def __init__(self, parent: Monitor, time_limit: float | None, silent: bool):
        self._parent, self._silent = parent, silent
        left = None if parent.time_limit is None else parent.time_limit - parent.seconds
        super().__init__(None, min((x for x in (time_limit, left) if x is not None), default=None), stage=parent.stage)
        self.resume = parent.resume
        self.spread = parent.spread

    @property
    def interrupted(self) -> int:  # type: ignore[override]
        return self._parent.interrupted

    @interrupted.setter
    def interrupted(self, number: int) -> None:
        # the default of the dataclass is no interruption and takes none back
        if number:
            self._parent.interrupted = number

    @property
    def resumed(self) -> bool:  # type: ignore[override]
        return self._parent.resumed

    @resumed.setter
    def resumed(self, done: bool) -> None:
        if done:
            self._parent.resumed = True

    @property
    def timed_out(self) -> bool:
        # the parent's own limit may have been set after the child was made
        return super().timed_out or self._parent.timed_out

    def _keep(self, record: dict) -> None:
        super()._keep(record)
        if not self._silent:
            self._parent._keep({**record, "seconds": self._parent.seconds})

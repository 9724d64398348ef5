"""What every problem of every family has: the class that all of them extend."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    import numpy as np

    from occontrol.core.kinds import PlainMapping
    from occontrol.core.method import Method
    from occontrol.core.schedule import Schedule
    from occontrol.core.sensor import SensorSuite


class BaseProblem:
    """A problem of any family.

    Attributes
    ----------
    family : the name of its family
    name : what the user calls it
    sensors : those that it chooses among, in the user's order
    method : an options object of one of the family's methods, or None for the default
    expect : {source, cost, tolerance}, the known answer, if any
    """

    family: str
    name: str
    sensors: SensorSuite
    method: Method | None
    expect: PlainMapping | None


class Clock(Protocol):
    """The instants of a problem of readings: `times` (N,), and what formulas call time, "t" or "k"."""

    @property
    def times(self) -> np.ndarray: ...

    @property
    def variable(self) -> str: ...


class ProblemOfReadings(BaseProblem):
    """A problem whose sensors are read at instants.

    Attributes
    ----------
    edges : (N+1,) edges of its schedules, one interval for each instant
    clock : its instants
    select : (least, most) sensors that are read at an instant
    """

    edges: np.ndarray
    clock: Clock
    select: tuple[int, int]

    def make_schedule(self, edges: np.ndarray, weights: np.ndarray) -> Schedule:
        """The schedule of readings with `weights` (N, M) on `edges` (N+1,), in the unit of time."""
        raise NotImplementedError

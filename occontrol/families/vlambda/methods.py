"""The methods of the vlambda family as values: each a frozen dataclass of its own options that makes a chooser."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

from occontrol.core.errors import Mistake
from occontrol.families.vlambda.sensor_choice import (
    Chooser,
    EigenspaceChooser,
    FixedChooser,
    RandomChooser,
    RoundRobinChooser,
    TraceChooser,
)


@dataclass(frozen=True)
class Eigenspace:
    """The paper's rule: most information along the eigenspace of the largest eigenvalue of P(k|k-1).

    Parameters
    ----------
    tolerance : eigenvalues within this of the largest, relative, count as equal to it
    """

    name: ClassVar[str] = "eigenspace"
    tolerance: float = 1e-9

    def chooser(self, problem: Any) -> Chooser:
        """The chooser for `problem`."""
        return EigenspaceChooser(self.tolerance)

    def check(self, problem: Any) -> Iterator[Mistake]:
        """Mistakes in the options."""
        if not 0 <= self.tolerance < 1:
            yield Mistake(("tolerance",), f"tolerance is {self.tolerance:g}", "0 <= tolerance < 1, relative")


@dataclass(frozen=True)
class Fixed:
    """The same sensors all the time.

    Parameters
    ----------
    sensor : name, or list of `select` names; left out: the ones with the smallest cost
    """

    name: ClassVar[str] = "fixed"
    sensor: str | list[str] | None = None

    @property
    def names(self) -> list[str]:
        """The names as a list."""
        return [self.sensor] if isinstance(self.sensor, str) else list(self.sensor or ())

    def chooser(self, problem: Any) -> Chooser:
        """The chooser for `problem`; needs a sensor."""
        return FixedChooser(tuple(sorted(problem.sensors.index(name) for name in self.names)))

    def check(self, problem: Any) -> Iterator[Mistake]:
        """Mistakes in the options."""
        if self.sensor is None:
            return
        known = problem.sensors.names
        unknown = [name for name in self.names if name not in known]
        if unknown:
            yield Mistake(("sensor",), f"there is no sensor '{unknown[0]}'", "there are: " + ", ".join(known))
        elif len(set(self.names)) != len(self.names):
            yield Mistake(("sensor",), "a sensor is named twice")
        elif len(self.names) != problem.select:
            named = f"{len(self.names)} sensor{'s are' if len(self.names) != 1 else ' is'} named"
            what = f"{named}, select is {problem.select}"
            yield Mistake(("sensor",), what, "sensor: [one, two] names several")


@dataclass(frozen=True)
class RoundRobin:
    """Every sensor in turn."""

    name: ClassVar[str] = "round-robin"

    def chooser(self, problem: Any) -> Chooser:
        """The chooser for `problem`."""
        return RoundRobinChooser()


@dataclass(frozen=True)
class Random:
    """Any sensors with equal probability.

    Parameters
    ----------
    seed : of the generator; the same seed gives the same choices
    """

    name: ClassVar[str] = "random"
    seed: int = 0

    def chooser(self, problem: Any) -> Chooser:
        """The chooser for `problem`."""
        return RandomChooser(self.seed)

    def check(self, problem: Any) -> Iterator[Mistake]:
        """Mistakes in the options."""
        if self.seed < 0:
            yield Mistake(("seed",), f"seed is {self.seed}", "a whole number from 0 on")


@dataclass(frozen=True)
class Trace:
    """Least trace of P(k|k) right after the choice."""

    name: ClassVar[str] = "trace"

    def chooser(self, problem: Any) -> Chooser:
        """The chooser for `problem`."""
        return TraceChooser()


@dataclass(frozen=True)
class Lookahead:
    """The first choice of the best sequence over the next epochs, by the problem's criterion.

    Parameters
    ----------
    depth : epochs to look ahead, the present one included
    grid : locations along each coordinate of a movable sensor
    """

    name: ClassVar[str] = "lookahead"
    depth: int = 2
    grid: int = 9

    def chooser(self, problem: Any) -> Chooser:
        """The chooser for `problem`."""
        from occontrol.families.vlambda.candidates import LookaheadChooser, candidate_set

        return LookaheadChooser(candidate_set(problem, self.grid), self.depth)

    def check(self, problem: Any) -> Iterator[Mistake]:
        """Mistakes in the options."""
        if self.depth < 1:
            yield Mistake(("depth",), f"depth is {self.depth}", "a whole number from 1 on")
        yield from _check_grid(self.grid)


@dataclass(frozen=True)
class Optimal:
    """The best of all sequences, by exact search; a bound and a gap where a limit comes first.

    Parameters
    ----------
    max_nodes : epochs that the search may walk
    width : nodes that a layer of the search may keep before it stops being exact
    time_limit : seconds; null is no limit
    grid : locations along each coordinate of a movable sensor; the search is exact over this grid
    """

    name: ClassVar[str] = "optimal"
    max_nodes: int = 2_000_000
    width: int = 300
    time_limit: float | None = 60.0
    grid: int = 9

    def check(self, problem: Any) -> Iterator[Mistake]:
        """Mistakes in the options."""
        for key in ("max_nodes", "width"):
            if getattr(self, key) < 1:
                yield Mistake((key,), f"{key} is {getattr(self, key)}", "a whole number from 1 on")
        if self.time_limit is not None and not self.time_limit > 0:
            yield Mistake(("time_limit",), f"time_limit is {self.time_limit:g}", "seconds, above 0")
        yield from _check_grid(self.grid)


def _check_grid(grid: int) -> Iterator[Mistake]:
    if not 2 <= grid <= 1000:
        yield Mistake(("grid",), f"grid is {grid}", "a whole number from 2 to 1000")

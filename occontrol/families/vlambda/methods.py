"""The methods of the vlambda family as values: each a frozen dataclass of its own options that runs itself.

A rule is a chooser that is walked over the horizon; `optimal` searches all sequences. A wrong option is refused when
the method is made, one that does not fit a problem by `check`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from occontrol.core.errors import Mistake, ProblemError, suggest
from occontrol.core.method import Method, check_options
from occontrol.core.monitor import Monitor
from occontrol.families.vlambda.baselines import FixedChooser, RandomChooser, RoundRobinChooser, SequenceChooser
from occontrol.families.vlambda.outcome import Outcome, cheapest_fixed, walk
from occontrol.families.vlambda.sensor_choice import Chooser, EigenspaceChooser, TraceChooser

if TYPE_CHECKING:
    from occontrol.families.vlambda.problem import Problem


class Rule:
    """A method that is a chooser, walked over the horizon without data."""

    name: ClassVar[str]
    says: ClassVar[str] = "selected on-line; a rule proves no bound"

    def check(self, problem: Problem) -> Sequence[Mistake]:
        """Options of this method that do not fit `problem`."""
        return ()

    def chooser(self, problem: Problem) -> Chooser:
        """The chooser for `problem`, for a run and for a loop on a target."""
        raise NotImplementedError

    def run(self, problem: Problem, monitor: Monitor) -> Outcome:
        """Choose over the whole horizon of `problem`, until `monitor` says stop; then the last choice is kept."""
        return walk(problem, self.chooser(problem), monitor, self.says)


@dataclass(frozen=True)
class Eigenspace(Rule):
    """The paper's rule: most information along the eigenspace of the largest eigenvalue of P(k|k-1).

    Parameters
    ----------
    tolerance : eigenvalues within this of the largest, relative, count as equal to it; 0 <= tolerance < 1
    """

    name: ClassVar[str] = "eigenspace"
    tolerance: float = 1e-9

    def __post_init__(self) -> None:
        check_options(self, at_least={"tolerance": 0})
        if self.tolerance >= 1:
            raise ProblemError(_wrong(self, "tolerance", "a number of at least 0 and below 1, relative"))

    def chooser(self, problem: Problem) -> Chooser:
        """The chooser for `problem`."""
        return EigenspaceChooser(self.tolerance)


@dataclass(frozen=True)
class Fixed(Rule):
    """The same sensors all the time.

    Parameters
    ----------
    sensor : name, or list of `select` names; left out: the ones with the smallest cost
    """

    name: ClassVar[str] = "fixed"
    says: ClassVar[str] = "a baseline"
    sensor: str | list[str] | None = None

    def __post_init__(self) -> None:
        given = self.sensor
        if given is not None and not isinstance(given, str):
            if not isinstance(given, list | tuple) or not all(isinstance(name, str) for name in given):
                raise ProblemError(_wrong(self, "sensor", "the name of a sensor, or a list of names"))

    @property
    def names(self) -> list[str]:
        """The names as a list."""
        return [self.sensor] if isinstance(self.sensor, str) else list(self.sensor or ())

    def check(self, problem: Problem) -> Sequence[Mistake]:
        """Whether the named sensors are `select` different ones of `problem`."""
        if self.sensor is None:
            return ()
        known = problem.sensors.names
        unknown = [name for name in self.names if name not in known]
        if unknown:
            return [Mistake(("sensor",), f"there is no sensor '{unknown[0]}'", suggest(unknown[0], known))]
        if len(set(self.names)) != len(self.names):
            return [Mistake(("sensor",), "a sensor is named twice")]
        if len(self.names) != problem.select:
            named = f"{len(self.names)} sensor{'s are' if len(self.names) != 1 else ' is'} named"
            what = f"{named}, select is {problem.select}"
            return [Mistake(("sensor",), what, "sensor: [one, two] names several")]
        return ()

    def chooser(self, problem: Problem) -> Chooser:
        """The chooser for `problem`; without a name all of them are tried first."""
        if self.sensor is not None:
            return FixedChooser(tuple(sorted(problem.sensors.index(name) for name in self.names)))
        return _repeated(self, problem)

    def run(self, problem: Problem, monitor: Monitor) -> Outcome:
        """The named sensors over the horizon of `problem`, or every group of them and the cheapest stands."""
        return super().run(problem, monitor) if self.sensor is not None else cheapest_fixed(problem, monitor)


@dataclass(frozen=True)
class RoundRobin(Rule):
    """Every sensor in turn."""

    name: ClassVar[str] = "round-robin"
    says: ClassVar[str] = "a baseline"

    def chooser(self, problem: Problem) -> Chooser:
        """The chooser for `problem`."""
        return RoundRobinChooser()


@dataclass(frozen=True)
class Random(Rule):
    """Any sensors with equal probability.

    Parameters
    ----------
    seed : of the generator; the same seed gives the same choices
    """

    name: ClassVar[str] = "random"
    says: ClassVar[str] = "a baseline"
    seed: int = 0

    def __post_init__(self) -> None:
        _check_whole(self, seed=(0, None))

    def chooser(self, problem: Problem) -> Chooser:
        """The chooser for `problem`."""
        return RandomChooser(self.seed)


@dataclass(frozen=True)
class Trace(Rule):
    """Least trace of P(k|k) right after the choice."""

    name: ClassVar[str] = "trace"

    def chooser(self, problem: Problem) -> Chooser:
        """The chooser for `problem`."""
        return TraceChooser()


@dataclass(frozen=True)
class Lookahead(Rule):
    """The first choice of the best sequence over the next epochs, by the problem's criterion.

    Parameters
    ----------
    depth : epochs to look ahead, the present one included
    grid : locations along each coordinate of a movable sensor, from 2 to 1000
    """

    name: ClassVar[str] = "lookahead"
    depth: int = 2
    grid: int = 9

    def __post_init__(self) -> None:
        _check_whole(self, depth=(1, None), grid=(2, 1000))

    def chooser(self, problem: Problem) -> Chooser:
        """The chooser for `problem`."""
        from occontrol.families.vlambda.candidates import LookaheadChooser, candidate_set

        return LookaheadChooser(candidate_set(problem, self.grid), self.depth)


@dataclass(frozen=True)
class Optimal:
    """The best of all sequences, by exact search; a bound and a gap where a limit comes first.

    Parameters
    ----------
    max_nodes : epochs that the search may walk
    width : nodes that a layer of the search may keep before it stops being exact
    time_limit : seconds; None is no limit
    grid : locations along each coordinate of a movable sensor, from 2 to 1000; the search is exact over this grid
    """

    name: ClassVar[str] = "optimal"
    max_nodes: int = 2_000_000
    width: int = 300
    time_limit: float | None = 60.0
    grid: int = 9

    def __post_init__(self) -> None:
        check_options(self, positive=["time_limit"])
        _check_whole(self, max_nodes=(1, None), width=(1, None), grid=(2, 1000))

    def check(self, problem: Problem) -> Sequence[Mistake]:
        """Options of this method that do not fit `problem`."""
        return ()

    def chooser(self, problem: Problem) -> Chooser:
        """The chooser that makes the choices of the best sequence for `problem`."""
        return _repeated(self, problem)

    def run(self, problem: Problem, monitor: Monitor) -> Outcome:
        """Search all sequences for `problem` under the eyes of `monitor`."""
        from occontrol.families.vlambda.optimal import best_sequence

        return best_sequence(
            problem,
            monitor,
            max_nodes=self.max_nodes,
            width=self.width,
            time_limit=self.time_limit,
            grid=self.grid,
        )


METHODS: dict[str, type] = {m.name: m for m in (Eigenspace, Fixed, RoundRobin, Random, Trace, Lookahead, Optimal)}


def _repeated(method: Fixed | Optimal, problem: Problem) -> Chooser:
    """What a search decided over the whole horizon, as a chooser."""
    return SequenceChooser.repeating(method.run(problem, Monitor()).selection.choices)


def _wrong(method: Method, option: str, hint: str) -> Mistake:
    return Mistake((option,), f"{option} of method {method.name} is {getattr(method, option)!r}", hint)


def _check_whole(method: Method, **limits: tuple[int, int | None]) -> None:
    """Refuse options that are no whole numbers from the first limit to the second (None: without end)."""
    found = []
    for option, (low, high) in limits.items():
        value = getattr(method, option)
        whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
        if not whole or value < low or (high is not None and value > high):
            found.append(_wrong(method, option, f"a whole number from {low} {'on' if high is None else f'to {high}'}"))
    if found:
        raise ProblemError(found)

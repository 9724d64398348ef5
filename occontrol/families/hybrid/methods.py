"""The methods of the hybrid family as values: each a frozen dataclass of its own options that runs itself.

A method is a chooser of groups that many simulated runs judge. A wrong option is refused when the method is made, one
that does not fit a problem by `check`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Self

from occontrol.core.errors import Mistake, ProblemError
from occontrol.core.method import check_options
from occontrol.families.hybrid.chooser import Chooser, at_random, in_turn

if TYPE_CHECKING:
    from occontrol.core.monitor import Monitor
    from occontrol.core.solution import Solution
    from occontrol.families.hybrid.problem import Problem
    from occontrol.families.hybrid.result import HybridResult


class GroupMethod:
    """What the methods have in common: one group at a time, judged by simulated runs."""

    name: ClassVar[str]
    constant: ClassVar[bool] = False
    time_limit: float | None

    def __post_init__(self) -> None:
        check_options(self, positive=["time_limit"])

    def check(self, problem: Problem) -> Sequence[Mistake]:
        """Options of this method that do not fit `problem`."""
        return ()

    def groups(self, problem: Problem) -> Sequence[Sequence[str]]:
        """The groups of `problem` that the method chooses among."""
        return problem.groups or ()

    def chooser(self, problem: Problem) -> Chooser:
        """How a group is chosen at every step of `problem`."""
        raise NotImplementedError

    def run(self, problem: Problem, monitor: Monitor) -> Solution:
        """Simulate and estimate all runs of `problem` under the eyes of `monitor`."""
        from occontrol.families.hybrid.runs import judge

        return judge(problem, self, monitor)

    @classmethod
    def behind(cls, numbers: HybridResult) -> Self:
        """The method that led to `numbers`, as far as its choices go."""
        return cls()


@dataclass(frozen=True)
class Scheduled(GroupMethod):
    """The rule of Liu & Hwang: least bound on a wrong mode, plus position_weight times the position variance.

    Parameters
    ----------
    time_limit : seconds, None is no limit
    """

    name: ClassVar[str] = "scheduled"
    time_limit: float | None = None

    def chooser(self, problem: Problem) -> Chooser:
        """The scores of `problem`'s criterion decide."""
        return Chooser(None, 1.0, problem.position_weight)


@dataclass(frozen=True)
class ExpectedCovariance(GroupMethod):
    """Least expected position variance after the measurement, one step ahead; looks at the state and not at the modes.

    Parameters
    ----------
    time_limit : seconds, None is no limit
    """

    name: ClassVar[str] = "expected-covariance"
    time_limit: float | None = None

    def chooser(self, problem: Problem) -> Chooser:
        """The expected position variance decides."""
        return Chooser(None, 0.0, 1.0)


@dataclass(frozen=True)
class Alternate(GroupMethod):
    """The groups in turn, in the problem's order.

    Parameters
    ----------
    time_limit : seconds, None is no limit
    """

    name: ClassVar[str] = "alternate"
    time_limit: float | None = None

    def chooser(self, problem: Problem) -> Chooser:
        """The groups of `problem` in turn."""
        return Chooser(in_turn)


@dataclass(frozen=True)
class Random(GroupMethod):
    """Any group with equal probability at every step.

    Parameters
    ----------
    time_limit : seconds, None is no limit
    """

    name: ClassVar[str] = "random"
    time_limit: float | None = None

    def chooser(self, problem: Problem) -> Chooser:
        """Any group of `problem`."""
        return Chooser(at_random)


@dataclass(frozen=True)
class Fixed(GroupMethod):
    """One sensor or group all the time.

    Parameters
    ----------
    sensor : its name, a group as names joined by '+' or as a list; if left out every group is tried, and the best in
        RMS stands
    time_limit : seconds for each, None is no limit
    """

    name: ClassVar[str] = "fixed"
    constant: ClassVar[bool] = True
    sensor: str | list[str] | None = None
    time_limit: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        given = self.sensor
        if given is not None and not isinstance(given, str):
            if not isinstance(given, list | tuple) or not all(isinstance(name, str) for name in given):
                what = f"sensor of method {self.name} is {given!r}"
                raise ProblemError(Mistake(("sensor",), what, "the name of a sensor or group, or a list of names"))

    def check(self, problem: Problem) -> Sequence[Mistake]:
        """Whether the named sensor or group is one of `problem`."""
        try:
            self.groups(problem)
        except ProblemError as error:
            return error.mistakes
        return ()

    def groups(self, problem: Problem) -> Sequence[Sequence[str]]:
        """The named group alone; without a name the first of `problem`."""
        return (problem.groups or ())[:1] if self.sensor is None else (problem.group_named(self.sensor),)

    def chooser(self, problem: Problem) -> Chooser:
        """The one group there is."""
        return Chooser(in_turn)

    def run(self, problem: Problem, monitor: Monitor) -> Solution:
        """All runs of `problem` with the named group, or with every group and the best stands."""
        from occontrol.families.hybrid.runs import best_of

        singles = [Fixed("+".join(group), self.time_limit) for group in problem.groups or ()]
        if self.sensor is not None or len(singles) < 2:
            return super().run(problem, monitor)
        return best_of(problem, singles, monitor)

    @classmethod
    def behind(cls, numbers: HybridResult) -> Self:
        """The method that led to `numbers`: the group that was used."""
        return cls(numbers.sensor)


METHODS: dict[str, type[GroupMethod]] = {m.name: m for m in (Scheduled, ExpectedCovariance, Fixed, Alternate, Random)}

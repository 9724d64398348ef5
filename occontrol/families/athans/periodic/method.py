"""The method of problems without an end, as a value."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from occontrol.core.errors import Mistake, UsageError
from occontrol.core.method import check_options

if TYPE_CHECKING:
    from occontrol.families.athans.base import AthansProblem
    from occontrol.families.athans.found import Found


class _Endless:
    """A method of problems without an end, which are solved as a whole."""

    name: ClassVar[str]

    def check(self, problem: AthansProblem) -> Sequence[Mistake]:
        """Nothing: which problems it is for is said where methods are chosen."""
        return ()

    def run(self, problem: AthansProblem, *arguments: object) -> Found:
        """Raises UsageError: problems without an end are solved as a whole, see periodic/solve.py."""
        raise UsageError(f"method {self.name} is for an infinite horizon\n  hint: horizon: {{infinite: true}}")


@dataclass(frozen=True)
class Periodic(_Endless):
    """The best cycle that can be found, and a proof for all schedules.

    Parameters
    ----------
    max_period : longest cycle, in steps
    relative_gap : of cost and bound, at which it ends
    time_limit : seconds, None is no limit
    max_nodes : words of the proof that are looked at
    """

    name: ClassVar[str] = "periodic"
    max_period: int = 12
    relative_gap: float = 1e-4
    time_limit: float | None = 60.0
    max_nodes: int = 200_000

    def __post_init__(self) -> None:
        check_options(self, positive=("relative_gap", "time_limit"), whole={"max_period": 1, "max_nodes": 1})


@dataclass(frozen=True)
class Shares(_Endless):
    """Baseline: at every step a choice drawn by the shares of the averaged optimum, independently of all before.

    What is judged is one draw, repeated for ever; `mean_at_most` in result.json bounds the mean over all draws.

    Parameters
    ----------
    steps : of the draw
    seed : of the random numbers
    relative_gap : of cost and bound, at which it counts as certified
    """

    name: ClassVar[str] = "shares"
    steps: int = 300
    seed: int = 1
    relative_gap: float = 1e-4

    def __post_init__(self) -> None:
        check_options(self, positive=["relative_gap"], whole={"steps": 1, "seed": 0})

    def check(self, problem: AthansProblem) -> Sequence[Mistake]:
        """A mistake where a cycle has rules, which draws do not keep."""
        if getattr(problem, "limits", None) is None:
            return ()
        return (Mistake(("method",), "method shares draws at random and does not keep the rules of a cycle"),)

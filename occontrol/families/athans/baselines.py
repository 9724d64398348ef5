"""The baselines of the athans family as values: policies that every clever one has to beat."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from occontrol.core.errors import Mistake
from occontrol.core.method import check_options

if TYPE_CHECKING:
    import numpy as np

    from occontrol.core.monitor import Monitor
    from occontrol.families.athans.found import Found
    from occontrol.families.athans.problem import SchedulingProblem
    from occontrol.scheduling.feasible_set import FeasibleSet
    from occontrol.scheduling.sweep import Sweep


class Baseline:
    """A policy that is made in one go, beside the bound of a relaxation."""

    name: ClassVar[str]
    relative_gap: float

    def check(self, problem: SchedulingProblem) -> Sequence[Mistake]:
        """Nothing: a baseline fits every problem."""
        return ()

    def policy(self, sweep: Sweep, feasible_set: FeasibleSet) -> np.ndarray:
        """The policy (N, M)."""
        raise NotImplementedError

    def run(self, problem: SchedulingProblem, sweep: Sweep, feasible_set: FeasibleSet, monitor: Monitor) -> Found:
        """The policy, with the relaxation whose bound stands beside it."""
        from occontrol.families.athans.found import relax

        found = relax(sweep, feasible_set, monitor, self.relative_gap)
        found.weights = self.policy(sweep, feasible_set)
        return found


@dataclass(frozen=True)
class BestSingle(Baseline):
    """Baseline: the best fixed choice, used whenever it is available.

    Parameters
    ----------
    relative_gap : target of the relaxation whose bound stands beside the result
    """

    name: ClassVar[str] = "best-single"
    relative_gap: float = 1e-4

    def __post_init__(self) -> None:
        check_options(self, positive=["relative_gap"])

    def policy(self, sweep: Sweep, feasible_set: FeasibleSet) -> np.ndarray:
        """The policy (N, M)."""
        from occontrol.families.athans.integration.priced import judge_of
        from occontrol.scheduling.baselines import best_single

        return best_single(judge_of(sweep), feasible_set)


@dataclass(frozen=True)
class RoundRobin(Baseline):
    """Baseline: the sensors in turn.

    Parameters
    ----------
    relative_gap : target of the relaxation whose bound stands beside the result
    dwell : intervals between switches
    """

    name: ClassVar[str] = "round-robin"
    relative_gap: float = 1e-4
    dwell: int = 1

    def __post_init__(self) -> None:
        check_options(self, positive=["relative_gap"], whole={"dwell": 1})

    def policy(self, sweep: Sweep, feasible_set: FeasibleSet) -> np.ndarray:
        """The policy (N, M)."""
        from occontrol.scheduling.baselines import round_robin

        return round_robin(sweep.recursion, feasible_set, self.dwell)


@dataclass(frozen=True)
class Random(Baseline):
    """Baseline: a random available choice on every interval.

    Parameters
    ----------
    relative_gap : target of the relaxation whose bound stands beside the result
    seed : of the random numbers
    """

    name: ClassVar[str] = "random"
    relative_gap: float = 1e-4
    seed: int = 1

    def __post_init__(self) -> None:
        check_options(self, positive=["relative_gap"], whole={"seed": 0})

    def policy(self, sweep: Sweep, feasible_set: FeasibleSet) -> np.ndarray:
        """The policy (N, M)."""
        from occontrol.scheduling.baselines import random_policy

        return random_policy(feasible_set, self.seed)


@dataclass(frozen=True)
class Greedy(Baseline):
    """Baseline: on every interval the choice that would be best if measuring ended with it.

    Parameters
    ----------
    relative_gap : target of the relaxation whose bound stands beside the result
    """

    name: ClassVar[str] = "greedy"
    relative_gap: float = 1e-4

    def __post_init__(self) -> None:
        check_options(self, positive=["relative_gap"])

    def policy(self, sweep: Sweep, feasible_set: FeasibleSet) -> np.ndarray:
        """The policy (N, M)."""
        from occontrol.scheduling.baselines import greedy

        return greedy(sweep.recursion, feasible_set)

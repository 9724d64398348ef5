"""The part of a family that is judged on simulated runs; `flights.py` does it for whoever simulates and filters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol, cast

from occontrol.core.problem import BaseProblem
from occontrol.core.result import ResultData
from occontrol.core.trajectory import Trajectory
from occontrol.families.abilities import Work

if TYPE_CHECKING:
    from numpy.random import SeedSequence

    from occontrol.core.measurement import Estimate
    from occontrol.core.monitor import Monitor
    from occontrol.core.solution import Solution
    from occontrol.families.family import Family


class ClosedLoop(Protocol):
    """Monte Carlo comparisons of a family; see family.py."""

    def monte_carlo(
        self,
        problem: BaseProblem,
        solution: Solution,
        policies: Sequence[str] | None,
        runs: int,
        seed: int,
        monitor: Monitor,
        work: Work | None = None,
    ) -> ResultData:
        """Policies side by side on simulated runs; `work` does batches of seeds, in their order."""
        from occontrol.families.flights import compare

        return compare(cast("Family", self), problem, solution, policies, runs, seed, monitor, work)

    def monte_carlo_batch(
        self, problem: BaseProblem, solution: Solution, policies: Sequence[str], seeds: Sequence[SeedSequence]
    ) -> tuple[dict, dict]:
        """What `work` does with one batch: outcomes and milliseconds by policy."""
        from occontrol.families.flights import flown

        return flown(cast("Family", self), problem, solution, policies, seeds)

    def squared_error(self, problem: BaseProblem, estimate: Estimate, truth: Trajectory) -> float:
        """What a simulated run is judged by: the mean over time of the squared error of the state, where not said."""
        from occontrol.families.flights import errors

        error = errors(estimate, truth)
        return float((error**2).sum() / len(error))

    def paid(self, problem: BaseProblem, solution: Solution) -> float:
        """What a plan pays for its readings, weighed against `squared_error`; nothing, where not said."""
        return 0.0

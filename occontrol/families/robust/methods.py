"""The methods of the robust family as values: frozen dataclasses of options that check and run themselves."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from occontrol.core.errors import Mistake
from occontrol.core.kinds import PlainMapping
from occontrol.core.method import check_options
from occontrol.core.solution import Status
from occontrol.families.robust.one_sequence import BestSingle as BestSingle
from occontrol.families.robust.one_sequence import Fixed as Fixed
from occontrol.families.robust.one_sequence import OneStep as OneStep
from occontrol.families.robust.one_sequence import Random as Random
from occontrol.families.robust.one_sequence import RoundRobin as RoundRobin
from occontrol.families.robust.one_sequence import SwitchingMethod as SwitchingMethod

if TYPE_CHECKING:
    from occontrol.core.monitor import Monitor
    from occontrol.core.solution import Solution
    from occontrol.families.robust.problem import Problem
    from occontrol.families.robust.slots import Slots

MOST_RANKED = 10_000  # sequences of `all` that result.json lists


@dataclass(frozen=True)
class Optimal(SwitchingMethod):
    """The best sequence: layered search with proofs.

    Parameters
    ----------
    relative_gap : target of (cost - bound)/cost; small problems are solved exactly whatever it is
    node_limit : nodes after which only the most promising few of every layer are followed
    width : nodes of a layer that are kept at most
    merge_above : nodes of a layer up to which nothing is merged
    time_limit : seconds, None is no limit
    """

    name: ClassVar[str] = "optimal"
    relative_gap: float = 1e-2
    node_limit: int = 100_000
    width: int = 3000
    merge_above: int = 1000
    time_limit: float | None = None

    def __post_init__(self) -> None:
        limits = {"node_limit": 1, "width": 1, "merge_above": 1}
        check_options(self, positive=("time_limit",), at_least={"relative_gap": 0}, whole=limits)

    def run(self, problem: Problem, slots: Slots, monitor: Monitor) -> Solution:
        """Search from the one-step rule's sequence on, and from an earlier solution's where the monitor brings one."""
        from occontrol.families.robust.assemble import sequence_solution
        from occontrol.families.robust.resume import earlier_sequence
        from occontrol.families.robust.search import SearchOptions, search
        from occontrol.families.robust.slots import one_step

        greedy = one_step(slots, problem.plant.weight, problem.plant.center, problem.plant.level)
        options = SearchOptions(self.relative_gap, self.merge_above, self.width, self.node_limit)
        earlier = earlier_sequence(slots, list(problem.sensors.names), monitor)
        known = [greedy] if earlier is None else [greedy, earlier]
        found = search(slots, known, options, monitor)
        gap = (found.cost - found.lower_bound) / abs(found.cost)
        total = f"of {slots.sensors}^{slots.count} sequences, {found.nodes} nodes were looked at"
        if monitor.interrupted:
            status, message = Status.INTERRUPTED, f"{Status.INTERRUPTED.text} {total}."
        elif gap <= max(self.relative_gap, 1e-10):
            exact = gap <= 1e-10
            proof = "No sequence is better" if exact else f"No sequence is better by more than {100 * gap:.3g} %"
            status, message = Status.CERTIFIED, f"{proof}: {total}."
        else:
            status = Status.LIMIT
            message = f"{found.limit or 'the relaxation'} ended the proof at a gap of {100 * gap:.3g} %: {total}."
        numbers = {
            "nodes": found.nodes,
            "widest_layer": found.widest,
            "merged": found.merged,
            "dropped": found.dropped,
            "limit": found.limit,
            "relaxed_bound": found.relaxed_bound,
            "one_step_cost": slots.cost(greedy),
        }
        return sequence_solution(
            problem,
            slots,
            found.sequence,
            method=self.name,
            lower_bound=found.lower_bound,
            status=status,
            message=message,
            monitor=monitor,
            numbers=numbers,
        )


@dataclass(frozen=True)
class All(SwitchingMethod):
    """Every sequence, ranked.

    Parameters
    ----------
    limit : how many sequences there may be
    """

    name: ClassVar[str] = "all"
    limit: int = 300_000

    def __post_init__(self) -> None:
        check_options(self, whole={"limit": 1})

    def check(self, problem: Problem) -> Sequence[Mistake]:
        """Whether there are more sequences than the limit."""
        N, M = problem.slots, len(problem.sensors)
        if N * np.log(M) <= np.log(self.limit) + 1e-12:
            return ()
        what = f"method all would rank {M}^{N} sequences, its limit is {self.limit}"
        return (Mistake((), what, "use method optimal: it proves the best one without them"),)

    def run(self, problem: Problem, slots: Slots, monitor: Monitor) -> Solution:
        """Rank them all."""
        from occontrol.families.robust.assemble import sequence_solution

        N, M = slots.count, slots.sensors
        sequences = np.array(list(itertools.product(range(M), repeat=N)), dtype=np.int16)
        costs = slots.costs(sequences)
        order = np.argsort(costs, kind="stable")
        sequences, costs = sequences[order], costs[order]
        names = problem.sensors.names
        ranking: list[PlainMapping] = [
            {"cost": float(c), "sequence": [names[i] for i in s]}
            for c, s in zip(costs[:MOST_RANKED], sequences[:MOST_RANKED], strict=True)
        ]
        count, worst = len(costs), float(costs[-1])
        return sequence_solution(
            problem,
            slots,
            sequences[0],
            method=self.name,
            lower_bound=float(costs[0]),
            status=Status.CERTIFIED,
            message=f"The best of all {count} sequences; the worst has {worst:.8g}.",
            monitor=monitor,
            numbers={"sequences": count, "worst_cost": worst, "ranking": ranking, "nodes": count},
            arrays={"sequences": sequences, "costs": costs},
        )


@dataclass(frozen=True)
class RelaxedShares(SwitchingMethod):
    """The convex relaxation alone: a slot may be shared between sensors. Its bound holds for every sequence.

    Parameters
    ----------
    relative_gap : target of the relaxation
    """

    name: ClassVar[str] = "relaxed"
    relative_gap: float = 1e-5

    def __post_init__(self) -> None:
        check_options(self, at_least={"relative_gap": 0})

    def run(self, problem: Problem, slots: Slots, monitor: Monitor) -> Solution:
        """The best shares and their bound."""
        from occontrol.families.robust.assemble import shares_solution
        from occontrol.families.robust.bound import relaxed_policy

        weights, _, bound = relaxed_policy(slots, self.relative_gap, monitor)
        return shares_solution(
            problem,
            slots,
            weights,
            method=self.name,
            lower_bound=bound,
            relative_gap=self.relative_gap,
            monitor=monitor,
        )


METHODS: dict[str, type[SwitchingMethod]] = {
    m.name: m for m in (Optimal, OneStep, Fixed, All, RelaxedShares, BestSingle, RoundRobin, Random)
}

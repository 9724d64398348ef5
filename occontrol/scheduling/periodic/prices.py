"""Many targets for ever: a bound from one price for every resource, and the least that each target costs at them.

Looks of resource r are bought at the price l_r. A target that is looked at whenever that pays costs rho_i(l) a step at
least, whatever the others do, and no schedule uses more than c_r looks a step, so
    J >= D(l) = sum_i rho_i(l) - sum_r l_r c_r        for all prices l >= 0.
D is concave, a slope is the looks that the best cycles use less c. It is raised by cutting planes. At the best prices
each rho_i is the largest of three bounds: the graph of gaps, shares in place of looks, and a proof tree.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.scheduling.periodic.letters import Letters
from occontrol.scheduling.periodic.potential import cycle_of

SHORTEST, LONGEST = 8, 256  # steps of the longest gap in the table, at first and at most
DEEP = 40  # pairs of gap and look up to which two gaps are remembered
ROUNDED = 1e-10  # of a bound: what rounding in sums of charges may have done
CUTS = 60  # prices that are tried
NEAR = 1e-5  # relative distance of the model from the bound at which the prices are good enough
MOST_WORD = 4_000


class Bounded(Protocol):
    """A target whose cost with prices for looks has a bound."""

    def bound_at(self, prices: np.ndarray) -> tuple[float, np.ndarray]:
        """The bound a step at `prices` (R,), and the looks (R,) a step that it is made of."""
        ...


@dataclass(eq=False)
class GapTable:
    """The graph of gaps of one target.

    Parameters
    ----------
    letters : in units in which the smallest covariance is the identity; letter 0 is a step without a look
    uses : (A-1, R) 1 where a look uses a resource
    """

    letters: Letters
    uses: np.ndarray
    most: int = SHORTEST
    graph: tuple = field(default=(), repr=False)
    policy: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64), repr=False)
    v: np.ndarray = field(default_factory=lambda: np.zeros(0), repr=False)

    @property
    def looks(self) -> int:
        """The number A-1 of looks there are."""
        return self.letters.count - 1

    def bound_at(self, prices: np.ndarray) -> tuple[float, np.ndarray]:
        """What the target costs a step at least, and how many looks (R,) of each resource a best cycle takes a step.

        Parameters
        ----------
        prices : (R,) of one look
        """
        if not self.looks:
            cycle = cycle_of(self.letters, np.zeros(1, dtype=np.int64))
            cost = np.inf if cycle is None else cycle.cost
            return cost - ROUNDED * abs(cost), np.zeros(self.uses.shape[1])
        while True:
            proven, reached, start = self._solved(prices)
            word = self._word(start)
            # where the graph ends too early, longer gaps are put into it
            beyond = len(word) and int(np.max(np.diff(np.flatnonzero(np.tile(word, 2) > 0)))) > self.most
            if self.most >= LONGEST or not (beyond or proven < reached - NEAR * abs(reached)):
                break
            self.most *= 2
            self.graph = ()
        used = np.zeros(self.uses.shape[1])
        if reached < np.inf and len(word) and reached <= self.graph[2]:
            used = np.sum(self.uses[word[word > 0] - 1], axis=0) / len(word)
        return proven - ROUNDED * abs(proven), used

    def word_at(self, prices: np.ndarray) -> np.ndarray:
        """Letters of the cycle that costs least at `prices` (R,), as far as the graph knows; one idle step for none."""
        if not self.looks:
            return np.zeros(1, dtype=np.int64)
        _, reached, start = self._solved(prices)
        word = self._word(start)
        return word if len(word) and reached <= self.graph[2] else np.zeros(1, dtype=np.int64)

    def _solved(self, prices: np.ndarray) -> tuple[float, float, int]:
        from occontrol.scheduling.periodic.gaps import gap_graph, least_ratio

        if not self.graph:
            deep = self.most * self.looks <= DEEP
            self.graph = gap_graph(*self.letters.arrays, self.most, deep)
            costs = self.graph[0]
            lengths = np.arange(costs.shape[1]) // self.looks + 1
            self.policy = np.argmin(costs / lengths, axis=1).astype(np.int64)
            self.v = np.zeros(len(costs))
        return least_ratio(*self.graph, self._of_looks(prices), self.looks, self.policy, self.v)

    def _of_looks(self, prices: np.ndarray) -> np.ndarray:
        return np.ascontiguousarray(self.uses @ prices, dtype=float)

    def _word(self, start: int) -> np.ndarray:
        from occontrol.scheduling.periodic.gaps import cycle_of_policy

        word = np.zeros(MOST_WORD, dtype=np.int64)
        if start < 0:
            return word[:0]
        prices = np.zeros(self.looks)
        costs, last, _ = self.graph
        return word[: cycle_of_policy(costs, last, prices, self.looks, self.policy, start, word)]


@dataclass(frozen=True, eq=False)
class Priced:
    """The best prices that were found.

    Parameters
    ----------
    lower_bound : D, a step
    prices : (R,) of one look
    parts : (K,) rho_i, their bounds
    used : (K, R) looks a step of the best cycles; between kinks of D a mean of the cycles on both sides
    """

    lower_bound: float
    prices: np.ndarray
    parts: np.ndarray
    used: np.ndarray


def best_prices(tables: Sequence[Bounded], capacity: np.ndarray, monitor: Monitor) -> Priced:
    """The prices that bound the cost of all targets best, by cutting planes.

    Parameters
    ----------
    tables : of the K targets
    capacity : (R,) looks a step
    monitor : Monitor
    """
    from scipy.optimize import linprog

    R, cuts = len(capacity), []

    def tried(prices: np.ndarray) -> Priced:
        found = [table.bound_at(prices) for table in tables]
        parts, used = np.array([f[0] for f in found]), np.array([f[1] for f in found])
        value = float(np.sum(parts) - prices @ capacity)
        cuts.append((value, np.sum(used, axis=0) - capacity, prices, used))
        return Priced(value, prices, parts, used)

    best = tried(np.zeros(R))
    top = np.full(
        R, max(abs(best.lower_bound), 1e-300) / max(float(np.min(capacity[capacity > 0], initial=np.inf)), 1.0)
    )
    weights = np.ones(1)
    for _ in range(CUTS):
        if monitor.stop:
            break
        # max z, z <= D_k + s_k (l - l_k), 0 <= l <= top
        slopes = np.array([s for _, s, _, _ in cuts])
        sides = np.array([d - s @ at for d, s, at, _ in cuts])
        rows = np.column_stack([np.ones(len(cuts)), -slopes])
        bounds = [(None, None), *((0.0, float(t)) for t in top)]
        done = linprog(np.append(-1.0, np.zeros(R)), A_ub=rows, b_ub=sides, bounds=bounds, method="highs")
        if not done.success:
            break
        weights = -np.asarray(done.ineqlin.marginals)
        model, prices = float(done.x[0]), np.asarray(done.x[1:])
        at_top = prices >= top * (1 - 1e-9)
        if model - best.lower_bound <= NEAR * abs(best.lower_bound) and not np.any(at_top):
            break
        found = tried(prices)
        if found.lower_bound > best.lower_bound:
            best = found
        rising = at_top & (cuts[-1][1] > 0)
        top = np.where(rising, 4 * top, top)
    # the looks of the relaxed optimum: cycles on both sides of a kink, as the cutting planes weigh them
    total = float(np.sum(weights))
    used = best.used
    if total > 0.5:
        used = sum(w * cut[3] for w, cut in zip(weights, cuts, strict=False)) / total  # type: ignore[assignment]
    return Priced(best.lower_bound, best.prices, best.parts, np.asarray(used))

"""Exact numbers of readings: of all sensors together, or of single ones, beside the limit at every instant.

The integral schedules of both kinds are the vertices of their convex hull: with one number for all it is a partition
matroid cut off at a size, with numbers for single sensors a transportation problem. So the cheapest schedule for given
prices is found exactly, by sorting or by assignment, and it carries the bounds.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from occontrol.core.errors import Mistake, plural
from occontrol.core.sensor import IDLE
from occontrol.scheduling.feasible_set import ROUNDING, IntervalPolytopes

TOTAL = "total"


@dataclass(frozen=True, eq=False)
class BudgetSet(IntervalPolytopes):
    """IntervalPolytopes with exact budgets; idle, one of the sensors, fills every instant up to `select`.

    Parameters
    ----------
    upper : (N, M) largest weight of each sensor
    select : sum of the weights of an instant, idle among them
    edges, names : as there; the names are needed
    budget : {"total": b} or {name: b}
    """

    budget: Mapping[str, int] = field(default_factory=dict)

    @property
    def idle(self) -> int:
        """The position of idle."""
        return self.names.index(IDLE)

    @property
    def real(self) -> np.ndarray:
        """(M-1,) the positions of the sensors."""
        return np.array([j for j in range(len(self.names)) if j != self.idle])

    @property
    def one_group(self) -> bool:
        """Whether instants have room for all sensors and one number binds all readings: then that number is all."""
        return self.select >= len(self.real) and (TOTAL in self.budget or len(self.real) == 1)

    @property
    def free(self) -> np.ndarray:
        """(M,) which sensors no number binds; idle is not among them."""
        bound = TOTAL in self.budget
        return np.array([not bound and j != self.idle and name not in self.budget for j, name in enumerate(self.names)])

    def vertex(self, gradient: np.ndarray) -> np.ndarray:
        """The cheapest schedule (N, M) for g (N, M) that keeps the budget; ValueError where none does.

        `gradient` (N, M).
        """
        real, idle = self.real, self.idle
        price = np.where(self.upper[:, real] > 0.5, gradient[:, real] - gradient[:, [idle]], np.inf)
        chosen = self._total(price) if TOTAL in self.budget else self._single(price)
        result = np.zeros(self.shape)
        result[:, real] = chosen
        result[:, idle] = self.select - np.sum(chosen, axis=1)
        return result

    def _total(self, price: np.ndarray) -> np.ndarray:
        """The b cheapest of the `select` cheapest of every instant."""
        N, M = price.shape
        order = np.argsort(price, axis=1, kind="stable")[:, : self.select]
        rows = np.repeat(np.arange(N), order.shape[1])
        columns = order.ravel()
        values = price[rows, columns]
        wanted = int(self.budget[TOTAL])
        best = np.argsort(values, kind="stable")[:wanted]
        if len(best) < wanted or (wanted and not np.isfinite(values[best[-1]])):
            raise ValueError("the budget cannot be spent")
        chosen = np.zeros((N, M))
        chosen[rows[best], columns[best]] = 1.0
        return chosen

    def _single(self, price: np.ndarray) -> np.ndarray:
        """The cheapest transport of every sensor's readings onto instants with room for `select` of them."""
        N, M = price.shape
        names = [self.names[int(j)] for j in self.real]
        wanted = [self.budget.get(name) for name in names]
        chosen = np.zeros((N, M))
        if self.select >= M:  # instants have room for all: every sensor by itself
            for j, b in enumerate(wanted):
                column = price[:, j]
                best = np.argsort(column, kind="stable")[:b] if b is not None else np.flatnonzero(column < 0)
                if b is not None and (len(best) < b or (b and not np.isfinite(column[best[-1]]))):
                    raise ValueError("the budget cannot be spent")
                chosen[best, j] = 1.0
            return chosen
        from scipy.optimize import linprog
        from scipy.sparse import csr_array

        at, of = np.nonzero(np.isfinite(price))
        count = np.arange(len(at))
        room = csr_array((np.ones(len(at)), (at, count)), shape=(N, len(at)))
        fixed = [j for j in range(M) if wanted[j] is not None]
        place = {j: i for i, j in enumerate(fixed)}
        mine = np.array([i for i in count if of[i] in place], dtype=int)
        spent = csr_array((np.ones(len(mine)), ([place[int(of[i])] for i in mine], mine)), shape=(len(fixed), len(at)))
        totals = [wanted[j] for j in fixed]
        found = linprog(price[at, of], room, np.full(N, self.select), spent, totals, (0, 1), method="highs-ds")
        if not found.success:
            raise ValueError("the budget cannot be spent")
        chosen[at, of] = np.round(found.x)  # the vertices of a transportation problem are whole
        return chosen

    def excess(self, weights: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        """(N,) v.g - min w.g of all instants together, written on the first: a budget couples them.

        `weights` (N, M), `gradient` (N, M).
        """
        result = np.zeros(len(weights))
        least = float(np.vdot(gradient, self.vertex(gradient)))
        result[0] = float(np.vdot(gradient, weights)) - least
        return result

    def mixture(
        self, constants: np.ndarray, gradients: np.ndarray, last: int, rounds: int, wanted: float = np.inf
    ) -> float:
        """As in FeasibleSet, by the vertices of this set; constants (K,), gradients (K, N, M)."""
        return super(IntervalPolytopes, self).mixture(constants, gradients, last, rounds, wanted)

    def round(self, weights: np.ndarray, backward: bool = False) -> np.ndarray:
        """The schedule (N, M) with the largest weights (N, M)."""
        return self.vertex(-weights)

    def uniform(self) -> np.ndarray:
        """A schedule (N, M) of the set; shares of all of them are not known beforehand."""
        return self.vertex(np.zeros(self.shape))

    def contains(self, weights: np.ndarray) -> bool:
        """Whether weights (N, M) belong to the set up to ROUNDING."""
        return not self.check(weights)

    def check(self, weights: np.ndarray) -> list[Mistake]:
        """As in IntervalPolytopes for weights (N, M), and one mistake for every budget that is missed."""
        found = super().check(weights)
        if found:
            return found
        for key, b in self.budget.items():
            columns = self.real if key == TOTAL else np.array([self.names.index(key)])
            used = float(np.sum(weights[:, columns]))
            if abs(used - b) > ROUNDING * max(1, len(weights)):
                who = "all sensors together have" if key == TOTAL else f"sensor '{key}' has"
                what = f"{who} {used:.6g} readings, the budget is {b}"
                found.append(Mistake(("schedule",), what, f"exactly {plural(int(b), 'reading')}"))
        return found

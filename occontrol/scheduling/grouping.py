"""Budgets as sums of rows, all readings in one or those of every sensor in its own, so that projections are easy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occontrol.scheduling.budget import TOTAL, BudgetSet
from occontrol.scheduling.feasible_set import IntervalPolytopes
from occontrol.scheduling.objective import Objective


@dataclass(frozen=True, eq=False)
class Grouping:
    """Budgets as sums of rows: all readings in one row, or every sensor's in its own.

    Parameters
    ----------
    allowed : BudgetSet with room for every sensor at every instant
    """

    allowed: BudgetSet

    @property
    def together(self) -> bool:
        """Whether there is one row."""
        return TOTAL in self.allowed.budget or len(self.allowed.real) == 1

    @property
    def number(self) -> int | None:
        """What every row adds up to; None where the rows differ or are not bound."""
        a = self.allowed
        if a.select < len(a.real) or np.any(a.free):
            return None
        numbers = {int(b) for b in a.budget.values()}
        return numbers.pop() if len(numbers) == 1 and min(a.budget.values()) > 0 else None

    def rows(self, values: np.ndarray) -> np.ndarray:
        """(G, K, ...) of `values` (N, M, ...)."""
        real = values[:, self.allowed.real]
        if self.together:
            return np.ascontiguousarray(real.reshape(1, -1, *values.shape[2:]))
        return np.ascontiguousarray(np.swapaxes(real, 0, 1))

    def policy(self, rows: np.ndarray) -> np.ndarray:
        """The policy (N, M) of `rows` (G, K)."""
        a = self.allowed
        result = np.zeros(a.shape)
        result[:, a.real] = rows.reshape(len(result), -1) if self.together else rows.T
        result[:, a.idle] = a.select - np.sum(result, axis=1)
        return result

    def set(self) -> IntervalPolytopes:
        """The rows that are allowed."""
        return IntervalPolytopes(self.rows(self.allowed.upper), self.number or 0)


class Grouped:
    """J on rows (G, K); an Objective.

    Parameters
    ----------
    objective : J on policies
    grouping : Grouping of them
    """

    def __init__(self, objective: Objective, grouping: Grouping):
        self.objective, self.grouping = objective, grouping
        self.shape = grouping.set().shape
        self.states = objective.states
        self.forward_count = self.backward_count = 0

    def cost(self, weights: np.ndarray) -> float:
        """J of rows, `weights` (G, K)."""
        self.forward_count += 1
        return self.objective.cost(self.grouping.policy(weights))

    def cost_and_gradient(self, weights: np.ndarray) -> tuple[float, np.ndarray]:
        """J and its gradient (G, K) by the rows, `weights` (G, K)."""
        self.forward_count += 1
        self.backward_count += 1
        J, g = self.objective.cost_and_gradient(self.grouping.policy(weights))
        return J, self.grouping.rows(g - g[:, [self.grouping.allowed.idle]])

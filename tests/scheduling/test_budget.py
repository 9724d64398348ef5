"""Exact numbers of readings: cheapest schedules against enumeration, checks in words."""

from itertools import product

import numpy as np
import pytest

from occontrol.core.monitor import Monitor
from occontrol.scheduling import vertices
from occontrol.scheduling.budget import BudgetSet

N, M = 4, 3  # instants; sensors, the last is idle
BUDGETS = [{"total": 0}, {"total": 3}, {"total": 5}, {"a": 2}, {"a": 1, "b": 3}, {"b": 0}]


def made(select: int, budget: dict, seed: int = 0) -> BudgetSet:
    upper = np.ones((N, M))
    upper[:, 2] = select
    upper[seed % N, seed % 2] = 0.0
    return BudgetSet(upper, select, None, ("a", "b", "idle"), budget=budget)


def everything(allowed: BudgetSet):
    for bits in product([0, 1], repeat=2 * N):
        chosen = np.array(bits, dtype=float).reshape(N, 2)
        w = np.column_stack([chosen, allowed.select - chosen.sum(axis=1)])
        if np.all(w >= 0) and np.all(w <= allowed.upper):
            used = {"total": chosen.sum(), "a": chosen[:, 0].sum(), "b": chosen[:, 1].sum()}
            if all(used[key] == b for key, b in allowed.budget.items()):
                yield w


@pytest.mark.parametrize("select", [1, 2])
@pytest.mark.parametrize("budget", BUDGETS, ids=str)
def test_the_vertex_is_the_cheapest_schedule(select, budget):
    rng = np.random.default_rng(1)
    for seed in range(6):
        allowed, g = made(select, budget, seed), rng.standard_normal((N, M))
        costs = [float(np.vdot(g, w)) for w in everything(allowed)]
        if not costs:
            with pytest.raises(ValueError, match="the budget cannot be spent"):
                allowed.vertex(g)
            continue
        w = allowed.vertex(g)
        assert allowed.check(w) == []
        assert float(np.vdot(g, w)) == pytest.approx(min(costs), abs=1e-12)
        v = np.mean([w for _, w in zip(range(5), everything(allowed), strict=False)], axis=0)
        assert allowed.bound(1.0, v, g) == pytest.approx(1.0 - float(np.vdot(g, v)) + min(costs), abs=1e-12)


def test_what_misses_the_budget_is_named():
    allowed = made(1, {"a": 2})
    w = np.zeros((N, M))
    w[:, 2] = 1.0
    (mistake,) = allowed.check(w)
    assert "sensor 'a' has 0 readings, the budget is 2" in str(mistake)
    (mistake,) = made(1, {"total": 3}).check(w)
    assert "all sensors together have 0 readings, the budget is 3" in str(mistake)


class Bowl:
    """|A v - b|^2, an objective whose best moves the gradient foretells badly."""

    def __init__(self, seed: int, shape: tuple[int, int]):
        rng = np.random.default_rng(seed)
        self.shape, self.states = shape, 1
        self.A, self.b = rng.standard_normal((6, shape[0] * shape[1])), rng.standard_normal(6) * 4

    def cost(self, v):
        return float(np.sum((self.A @ v.ravel() - self.b) ** 2))

    def cost_and_gradient(self, v):
        return self.cost(v), (2 * self.A.T @ (self.A @ v.ravel() - self.b)).reshape(self.shape)


@pytest.mark.parametrize("budget", [{"total": 9}, {"a": 5, "b": 4}])
def test_moves_that_are_not_all_ranked_are_the_best_of_all(monkeypatch, budget):
    upper = np.ones((20, M))
    upper[:, 2] = 2
    allowed = BudgetSet(upper, 2, None, ("a", "b", "idle"), budget=budget)
    for seed in range(4):
        bowl, start = Bowl(seed, upper.shape), allowed.vertex(np.random.default_rng(seed).standard_normal(upper.shape))
        found = []
        for many in (200_000, 0):
            monkeypatch.setattr(vertices, "MANY_MOVES", many)
            found.append(vertices.by_moves(bowl, allowed, start, 10, Monitor())[1])
        assert found[0] == pytest.approx(found[1], rel=1e-12) and found[0] < bowl.cost(start)

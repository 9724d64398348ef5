"""Caps by their price: bounds at every price and schedules against full enumeration, which shares no code."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from occontrol.core.monitor import Monitor
from occontrol.scheduling.feasible_set import IntervalPolytopes
from occontrol.scheduling.rules import caps, pricing
from occontrol.scheduling.rules.capped import begun_at_price
from occontrol.scheduling.rules.tree import Search, TreeOptions
from tests.scheduling.rules.enumeration import allowed, error, optimum, spent, words
from tests.scheduling.rules.small_problems import small, task_of

NO_RULES = {
    "min_on": 0.0, "max_on": np.inf, "min_off": 0.0, "warm": 0.0, "max_uses": np.inf, "max_time": np.inf,
    "duty": (np.inf, np.inf), "revisit": np.inf,
}  # fmt: skip


def capped(seed: int, cap: str, goal: str, bare: bool, most: int = 6):
    """A random problem with one cap that a part of its schedules keeps; bare is without any other rule."""
    p, alpha, _ = small(seed, most)
    if bare:
        M = len(p.L)
        p.rules |= {name: [value] * M for name, value in NO_RULES.items()}
        p.rules |= {"max_switches": None, "switch": np.zeros((M, M)), "start": 0.0, "delay": np.zeros((M, M))}
        p.rules |= {"before": None, "enforce": False}
    p.rules |= {"max_observation": np.inf, "max_error": np.inf}
    kept = [list(w) for w in words(p) if allowed(p, list(w))]
    if not kept:
        return None
    if cap == "max_error":
        values = [error(p, w) for w in kept[::3]]
    else:
        values = [spent(p, w) for w in kept[::3]]
    p.rules[cap] = float(np.quantile(values, 0.35)) * (1 + 1e-6)
    best, count = optimum(p, alpha, goal)
    assert count
    return p, alpha, goal, best


def polytopes(p) -> IntervalPolytopes:
    return IntervalPolytopes(p.upper, p.select)


CASES = [
    *((seed, "max_observation", goal, True) for seed in (40, 41, 42, 44) for goal in ("error", "cost")),
    *((seed, "max_error", goal, True) for seed in range(50, 54) for goal in ("observation", "cost")),
    *((seed, "max_observation", "error", False) for seed in range(60, 66)),
    *((seed, "max_error", "observation", False) for seed in (70, 71, 72, 74, 76)),
]


@pytest.mark.parametrize(("seed", "cap", "goal", "bare"), CASES)
def test_no_price_gives_a_bound_above_the_optimum_and_the_tree_proves_it(
    seed: int, cap: str, goal: str, bare: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = capped(seed, cap, goal, bare)
    if made is None:
        pytest.skip("no schedule keeps these rules")
    p, alpha, goal, best = made
    task = task_of(p, alpha, goal)
    tried: list[pricing.AtPrice] = []
    at = pricing._Search.at
    monkeypatch.setattr(pricing._Search, "at", lambda self, *a: (tried.append(at(self, *a)), tried[-1])[1])
    search = Search(task, TreeOptions(gap=1e-7), Monitor(), [])
    start = np.full(task.oracle.shape, 1.0 / task.oracle.shape[1])
    begun = begun_at_price(search, cap, start, polytopes(p))
    slack = 1e-9 * abs(best) + 1e-12
    assert all(a.bound <= best + slack for a in tried)
    if search.best is not None:
        assert search.best.value >= best - slack
    tree = search.run(start, begun)
    assert tree.complete and tree.best is not None
    assert tree.best.value == pytest.approx(best, rel=1e-7, abs=1e-12)
    assert tree.lower_bound <= best + slack and tree.root.lower_bound <= best + slack


def test_the_best_price_bounds_as_much_as_any_of_a_fine_grid() -> None:
    p, alpha, goal, best = capped(41, "max_observation", "error", True)  # type: ignore[misc]
    task, limit = task_of(p, alpha, goal), p.rules["max_observation"]
    start = np.full(task.oracle.shape, 1.0 / task.oracle.shape[1])
    found = pricing.price_of(task, "max_observation", start, polytopes(p), lambda plan: None, Monitor())
    assert found is not None
    values = []
    for price in found.best.price * np.geomspace(0.3, 3, 15):
        problem = caps.priced(task, "max_observation", price)
        search = pricing._Search(replace(task), "max_observation", polytopes(p), lambda plan: None, Monitor())
        values.append(search.at(price, found.best).bound)
        assert problem.rules.max_observation == np.inf
    assert found.best.bound >= max(values) - 1e-4 * abs(best)
    assert found.best.bound <= best and found.value <= best * (1 + 1e-4)
    assert caps.used_by(task, "max_observation", found.mixture) <= limit * (1 + 1e-9)


def test_a_price_is_that_of_one_unit_more() -> None:
    p, alpha, goal, _ = capped(42, "max_observation", "error", True)  # type: ignore[misc]

    def bound(limit: float) -> pricing.Priced:
        p.rules["max_observation"] = limit
        task = task_of(p, alpha, goal)
        start = np.full(task.oracle.shape, 1.0 / task.oracle.shape[1])
        found = pricing.price_of(task, "max_observation", start, polytopes(p), lambda plan: None, Monitor())
        assert found is not None
        return found

    limit = p.rules["max_observation"]
    more, less, here = bound(1.02 * limit), bound(0.98 * limit), bound(limit)
    slope = (less.best.bound - more.best.bound) / (0.04 * limit)
    assert here.best.price == pytest.approx(slope, rel=0.03)


def test_a_cap_that_does_not_bind_has_no_price() -> None:
    p, alpha, goal, _ = capped(43, "max_observation", "error", True)  # type: ignore[misc]
    p.rules["max_observation"] = 1e3
    task = task_of(p, alpha, goal)
    start = np.full(task.oracle.shape, 1.0 / task.oracle.shape[1])
    found = pricing.price_of(task, "max_observation", start, polytopes(p), lambda plan: None, Monitor())
    assert found is not None and found.best.price == 0.0 and found.prices == 1

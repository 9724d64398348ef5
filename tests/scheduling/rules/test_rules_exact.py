"""Branch and bound against full enumeration, whose rules and costs share no code with the search."""

from __future__ import annotations

import numpy as np
import pytest

from occontrol.core.monitor import Monitor
from occontrol.scheduling.rules.check import keeps
from occontrol.scheduling.rules.oracle import Prices
from occontrol.scheduling.rules.tree import Search, TreeOptions
from tests.scheduling.rules.enumeration import allowed, error, optimum, words
from tests.scheduling.rules.small_problems import small, task_of

ROUNDING = 1e-9


def limited(seed: int, most: int):
    """A random problem; one that minimises the observation cost gets a limit on the error that some schedules keep."""
    p, alpha, goal = small(seed, most)
    if goal == "observation":
        errors = [error(p, list(w)) for w in list(words(p))[::5] if allowed(p, list(w))]
        if not errors:
            return p, alpha, "cost"
        p.rules["max_error"] = float(np.quantile(errors, 0.3))
    return p, alpha, goal


@pytest.mark.parametrize("seed", range(24))
def test_the_tree_finds_and_proves_the_optimum_of_enumeration(seed: int) -> None:
    p, alpha, goal = limited(seed, 5)
    best, count = optimum(p, alpha, goal)
    task = task_of(p, alpha, goal)
    start = np.full(task.oracle.shape, 1.0 / task.oracle.shape[1])
    tree = Search(task, TreeOptions(gap=1e-7), Monitor(), []).run(start)
    assert tree.complete
    if not count:
        assert tree.best is None and tree.lower_bound == np.inf
        return
    assert tree.best is not None and tree.best.value == pytest.approx(best, rel=1e-7)
    assert best * (1 - 2e-7) - 1e-12 <= tree.lower_bound <= best * (1 + ROUNDING) + 1e-12
    assert tree.root.lower_bound <= best * (1 + ROUNDING) + 1e-12


@pytest.mark.parametrize("seed", range(100, 130))
def test_the_checker_and_the_oracle_agree_with_the_words_of_the_rules(seed: int) -> None:
    p, alpha, goal = small(seed, 4)
    task = task_of(p, alpha, goal)
    M = p.upper.shape[1]
    kept = 0
    for word in words(p):
        on = np.array([[j in s for j in range(M)] for s in word])
        p.rules["max_observation"] = np.inf
        right = allowed(p, list(word))
        assert keeps(task.rules, p.times, on) == right, word
        plan = task.oracle.follow(on)
        if right:
            kept += 1
            assert plan is not None, word
        elif task.complete:
            assert plan is None, word
        told = task.oracle.switching(on)
        if np.isfinite(told):
            assert plan is not None and told == pytest.approx(plan.switching, abs=1e-15), word
        elif np.isinf(told):
            assert plan is None, word
        else:
            assert task.rules.slews()
    if not kept and task.complete:
        assert task.oracle.first_impossible() is not None


def test_rules_under_which_no_first_interval_is_possible_have_no_schedule() -> None:
    p, alpha, goal = small(1, 4)
    p.rules["max_uses"] = [0.0] * len(p.L)
    p.upper[:, np.array(p.idle)] = 0.0
    task = task_of(p, alpha, goal)
    tree = Search(task, TreeOptions(), Monitor(), []).run(np.zeros(task.oracle.shape))
    assert tree.best is None and tree.lower_bound == np.inf and task.oracle.first_impossible() == 0


@pytest.mark.parametrize("seed", [2, 3, 5, 8, 11, 13, 17])
def test_what_the_best_schedule_through_an_action_costs_is_that_of_enumeration(seed: int) -> None:
    p, alpha, goal = small(seed, 4)
    p.rules |= {"max_observation": np.inf, "max_error": np.inf}
    task = task_of(p, alpha, goal)
    if not task.complete:
        pytest.skip("some rules are priced")
    rng = np.random.default_rng(seed)
    g = rng.normal(size=task.oracle.shape)
    M, prices = p.upper.shape[1], Prices(*rng.uniform(0, 0.3, (3, *p.upper.shape)))
    least = task.oracle.least_through(g, prices)
    best = np.full(least.shape, np.inf)
    for word in words(p):
        if not allowed(p, list(word)):
            continue
        plan = task.oracle.follow(np.array([[j in s for j in range(M)] for s in word]))
        assert plan is not None
        value = float(np.vdot(g, plan.weights)) + plan.switching + prices.of(plan)
        at = np.arange(len(plan.actions)), plan.actions
        best[at] = np.minimum(best[at], value)
    np.testing.assert_allclose(least, best, rtol=1e-12, atol=1e-12)

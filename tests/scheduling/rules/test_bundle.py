"""Bounds from many tangents: the game against a linear program, bounds of nodes against full enumeration."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

from occontrol.core.monitor import Monitor
from occontrol.scheduling.rules.bundle import Bundle, solve
from occontrol.scheduling.rules.game import play
from occontrol.scheduling.rules.hull import HullOptions
from occontrol.scheduling.rules.master import Tangent
from tests.scheduling.rules.enumeration import allowed, error, spent, switching, words
from tests.scheduling.rules.small_problems import small, task_of


@pytest.mark.parametrize(("count", "columns"), [(1, 1), (1, 6), (6, 1), (12, 30), (40, 25)])
@pytest.mark.parametrize("offset", [0.0, 400.0])
def test_the_game_has_the_value_of_a_linear_program(count: int, columns: int, offset: float) -> None:
    rng = np.random.default_rng(count + columns)
    for A in (rng.standard_normal((count, columns)), rng.integers(-2, 3, (count, columns)).astype(float)):
        A = 1e-3 * A + offset
        shares, weights, value = play(A)
        table, one = np.column_stack([A, -np.ones(count)]), np.append(np.ones(columns), 0.0)
        limits = [(0, None)] * columns + [(None, None)]
        found = linprog(1 - one, A_ub=table, b_ub=np.zeros(count), A_eq=one[None], b_eq=[1.0], bounds=limits)
        slack = 1e-9 * (offset + 1e-3)
        assert value == pytest.approx(found.fun, abs=slack)
        assert np.min(weights @ A) == pytest.approx(found.fun, abs=slack)
        assert np.all(shares >= 0) and np.all(weights >= 0)
        assert np.sum(shares) == pytest.approx(1.0) and np.sum(weights) == pytest.approx(1.0)


@pytest.mark.parametrize("seed", [1, 4, 6, 9, 12, 15, 21, 27])
def test_no_bound_of_a_node_is_above_its_best_schedule_and_the_line_holds_for_all(seed: int) -> None:
    p, alpha, _ = small(seed, 5)
    p.rules |= {"max_observation": np.inf, "max_error": np.inf}
    task = task_of(p, alpha, "cost")
    if not task.complete:
        pytest.skip("rows are priced: their hull is found otherwise")
    M, rng = p.upper.shape[1], np.random.default_rng(seed)
    cost = {
        np.array([[j in s for j in range(M)] for s in w]).tobytes(): (
            alpha * spent(p, list(w)) + error(p, list(w)) + switching(p, list(w))
        )
        for w in words(p)
        if allowed(p, list(w))
    }
    plans = {key: task.oracle.follow(np.frombuffer(key, dtype=bool).reshape(-1, M)) for key in cost}
    bundle, (N, C) = Bundle(task), task.oracle.shape
    for _ in range(2):  # tangents anywhere hold
        bundle.take(Tangent.at(task, rng.dirichlet(np.ones(C), size=N)))
    raised = 0
    for _ in range(12):
        mask = rng.random(task.oracle.open.shape) < 0.7
        found = solve(bundle, mask, HullOptions(1e-9, lambda: np.inf, 200), lambda plan: None, Monitor())
        inside = [key for key, plan in plans.items() if np.all(mask[np.arange(N), plan.actions])]  # type: ignore[union-attr]
        if not inside:
            assert found.lower_bound == np.inf
            continue
        best = min(cost[key] for key in inside)
        assert found.lower_bound <= best * (1 + 1e-9) + 1e-12
        raised += found.lower_bound > 0.5 * best
        assert found.line is not None
        constant, g = found.line
        for key, plan in plans.items():  # the line is below the true cost of every schedule, masked or not
            line = constant + float(np.vdot(g, plan.weights)) + plan.switching  # type: ignore[union-attr]
            assert line <= cost[key] * (1 + 1e-9) + 1e-12
    assert raised > 0 or not cost

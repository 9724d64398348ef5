"""What a schedule costs from the blocks that differ alone, against a sweep over all of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from occontrol.core.monitor import Monitor
from occontrol.scheduling.rules.block_cost import BlockCost
from occontrol.scheduling.rules.moves import Mover, Scored
from occontrol.scheduling.sweep import Sweep
from tests.scheduling.rules.small_problems import small, task_of


@pytest.mark.parametrize("running", [False, True])
@pytest.mark.parametrize("owner", [False, True])
def test_the_cost_of_a_changed_block_is_that_of_a_whole_sweep(running: bool, owner: bool) -> None:
    rng = np.random.default_rng(3)
    recursion = task_of(*small(4)).sweep.recursion
    n = recursion.states
    weight = np.eye(n)[None] if running else np.empty((0, n, n))
    recursion = replace(recursion, running=weight, terminal=np.diag(np.arange(n) + 0.5))
    if owner:  # decisions of one and of two steps
        fewer = len(recursion.steps) - len(recursion.steps) // 2
        places = np.minimum(np.arange(len(recursion.steps)) // 2, fewer - 1)
        recursion = replace(recursion, owner=places, available=recursion.available[: places[-1] + 1])
    sweep, plain = Sweep(recursion), Sweep(recursion)
    N, C = sweep.shape
    costs = BlockCost(sweep)
    for _ in range(4):
        base = np.eye(C)[rng.integers(C, size=N)]
        assert costs.begin(base) == pytest.approx(plain.cost_and_gradient(base)[1], rel=1e-12)
        assert costs.value(base) == pytest.approx(plain.cost(base), rel=1e-12)
        for a in range(N):
            for b in range(a + 1, N + 1):
                other = base.copy()
                other[a:b] = np.eye(C)[rng.integers(C, size=b - a)]
                assert costs.value(other) == pytest.approx(plain.cost(other), rel=1e-12)


@pytest.mark.parametrize("seed", [4, 6, 9, 12])
def test_moves_end_at_a_schedule_whose_cost_is_that_of_the_task(seed: int) -> None:
    task = task_of(*small(seed))
    _, plan = task.oracle.minimise(np.random.default_rng(seed).standard_normal(task.oracle.shape))
    if plan is None or not np.isfinite(task.value(plan)):
        pytest.skip("the first schedule breaks a budget")
    begun = Scored(plan, task.value(plan))
    better = Mover(task).improve(begun, 200, Monitor())
    assert better.value <= begun.value
    assert better.value == pytest.approx(task.value(better.plan), rel=1e-14)

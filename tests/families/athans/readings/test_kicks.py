"""Local search by random exchanges on schedules of readings."""

from __future__ import annotations

import numpy as np
import pytest

import occontrol as oc
from occontrol.core.monitor import Monitor
from occontrol.families.athans.readings.fill import feasible_set, fill
from occontrol.scheduling.hminimal import polish
from occontrol.scheduling.shaking import kick
from occontrol.scheduling.sweep import Sweep
from scripts.instances import selection


@pytest.fixture(scope="module")
def stuck():
    """A schedule that no single exchange improves, though it is not the best."""
    problem = selection(20, 10, 8, 3, 1.05, 0)
    filled, allowed = fill(problem), feasible_set(problem)
    sweep, start = Sweep(filled.recursion), np.zeros((8, 10))
    start[:, :3] = 1.0
    return sweep, allowed, polish(sweep, allowed, start)


def test_kicks_improve_what_exchanges_cannot_and_stay_legal(stuck) -> None:
    sweep, allowed, best = stuck
    found = kick(sweep, allowed, best, -np.inf, 20_000)
    assert found.cost < best.cost * (1 - 1e-5)
    assert allowed.check(found.weights) == [] and set(np.unique(found.weights)) == {0.0, 1.0}
    assert sweep.cost(found.weights) == pytest.approx(found.cost, rel=1e-12)
    again = kick(sweep, allowed, best, -np.inf, 20_000)
    assert np.array_equal(found.weights, again.weights)


def test_nothing_is_kicked_that_is_good_enough_or_has_no_time(stuck) -> None:
    sweep, allowed, best = stuck
    assert kick(sweep, allowed, best, best.cost, 20_000) is best
    assert kick(sweep, allowed, best, -np.inf, 0) is best
    assert kick(sweep, allowed, best, -np.inf, 20_000, monitor=Monitor(interrupted=2)) is best


def test_a_schedule_without_any_exchange_stays(stuck) -> None:
    problem = selection(4, 2, 3, 2, 0.9, 0)  # both sensors at every step
    solution = oc.solve(problem)
    assert np.all(solution.arrays["weights"] == 1.0)


def test_the_default_method_ends_no_higher_than_exchanges_from_many_starts() -> None:
    problem = selection(20, 10, 8, 3, 1.05, 0)
    filled, allowed = fill(problem), feasible_set(problem)
    sweep, rng, costs = Sweep(filled.recursion), np.random.default_rng(0), []
    for _ in range(6):
        start = np.zeros((8, 10))
        for row in start:
            row[rng.permutation(10)[:3]] = 1.0
        costs.append(polish(sweep, allowed, start).cost + filled.constant)
    assert oc.solve(problem).cost <= min(costs) * (1 + 1e-9)

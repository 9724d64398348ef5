"""Baselines that keep exact numbers of readings: numbers, windows, and that greedy is greedy."""

from itertools import product

import numpy as np
import pytest

import occontrol as oc
from occontrol.api import solve
from occontrol.core.errors import UsageError
from occontrol.families.athans.readings.clock import SampleTimes, Steps
from occontrol.families.athans.readings.fill import feasible_set, fill
from occontrol.families.athans.readings.problem import ReadingsProblem
from occontrol.scheduling.sweep import Sweep

METHODS = ("greedy", "round-robin", "random")


def made(budget: dict, select: int = 1, N: int = 8) -> ReadingsProblem:
    plant = oc.DiscretePlant([[0.9, 0.2], [-0.1, 0.8]], np.diag([0.3, 0.5]), np.diag([4.0, 1.0]))
    sensors = [
        oc.Sensor("a", [[1.0, 0.0]], [[0.1]], cost=0.3, windows=[[2, 6]], variable="k"),
        oc.Sensor("b", [[0.0, 1.0]], [[0.4]], cost=0.1, variable="k"),
        oc.Sensor("c", [[1.0, 1.0]], [[0.2]], cost=0.01, variable="k"),
    ]
    return ReadingsProblem(
        "budgets", plant, sensors, Steps(N), np.eye(2), running=np.eye(2), budget=budget, select=select
    )


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    "budget, select",
    [({"total": 0}, 1), ({"total": 5}, 1), ({"total": 8}, 1), ({"total": 12}, 2), ({"total": 21}, 3),
     ({"a": 3}, 1), ({"a": 5, "b": 3}, 1), ({"a": 5, "b": 8, "c": 3}, 2), ({"c": 0}, 2), ({"b": 8, "c": 8}, 3)],
)  # fmt: skip
def test_the_numbers_are_kept(method, budget, select):
    problem = made(budget, select)
    solution = solve(problem, method)
    weights = solution.arrays["weights"]
    assert not feasible_set(problem).check(weights)
    names = problem.sensors.names
    used = {name: weights[:, names.index(name)].sum() for name in "abc"}
    for key, b in budget.items():
        assert (sum(used.values()) if key == "total" else used[key]) == b
    assert str(solution.status) in {"certified", "feasible"}
    assert solution.result["lower_bound"] <= solve(problem).cost * (1 + 1e-9)
    if method == "round-robin" and "total" not in budget:
        assert all(used[name] == 0 for name in "abc" if name not in budget)


def test_greedy_with_one_reading_is_the_optimum():
    plant = oc.LinearPlant([[0.0]], [[1.0]], [[0.0]])
    look = oc.Sensor("look", [[1.0]], [[0.1]])
    clock = SampleTimes(np.linspace(0, 1, 400, endpoint=False) + 1 / 400, 0.0, 1.0)
    problem = ReadingsProblem("brown", plant, [look], clock, [[0.0]], running=[[1.0]], budget={"total": 1})
    tau = clock.times
    # S grows to tau, falls to tau r/(tau + r), grows on
    after = tau * 0.1 / (tau + 0.1)
    exact = np.min(tau**2 / 2 + after * (1 - tau) + (1 - tau) ** 2 / 2)
    assert solve(problem, "greedy").cost == pytest.approx(exact, rel=1e-11)


def test_every_step_of_greedy_is_the_best_one():
    problem = made({"total": 4}, 2)
    sweep, allowed = Sweep(fill(problem).recursion), feasible_set(problem)
    v = np.zeros(allowed.shape)
    v[:, allowed.idle] = 2
    for _ in range(4):
        ways = []
        for k, j in product(range(8), map(int, allowed.real)):
            if v[k, j] < allowed.upper[k, j] and v[k, allowed.idle] > 0:
                w = v.copy()
                w[k, j] += 1
                w[k, allowed.idle] -= 1
                ways.append((sweep.cost(w), k, j, w))
        v = min(ways)[3]
    assert solve(problem, "greedy").cost == pytest.approx(sweep.cost(v), rel=1e-12)


def test_in_turn_is_spread_over_the_horizon():
    weights = solve(made({"total": 4}), "round-robin").arrays["weights"]
    at = [(int(k), "abc"[int(j)]) for k, j in np.argwhere(weights[:, :3] > 0.5)]
    assert at == [(0, "b"), (2, "c"), (4, "a"), (6, "b")]
    weights = solve(made({"b": 2}), "round-robin").arrays["weights"]
    assert [int(k) for k in np.flatnonzero(weights[:, 1])] == [2, 6]


@pytest.mark.parametrize("method", ["hminimal", "best-single"])
def test_what_makes_no_sense_is_refused_by_name(method):
    with pytest.raises(UsageError, match=f"{method} does not do budgets of readings"):
        solve(made({"total": 3}), method)


@pytest.mark.parametrize("budget, select", [({"total": 3}, 1), ({"total": 3}, 2), ({"a": 2}, 1), ({"a": 1, "b": 3}, 2)])
def test_what_can_be_saved_at_most_is_what_the_cheapest_schedule_saves(budget, select):
    """excess carries the bounds: v.g less the least w.g over all schedules that keep the budget, enumerated."""
    problem = made(budget, select, N=4)
    allowed, rng = feasible_set(problem), np.random.default_rng(1)
    ways = [w for w in product(range(2), repeat=12) if sum(w) <= 8]
    schedules = []
    for w in ways:
        v = np.zeros(allowed.shape)
        v[:, allowed.real] = np.reshape(w, (4, 3))
        v[:, allowed.idle] = select - v[:, allowed.real].sum(axis=1)
        if not allowed.check(v):
            schedules.append(v)
    table = np.array(schedules).reshape(len(schedules), -1)
    for _ in range(5):
        g = rng.standard_normal(allowed.shape)
        v = (rng.dirichlet(np.ones(len(table))) @ table).reshape(allowed.shape)
        saved = float(np.vdot(v, g) - np.min(table @ g.ravel()))
        assert float(np.sum(allowed.excess(v, g))) == pytest.approx(saved, rel=1e-9)

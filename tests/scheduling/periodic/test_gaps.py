"""Targets for ever: gaps, prices and joint cycles against every cycle, a linear programme, and closed forms."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from scipy.optimize import linprog

from occontrol.core.monitor import Monitor
from occontrol.scheduling.periodic.gaps import gap_graph
from occontrol.scheduling.periodic.joint import Costs, improved, laid_out
from occontrol.scheduling.periodic.prices import GapTable, best_prices
from tests.plain_cycles import discrete, in_units, mean_cost

WHOLE = np.ones((1, 1))


def target(seed: int, states: int = 2, looks: int = 1, growth: float = 1.05, precise: float = 1.0):
    """A random target that may be looked at or not; letter 0 is no look."""
    g = np.random.default_rng(seed)
    F = g.standard_normal((states, states))
    F *= g.uniform(0.7, growth) / np.max(np.abs(np.linalg.eigvals(F)))
    root = g.standard_normal((states, states))
    H = [np.zeros((0, states)), *(g.standard_normal((1, states)) for _ in range(looks))]
    R = [np.zeros((0, 0)), *(np.array([[10 ** g.uniform(-2, 0) / precise]]) for _ in range(looks))]
    at = "prior" if seed % 2 else "posterior"
    letters = discrete(F, 0.3 * root @ root.T + 0.05 * np.eye(states), H, R, np.eye(states), at=at)
    return letters, in_units(letters)[0]


def best_word(letters, price: float, longest: int) -> float:
    """The least mean cost of all cycles of one target, each look paid."""
    return min(
        mean_cost(letters, word) + price * np.mean(np.array(word) > 0)
        for p in range(1, longest + 1)
        for word in product(range(letters.count), repeat=p)
        if word == min(word[k:] + word[:k] for k in range(p))
    )


@pytest.mark.parametrize("seed", range(6))
def test_the_graph_of_gaps_bounds_every_cycle_of_a_target_from_below(seed: int) -> None:
    letters, scaled = target(seed, 1 + seed % 3, precise=30.0 if seed % 2 else 1.0)
    table = GapTable(scaled, WHOLE)
    for price in (0.0, 0.5, 5.0):
        bound, used = table.bound_at(np.array([price]))
        best = best_word(letters, price, 8)
        assert bound <= best * (1 + 1e-9) and bound >= (0.9 if seed % 2 else 0.5) * best
        assert 0 <= used[0] <= 1
    scalar, scaled = target(40, 1, precise=1e6)  # a look leaves nothing of the past: the graph is exact
    bound, _ = GapTable(scaled, WHOLE).bound_at(np.array([0.7]))
    assert bound == pytest.approx(best_word(scalar, 0.7, 8), rel=1e-5)


@pytest.mark.parametrize("deep", [False, True])
@pytest.mark.parametrize("prices", [(0.4, 1.1), (40.0, 60.0)])
def test_the_least_ratio_is_that_of_a_linear_programme(deep: bool, prices: tuple[float, float]) -> None:
    _, scaled = target(3, 2, looks=2)
    most, price = 4, np.array(prices)
    costs, last, further = gap_graph(*scaled.arrays, most, deep)
    nodes, M = costs.shape
    rows, sides = [], []
    for node in range(nodes):
        mine = node if node < M else (node - M) % M
        edges = [(costs[node, e] + price[e % 2], e // 2 + 1, M + M * mine + e if deep else e) for e in range(M)]
        edges += [(last[node, a] + price[a], most + 1, (most - 1) * 2 + a) for a in range(2)]
        for cost, gap, to in edges:
            row = np.zeros(nodes + 1)
            row[-1] = gap
            row[node] += 1
            row[to] -= 1
            rows.append(row)
            sides.append(cost)
    objective = np.append(np.zeros(nodes), -1.0)
    done = linprog(objective, A_ub=np.array(rows), b_ub=sides, bounds=[(None, None)] * (nodes + 1), method="highs")
    table = GapTable(scaled, np.eye(2), most=most)
    table.graph = (costs, last, further)
    table.policy, table.v = np.zeros(nodes, dtype=np.int64), np.zeros(nodes)
    proven, reached, start = table._solved(price)
    assert reached == pytest.approx(-done.fun, rel=1e-9) and start >= 0
    assert proven == pytest.approx(min(reached, further), rel=1e-9)


def test_a_target_that_is_better_left_alone_is() -> None:
    letters, scaled = target(5, 2, growth=0.8)
    bound, used = GapTable(scaled, WHOLE).bound_at(np.array([1e3]))
    alone = mean_cost(letters, (0,))
    assert used[0] == 0 and alone * (1 - 1e-4) <= bound <= alone


def best_joint(pairs, steps, longest: int) -> float:
    """The least cost of all joint cycles; `steps` are the choices of one step, a letter for every target."""
    known, best = {}, np.inf
    for p in range(1, longest + 1):
        for cycle in product(steps, repeat=p):
            words = [tuple(step[i] for step in cycle) for i in range(len(pairs))]
            for i, word in enumerate(words):
                if (i, word) not in known:
                    known[i, word] = mean_cost(pairs[i][0], word)
            best = min(best, sum(known[i, word] for i, word in enumerate(words)))
    return best


@pytest.mark.parametrize(("seeds", "precise"), [((1, 3), 30.0), ((2, 4, 6), 30.0), ((7, 8, 10), 1.0)])
def test_prices_bound_every_joint_cycle_and_the_search_finds_the_best(seeds: tuple[int, ...], precise: float) -> None:
    pairs = [target(s, 1 + s % 2, precise=precise) for s in seeds]
    K = len(pairs)
    longest = 6 if K == 2 else 5
    best = best_joint(pairs, [tuple(int(x == i) for i in range(K)) for x in range(K)], longest)
    found = best_prices([GapTable(s, WHOLE) for _, s in pairs], np.ones(1), Monitor())
    assert found.lower_bound <= best and found.lower_bound >= (0.93 if precise > 1 else 0.5) * best
    assert np.sum(found.used) == pytest.approx(1.0, abs=0.02)
    costs = Costs([s for _, s in pairs], [np.array([[0.0], [1.0]])] * K)
    reached = np.inf
    for p in range(1, longest + 1):
        random = np.random.default_rng(p)
        words = laid_out(costs, [np.array([0.0, x]) for x in found.used[:, 0]], p, np.ones(1), random)
        words, total = improved(costs, words, np.ones(1), 600, random, Monitor())
        assert np.all(np.sum(words, axis=0) <= 1)
        reached = min(reached, total)
    assert reached == pytest.approx(best, rel=1e-9)


def test_two_resources_have_two_prices_and_a_free_one_costs_nothing() -> None:
    pairs = [target(s, 2, looks=2, precise=10.0) for s in (1, 3, 5)]
    uses = np.eye(2)
    few = best_prices([GapTable(s, uses) for _, s in pairs], np.array([1.0, 1.0]), Monitor())
    plenty = best_prices([GapTable(s, uses) for _, s in pairs], np.array([1.0, 3.0]), Monitor())
    assert few.lower_bound > plenty.lower_bound and plenty.prices[1] <= 1e-9 < few.prices[0]
    choices = [c for c in product(range(3), repeat=3) if c.count(1) <= 1 and c.count(2) <= 1]
    best = best_joint(pairs, choices, 3)
    assert 0.7 * best <= few.lower_bound <= best

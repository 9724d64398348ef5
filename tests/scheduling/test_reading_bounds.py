"""Bounds that know readings are whole: noise extraction, and trees over first choices."""

import sys
from dataclasses import replace
from itertools import combinations, combinations_with_replacement, product

import numpy as np
import pytest

from occontrol.core.monitor import Monitor
from occontrol.scheduling.committed import Committed
from occontrol.scheduling.extraction import ExtractedSweep, extraction
from occontrol.scheduling.feasible_set import IntervalPolytopes
from occontrol.scheduling.first_choices import TreeLimits, branch, choices
from occontrol.scheduling.recursion import Recursion
from occontrol.scheduling.relaxation import RelaxedOptions, minimise_relaxed
from occontrol.scheduling.single_readings import branch_singly
from occontrol.scheduling.sweep import Sweep


def made(seed: int, n: int = 4, M: int = 3, N: int = 4, prior: float = 1.0) -> Recursion:
    rng = np.random.default_rng(seed)
    F = rng.standard_normal((n, n))
    F *= 0.9 / np.max(np.abs(np.linalg.eigvals(F)))
    return Recursion(
        initial=prior * np.eye(n), transition=np.stack([np.eye(n), F]),
        noise=np.stack([np.zeros((n, n)), 0.5 * np.eye(n)]),
        predict=np.minimum(np.arange(N + 1), 1), rows=np.linalg.qr(rng.standard_normal((n, n)))[0][None, :M] / 0.7,
        row_set=np.zeros(N, dtype=np.int64), offsets=np.arange(M + 1), steps=np.ones(N), cost=0.05 * rng.random((N, M)),
        running=np.eye(n)[None], running_set=np.zeros(N, dtype=np.int64), terminal=np.zeros((n, n)),
        available=np.ones((N, M)), charge=np.tile([0.0, 1.0], (N, 1)),
    )  # fmt: skip


def everything(sweep: Sweep, N: int, M: int) -> float:
    return min(sweep.cost(np.eye(M)[list(c)]) for c in product(range(M), repeat=N))


@pytest.mark.parametrize("seed", range(8))
def test_the_extracted_cost_is_the_cost_of_schedules_and_convex_between(seed):
    r = made(seed)
    rho, sweep = extraction(r), Sweep(r)
    assert rho > 1.0
    bent, rng = ExtractedSweep(sweep, rho), np.random.default_rng(seed)
    whole = np.eye(3)[rng.integers(0, 3, 4)]
    assert bent.cost(whole) == pytest.approx(sweep.cost(whole), rel=1e-13)
    a, b = rng.dirichlet(np.ones(3), 4), rng.dirichlet(np.ones(3), 4)
    assert bent.cost(a) >= sweep.cost(a) * (1 - 1e-12)
    middle = bent.cost((a + b) / 2)
    assert middle <= (bent.cost(a) + bent.cost(b)) / 2 + 1e-12
    J, g = bent.cost_and_gradient(a)
    assert J == pytest.approx(bent.cost(a), rel=1e-13)
    for k, j in product(range(4), range(3)):
        step = np.zeros((4, 3))
        step[k, j] = 1e-6
        assert g[k, j] == pytest.approx((bent.cost(a + step) - bent.cost(a - step)) / 2e-6, rel=1e-5, abs=1e-7)


@pytest.mark.parametrize("seed", range(8))
def test_its_bound_lies_between_the_plain_one_and_the_optimum(seed):
    r, allowed = made(seed), IntervalPolytopes(np.ones((4, 3)), 1)
    sweep, options = Sweep(r), RelaxedOptions(1e-6)
    plain = minimise_relaxed(sweep, allowed, None, options)
    bent = minimise_relaxed(ExtractedSweep(sweep, extraction(r)), allowed, plain.weights, options)
    best = everything(sweep, 4, 3)
    assert plain.lower_bound <= bent.lower_bound + 1e-6 * abs(best)
    assert bent.lower_bound <= best * (1 + 1e-12)
    assert bent.lower_bound > plain.lower_bound + 0.05 * (best - plain.lower_bound)


@pytest.mark.parametrize("seed", range(8))
def test_what_is_extracted_leaves_the_covariance_of_all_readings_definite(seed):
    """Smallest eigenvalue of the joint covariance of all signals: above it J~ is not convex, and its bound none."""
    r = made(seed, N=3)
    F, Q, C, S = r.transition[1], r.noise[1], r.rows[0], [r.initial]
    for _ in range(2):
        S.append(F @ S[-1] @ F.T + Q)
    power = [np.linalg.matrix_power(F, d) for d in range(3)]
    joint = np.block(
        [[C @ (power[i - j] @ S[j] if i >= j else S[i] @ power[j - i].T) @ C.T for j in range(3)] for i in range(3)]
    )
    least = float(np.linalg.eigvalsh(joint)[0])
    assert 0.9 * least <= extraction(r) - 1.0 <= 0.999 * least


def test_nothing_is_extracted_where_readings_see_the_same():
    r = made(0, n=2, M=2)
    twice = np.repeat(r.rows[:, :1], 2, axis=1)
    assert extraction(replace(r, rows=twice)) == 1.0
    assert extraction(replace(r, initial=np.zeros((2, 2)))) == 1.0


@pytest.mark.parametrize("prior", [1.0, 1e4])
@pytest.mark.parametrize("seed", range(4))
def test_the_tree_proves_the_optimum_of_a_small_problem(seed, prior):
    r, allowed = made(seed, prior=prior), IntervalPolytopes(np.ones((4, 3)), 1)
    sweep = Sweep(r)
    root = minimise_relaxed(sweep, allowed, None, RelaxedOptions(1e-4))
    best = everything(sweep, 4, 3)
    tree = branch(sweep, allowed, root, 10 * best, TreeLimits(1e-6, 100_000), Monitor())
    assert tree.closed
    assert tree.cost == pytest.approx(best, rel=1e-12)
    assert tree.weights is not None and sweep.cost(tree.weights) == tree.cost
    assert best * (1 - 2e-6) <= tree.lower_bound <= best * (1 + 1e-12)


@pytest.mark.parametrize("gradients", [5, 30, 100, 400])
def test_a_tree_that_is_stopped_still_has_a_bound(gradients):
    r, allowed = made(1, N=5, prior=100.0), IntervalPolytopes(np.ones((5, 3)), 1)
    sweep = Sweep(r)
    root = minimise_relaxed(sweep, allowed, None, RelaxedOptions(1e-4))
    best = everything(sweep, 5, 3)
    tree = branch(sweep, allowed, root, best, TreeLimits(1e-6, gradients), Monitor())
    assert root.lower_bound <= tree.lower_bound <= best * (1 + 1e-12)


@pytest.mark.parametrize("tree", [branch, branch_singly])
@pytest.mark.parametrize("nodes", [1, 4, 12])
def test_rough_nodes_have_bounds_and_not_costs(tree, nodes):
    """Relaxations that end far from their optimum cost more than the best schedule; their bounds do not."""
    for seed in range(6):
        r, allowed = made(seed, N=5, prior=100.0), IntervalPolytopes(np.ones((5, 3)), 1)
        sweep = Sweep(r)
        start = minimise_relaxed(sweep, allowed, None, RelaxedOptions(0.9, 0))
        best = everything(sweep, 5, 3)
        found = tree(sweep, allowed, start, best, TreeLimits(1e-6, 100_000, 0.99, None, nodes=nodes), Monitor())
        assert found.lower_bound <= best * (1 - 1e-3)


def test_choices_of_one_decision():
    assert choices(np.ones(3), 4) is None
    assert [list(c) for c in choices(np.array([1.0, 0.0, 1.0]), 1)] == [[0, 0, 1], [1, 0, 0]]
    with_idle = choices(np.array([1.0, 1.0, 2.0]), 2)
    assert sorted(map(tuple, with_idle)) == [(0, 0, 2), (0, 1, 1), (1, 0, 1), (1, 1, 0)]
    assert choices(np.ones(40), 5) is None


def two_of(M: int, N: int, sweep: Sweep, upper: np.ndarray) -> float:
    """The least cost of two sensors at a time, idle (the last, up to 2) among them, by enumeration."""
    ways = [np.eye(M)[list(c)].sum(axis=0) for c in combinations_with_replacement(range(M), 2)]
    ways = [w for w in ways if np.all(w[:-1] <= 1)]
    found = []
    for chosen in product(ways, repeat=N):
        v = np.array(chosen)
        if np.all(v <= upper):
            found.append(sweep.cost(v))
    return min(found)


@pytest.mark.parametrize("bent", [False, True])
@pytest.mark.parametrize("seed", range(6))
def test_single_readings_prove_the_optimum(seed, bent):
    """Windows, and idle that may fill both places; every bound on the way lies below the optimum."""
    r = made(seed, M=4, N=3, prior=10.0)
    r = replace(r, rows=r.rows[:, :3], offsets=np.array([0, 1, 2, 3, 3]))
    upper = np.ones((3, 4))
    upper[:, 3], upper[1, 0] = (2.0 if seed % 2 else 0.0), (0.0 if seed % 3 == 0 else 1.0)
    r = replace(r, available=upper)
    sweep, allowed = Sweep(r), IntervalPolytopes(upper, 2)
    objective = ExtractedSweep(sweep, extraction(r)) if bent else sweep
    root = minimise_relaxed(objective, allowed, None, RelaxedOptions(1e-4))
    best = two_of(4, 3, sweep, upper)
    for nodes in (4, 10_000):
        tree = branch_singly(objective, allowed, root, 10 * best, TreeLimits(1e-6, 100_000, nodes=nodes), Monitor())
        assert root.lower_bound <= tree.lower_bound <= best * (1 + 1e-12)
    assert tree.closed and tree.cost == pytest.approx(best, rel=1e-12)
    assert tree.weights is not None and allowed.contains(tree.weights) and sweep.cost(tree.weights) == tree.cost
    assert tree.lower_bound >= best * (1 - 2e-6)


@pytest.mark.parametrize("places", [1, 2])
@pytest.mark.parametrize("seed", range(4))
def test_readings_that_cost_more_than_they_save_are_left_to_idle(seed, places, monkeypatch):
    """The cheapest schedule takes few readings: a node in which idle must fill the places is no dead end.

    Rounding is made useless, so that no lucky schedule hides a node that was lost.
    """
    monkeypatch.setattr(Committed, "round", lambda self, weights, backward=False: self.vertex(weights))
    r = made(seed, M=4, N=3, prior=10.0)
    dear = np.full((3, 4), 60.0)
    dear[0], dear[:, 3] = 0.01, 0.0
    upper = np.ones((3, 4))
    upper[:, 3] = places
    r = replace(r, rows=r.rows[:, :3], offsets=np.array([0, 1, 2, 3, 3]), cost=dear, available=upper)
    sweep, allowed = Sweep(r), IntervalPolytopes(upper, places)
    root = minimise_relaxed(sweep, allowed, None, RelaxedOptions(1e-4))
    ways = [v for v in product((0.0, 1.0), repeat=3) if sum(v) <= places]
    best = min(sweep.cost(np.array([[*v, places - sum(v)] for v in each])) for each in product(ways, repeat=3))
    for nodes in (3, 10_000):
        tree = branch_singly(sweep, allowed, root, 10 * best, TreeLimits(1e-6, 100_000, nodes=nodes), Monitor())
        assert root.lower_bound <= tree.lower_bound <= best * (1 + 1e-12)
    assert tree.closed and tree.cost == pytest.approx(best, rel=1e-12)
    assert tree.weights is not None and np.any(tree.weights[1:, 3] == places)


@pytest.mark.parametrize("seed", range(5))
def test_committed_weights_stay_and_the_rest_is_nearest_and_cheapest(seed):
    rng = np.random.default_rng(seed)
    upper, fixed = np.ones((6, 5)), np.zeros((6, 5), dtype=bool)
    fixed[np.arange(6), rng.integers(0, 5, 6)] = rng.random(6) < 0.7
    allowed = Committed(upper, 2, None, (), fixed)
    g, y = rng.standard_normal((2, 6, 5)) * 10.0 ** rng.integers(-3, 4)
    rest = np.where(fixed, 0.0, 1.0)
    for k in range(6):
        ways = [np.eye(5)[list(c)].sum(axis=0) for c in combinations(range(5), 2)]
        ways = [w for w in ways if np.all(w[fixed[k]] == 1)]
        cheapest = min(ways, key=lambda w: float(g[k] @ w))
        assert np.array_equal(allowed.vertex(g)[k], cheapest)
        v = np.mean(ways, axis=0)
        assert allowed.excess(np.tile(v, (6, 1)), g)[k] == pytest.approx(g[k] @ (v - cheapest), rel=1e-9)
        single = IntervalPolytopes(rest[k : k + 1], 2 - int(fixed[k].sum()))
        expected = single.project(y[k : k + 1])[0] + fixed[k]
        assert allowed.project(y)[k] == pytest.approx(expected, abs=1e-11)


@pytest.mark.parametrize("tree", [branch, branch_singly])
@pytest.mark.parametrize("nodes", [2, 6, 20])
def test_what_a_node_costs_is_never_its_bound(tree, nodes, monkeypatch):
    """Nodes whose relaxation ends as dear as can be, with the bound that it has: the tree's stays below the optimum."""
    module = sys.modules[tree.__module__]

    def dear(*arguments):
        return replace(minimise_relaxed(*arguments), cost=1e9)

    monkeypatch.setattr(module, "minimise_relaxed", dear)
    for seed in range(3):
        r, allowed = made(seed, N=5, prior=100.0), IntervalPolytopes(np.ones((5, 3)), 1)
        sweep = Sweep(r)
        root = minimise_relaxed(sweep, allowed, None, RelaxedOptions(1e-4))
        best = everything(sweep, 5, 3)
        found = tree(sweep, allowed, root, 10 * best, TreeLimits(1e-6, 100_000, nodes=nodes), Monitor())
        assert root.lower_bound <= found.lower_bound <= best * (1 + 1e-12)

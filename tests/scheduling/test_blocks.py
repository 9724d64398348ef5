"""Blocks against the dense sweep, against square roots, and against difference quotients; the feasible set of looks."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from occontrol.scheduling.blocks.components import block_groups, block_sweep, components
from occontrol.scheduling.blocks.resources import ResourceSet
from occontrol.scheduling.blocks.sweep import BlockSweep
from occontrol.scheduling.certified import Apart, Roots, square_root_pass
from occontrol.scheduling.feasible_set import IntervalPolytopes
from occontrol.scheduling.recursion import Recursion
from occontrol.scheduling.sweep import Sweep


def scattered(seed: int, least: float = -1.0, most: float = 0.5) -> tuple[Recursion, np.ndarray, list[int]]:
    """A random recursion of a few blocks whose states are shuffled; a policy; the sizes of the blocks.

    Weights couple blocks, sensors see several of them, several sensors see the same, some are not available; every
    second one has several steps a decision, every third changes from step to step.
    """
    g = np.random.default_rng(seed)
    sizes = [int(s) for s in g.integers(1, 5, size=g.integers(2, 7))]
    n, K, M = sum(sizes), int(g.integers(3, 9)), int(g.integers(2, 6))
    varying, several = seed % 3 == 2, seed % 2 == 1
    U, sets = (K + 1, K) if varying else (2, 1)
    ends = np.cumsum([0, *sizes])
    spans = [slice(a, b) for a, b in itertools.pairwise(ends)]
    F, Q, S = np.zeros((U, n, n)), np.zeros((U, n, n)), np.zeros((n, n))
    for span, s in zip(spans, sizes, strict=True):
        root = g.standard_normal((U + 1, s, s))
        F[:, span, span] = g.standard_normal((U, s, s)) / np.sqrt(s)
        Q[:, span, span] = root[1:] @ np.swapaxes(root[1:], 1, 2)
        S[span, span] = root[0] @ root[0].T
    rows, offsets = [], [0]
    for _ in range(M):
        seen = g.choice(len(spans), size=int(g.integers(1, len(spans) + 1)), replace=False)
        for b in seen:
            for _ in range(int(g.integers(1, 3))):
                row = np.zeros((sets, n))
                row[:, spans[b]] = g.standard_normal((sets, sizes[b])) * 10 ** g.uniform(least, most)
                rows.append(row)
        offsets.append(len(rows))
    W, R = g.standard_normal((n, n)), g.standard_normal((2, n, n))
    N = K // 2 if several else K
    owner = np.sort(np.concatenate([np.arange(N), g.integers(0, N, K - N)])) if several else None
    order = g.permutation(n)

    def shuffled(matrix: np.ndarray) -> np.ndarray:
        return np.ascontiguousarray(matrix[..., order, :][..., order])

    stacked = np.stack(rows, axis=1) if rows else np.zeros((sets, 0, n))
    available = (g.random((N, M)) < 0.8).astype(float)
    recursion = Recursion(
        shuffled(S), shuffled(F), shuffled(Q), np.arange(K + 1) if varying else g.integers(0, U, K + 1),
        np.ascontiguousarray(stacked[:, :, order]), np.arange(K) if varying else np.zeros(K, dtype=np.int64),
        np.array(offsets), g.uniform(0.2, 1, K), g.random((K, M)), shuffled(R @ np.swapaxes(R, 1, 2)),
        g.integers(0, 2, K), shuffled(W @ W.T), available, owner,
    )  # fmt: skip
    return recursion, available * g.random((N, M)) * (g.random((N, M)) < 0.7), sorted(sizes)


def blocked(recursion: Recursion) -> BlockSweep:
    """The block sweep of a recursion, whatever its blocks."""
    groups = block_groups(recursion, components(recursion))
    return BlockSweep(groups, recursion.steps, recursion.charges, recursion.decision_cost)


@pytest.mark.parametrize("seed", range(40))
def test_blocks_equal_the_dense_sweep(seed: int) -> None:
    recursion, policy, _ = scattered(seed)
    J, g = Sweep(recursion, whole=True).cost_and_gradient(policy)
    sweep = blocked(recursion)
    value, gradient = sweep.cost_and_gradient(policy)
    assert value == pytest.approx(J, rel=1e-12)
    assert np.max(np.abs(gradient - g)) <= 1e-12 * np.max(np.abs(g))
    assert sweep.cost(policy) == value
    assert np.any(g != recursion.decision_cost)  # something is measured


def test_a_sweep_goes_by_blocks_where_there_are_many_states() -> None:
    for seed in range(12):
        recursion, policy, sizes = scattered(seed)
        sweep, dense = Sweep(recursion), Sweep(recursion, whole=True)
        many = recursion.states >= 12 and 2 * max(sizes) <= recursion.states
        assert dense.blocks is None and (sweep.blocks is not None or not many)
        (J, g), (value, gradient) = dense.cost_and_gradient(policy), sweep.cost_and_gradient(policy)
        assert value == pytest.approx(J, rel=1e-12) and sweep.cost(policy) == pytest.approx(J, rel=1e-12)
        assert np.max(np.abs(gradient - g)) <= 1e-12 * np.max(np.abs(g))
        counts = sweep.forward_count, sweep.backward_count
        n = recursion.states
        a, b = sweep.kept[0][:, :n, :n], dense.kept[0][:, :n, :n]
        assert np.max(np.abs(a - b)) <= 1e-12 * np.max(np.abs(b))
        assert (sweep.forward_count, sweep.backward_count) == counts


def whole_policy(seed: int) -> tuple[Recursion, IntervalPolytopes, np.ndarray]:
    """A random recursion of blocks with one step a decision, one sensor or idle at a time, and a whole policy."""
    recursion, _, _ = scattered(2 * seed)
    fields = {f: getattr(recursion, f) for f in recursion.__dataclass_fields__}
    N, M = recursion.available.shape
    rows = recursion.offsets[-1]
    fields |= {
        "available": np.column_stack([recursion.available, np.ones(N)]),
        "cost": np.column_stack([0.01 * recursion.cost, np.zeros(N)]),
        "offsets": np.append(recursion.offsets, rows),
    }
    if seed % 2:
        fields |= {"running": recursion.running[:0]}
    recursion = Recursion(**fields)
    allowed = IntervalPolytopes(recursion.available, 1)
    wanted = np.random.default_rng(seed).random((N, M + 1))
    wanted[::2, -1] = -1.0  # idle, where there is something to gain
    return recursion, allowed, allowed.vertex(wanted)


@pytest.mark.parametrize("seed", range(6))
def test_the_best_exchange_is_the_best_of_all(seed: int) -> None:
    recursion, allowed, v = whole_policy(seed)
    dense, sweep = Sweep(recursion, whole=True), blocked(recursion)
    J, gradient = sweep.cost_and_gradient(v)
    gain, leaving, entering = sweep.exchanges.best(v, gradient, *allowed.exchange_masks(v))
    leaves, enters = allowed.exchange_masks(v)
    found = 0
    for k in range(len(v)):
        tried = {}
        for j, e in itertools.product(np.flatnonzero(leaves[k]), np.flatnonzero(enters[k])):
            if j != e:
                other = v.copy()
                other[k, j] -= 1
                other[k, e] += 1
                tried[j, e] = dense.cost(other) - J
        least = min(tried.values(), default=0.0)
        if least >= -1e-9 * abs(J):
            assert gain[k] >= -1e-9 * abs(J)
            continue
        found += 1
        # what is left of a change is counted to first order, which never promises too much
        assert tried[leaving[k], entering[k]] <= gain[k] + 1e-9 * abs(J)
        assert gain[k] == pytest.approx(least, rel=2e-3, abs=1e-9 * abs(J))
    assert found


def test_the_blocks_are_found_whatever_the_order_of_the_states() -> None:
    for seed in range(20):
        recursion, _, sizes = scattered(seed)
        found = components(recursion)
        assert sorted(len(b) for b in found) <= sizes or len(found) >= len(sizes)
        assert sorted(np.concatenate(found)) == list(range(recursion.states))
        # nothing that drives the covariance joins two of them
        for b in found:
            rest = np.setdiff1d(np.arange(recursion.states), b)
            for matrices in (recursion.transition, recursion.noise, recursion.initial[None]):
                assert not np.any(matrices[:, b[:, None], rest])


def test_a_sensor_between_two_blocks_joins_them() -> None:
    recursion, _, _ = scattered(0)
    rows = recursion.rows.copy()
    rows[:, 0] = 1.0  # one row that sees everything, as a range between two targets would
    joined = Recursion(**{**{f: getattr(recursion, f) for f in recursion.__dataclass_fields__}, "rows": rows})
    assert len(components(joined)) == 1 and block_sweep(joined) is None


def test_the_gradient_is_that_of_the_cost() -> None:
    recursion, policy, _ = scattered(6)
    sweep = blocked(recursion)
    _, gradient = sweep.cost_and_gradient(policy)
    for k, j in np.argwhere(recursion.available > 0):
        h, moved = 1e-5, [policy.copy(), policy.copy()]
        moved[0][k, j] += h
        moved[1][k, j] += 2 * h
        slope = (-3 * sweep.cost(policy) + 4 * sweep.cost(moved[0]) - sweep.cost(moved[1])) / (2 * h)
        assert gradient[k, j] == pytest.approx(slope, rel=1e-5, abs=1e-6 * np.max(np.abs(gradient)))


def test_a_vague_start_and_sharp_sensors_keep_their_digits() -> None:
    recursion, policy, _ = scattered(4, least=2.0, most=3.0)
    fields = {f: getattr(recursion, f) for f in recursion.__dataclass_fields__}
    vague = Recursion(**{**fields, "initial": 1e8 * recursion.initial})
    exact = square_root_pass(Roots.of(vague), policy)
    value, gradient = blocked(vague).cost_and_gradient(policy)
    assert value == pytest.approx(exact.cost, rel=1e-9)
    assert np.max(np.abs(gradient - exact.gradient)) <= 1e-6 * np.max(np.abs(exact.gradient))


def test_the_square_root_pass_goes_block_by_block_with_the_same_numbers() -> None:
    apart = 0
    for seed in range(12):
        recursion, policy, _ = scattered(seed)
        one, parts = square_root_pass(Roots.of(recursion), policy), Apart.of(recursion)
        other = parts.take(policy)
        apart += len(parts.parts) > 1
        assert other.cost == pytest.approx(one.cost, rel=1e-12)
        assert np.max(np.abs(other.gradient - one.gradient)) <= 1e-11 * np.max(np.abs(one.gradient))
    assert apart > 3


def test_threads_and_padding_change_nothing() -> None:
    recursion, policy, _ = scattered(8)
    groups = block_groups(recursion, components(recursion))
    parts = (recursion.steps, recursion.charges, recursion.decision_cost)
    one, several = BlockSweep(groups, *parts, threads=1), BlockSweep(groups, *parts, threads=3)
    assert one.cost_and_gradient(policy)[0] == several.cost_and_gradient(policy)[0]


# ---- what looks are allowed


def looks(seed: int, stretches: int = 6) -> tuple[ResourceSet, np.random.Generator]:
    """A few stretches of a few looks, capacities from nothing to more than there are."""
    g = np.random.default_rng(seed)
    count = g.integers(1, 6, stretches)
    starts = np.concatenate([[0], np.cumsum(count + 1)])
    capacity = g.integers(0, 5, stretches)
    interval = np.arange(stretches)
    return ResourceSet(starts, capacity, interval, np.ones(stretches), np.zeros(starts[-1], dtype=np.int64)), g


def corners(allowed: ResourceSet, s: int) -> list[np.ndarray]:
    """Every allowed choice of whole looks on a stretch."""
    size, c = int(allowed.starts[s + 1] - allowed.starts[s]) - 1, int(allowed.capacity[s])
    return [np.array([*x, c - sum(x)]) for x in itertools.product((0.0, 1.0), repeat=size) if sum(x) <= c]


@pytest.mark.parametrize("seed", range(8))
def test_the_cheapest_looks_are_those_of_all(seed: int) -> None:
    allowed, g = looks(seed)
    gradient = g.standard_normal(allowed.shape)
    gradient[allowed.rest] = 0.0
    w = allowed.vertex(gradient)
    assert not allowed.check(w)
    v = allowed.project(g.random(allowed.shape))
    assert not allowed.check(v)
    excess = allowed.excess(v, gradient)
    for s in range(len(allowed.capacity)):
        part = slice(allowed.starts[s], allowed.starts[s + 1])
        best = min(float(x @ gradient[part, 0]) for x in corners(allowed, s))
        assert float(w[part, 0] @ gradient[part, 0]) == pytest.approx(best, abs=1e-14)
        assert excess[s] == pytest.approx(float(v[part, 0] @ gradient[part, 0]) - best, abs=1e-13)
    assert not allowed.check(allowed.round(v)) and np.all(np.isin(allowed.round(v)[:, 0], range(10)))


def test_ties_fill_exactly_the_capacity() -> None:
    allowed = ResourceSet(np.array([0, 6]), np.array([3]), np.array([0]), np.ones(1), np.zeros(6, dtype=np.int64))
    w = allowed.vertex(np.array([[-1.0]] * 5 + [[0.0]]))
    assert w[:, 0].tolist() == [1, 1, 1, 0, 0, 0]


def test_the_nearest_looks_are_nearer_than_any_other() -> None:
    allowed, g = looks(3)
    y = g.standard_normal(allowed.shape) + 0.5
    v = allowed.project(y)
    for _ in range(200):
        other = allowed.project(v + 0.3 * g.standard_normal(v.shape))
        assert np.sum((y - v) ** 2) <= np.sum((y - other) ** 2) + 1e-12


def test_the_multiplicative_step_uses_all_of_the_capacity() -> None:
    for seed in range(6):
        allowed, g = looks(seed)
        v, gradient = allowed.uniform(), -np.exp(3 * g.standard_normal(allowed.shape))
        gradient[allowed.rest] = 0.0
        w = allowed.scaled(v, gradient)
        assert not allowed.check(w)
        count = np.diff(allowed.starts) - 1
        assert np.allclose(w[allowed.rest, 0], np.maximum(allowed.capacity - count, 0), atol=1e-12)
        for s in range(len(count)):
            a, b = allowed.starts[s], allowed.starts[s + 1] - 1
            free = (w[a:b, 0] < 1) & (w[a:b, 0] > 0)
            ratio = (w[a:b, 0] / (-gradient[a:b, 0] * v[a:b, 0]))[free] if np.any(free) else np.ones(1)
            assert np.ptp(ratio) <= 1e-9 * np.max(ratio)


def test_what_is_no_schedule_of_looks_is_said() -> None:
    allowed = ResourceSet(np.array([0, 3]), np.array([1]), np.array([0]), np.ones(1), np.zeros(3, dtype=np.int64))
    assert "gives more than 1 looks" in allowed.check(np.array([[1.0], [1.0], [0.0]]))[0].what
    assert "between 0 and 1" in allowed.check(np.array([[2.0], [0.0], [-1.0]]))[0].what
    assert "2 weights of 3 looks" in allowed.check(np.zeros((2, 1)))[0].what

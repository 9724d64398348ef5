"""The exact search against enumeration, and its kernel against the filter."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from occontrol.core.monitor import Monitor
from occontrol.families.vlambda.epoch_kernel import LARGEST_EIGENVALUE, TRACE, advance
from occontrol.families.vlambda.filter import EigenfactorFilter
from occontrol.families.vlambda.sequence_search import SequenceProblem, search


def instance(seed, kind, epochs=None, candidates=None):
    """A random problem: unstable or stable, p < n noises, epochs of several steps, the last one perhaps shorter."""
    g = np.random.default_rng(seed)
    n = int(g.integers(1, 4))
    p = int(g.integers(1, n + 1))
    length = int(g.integers(1, 4))
    epochs = int(g.integers(2, 6)) if epochs is None else epochs
    steps = epochs * length - int(g.integers(0, length))
    count = int(g.integers(2, 4)) if candidates is None else candidates
    transition = g.standard_normal((steps, n, n)) * 1.1 / np.sqrt(n)
    noise_root = g.standard_normal((steps, n, p)) * g.choice([0.1, 1.0])
    rows = g.standard_normal((count, steps, 2, n)) * g.choice([0.3, 1.0, 3.0])
    together = np.ascontiguousarray(np.concatenate(list(rows), axis=1))
    starts = np.append(np.arange(0, steps, length), steps)
    root = np.eye(n) * 10.0 ** g.integers(-1, 3)
    return SequenceProblem(root, transition, noise_root, starts, rows, together, kind)


def plain_cost(problem, sequence):
    """Information-form recursion with explicit inverses: shares nothing with the kernel."""
    P, cost = problem.root @ problem.root.T, 0.0
    for e, choice in enumerate(sequence):
        for k in range(problem.starts[e], problem.starts[e + 1]):
            C = problem.rows[choice, k]
            P = np.linalg.inv(np.linalg.inv(P) + C.T @ C)
            cost += np.trace(P) if problem.kind == TRACE else np.linalg.eigvalsh(P)[-1]
            F, G = problem.transition[k], problem.noise_root[k]
            P = F @ P @ F.T + G @ G.T
    return cost


def enumerate_all(problem):
    sequences = itertools.product(range(len(problem.rows)), repeat=problem.epochs)
    return min((problem.cost_of(s), s) for s in sequences)


@pytest.mark.parametrize("kind", [TRACE, LARGEST_EIGENVALUE])
def test_equals_enumeration_on_a_hundred_random_instances(kind):
    for seed in range(100):
        problem = instance(seed, kind)
        best, _ = enumerate_all(problem)
        found = search(problem)
        assert found.proven, seed
        assert found.cost == pytest.approx(best, rel=1e-10), seed
        assert found.lower_bound <= found.cost
        assert problem.cost_of(found.sequence) == pytest.approx(found.cost, rel=1e-12)


def test_the_kernel_equals_a_recursion_with_explicit_inverses():
    for seed in range(20):
        for kind in (TRACE, LARGEST_EIGENVALUE):
            problem = instance(1000 + seed, kind)
            if problem.noise_root.shape[2] < problem.noise_root.shape[1]:
                problem = instance(1000 + seed + 50, kind)
            sequence = np.random.default_rng(seed).integers(0, len(problem.rows), problem.epochs)
            assert problem.cost_of(sequence) == pytest.approx(plain_cost(problem, sequence), rel=1e-7)


def test_the_kernel_equals_the_eigenfactor_filter():
    problem = instance(7, TRACE, epochs=5)
    state = problem.root.copy()
    cost = advance(state, problem.transition, problem.noise_root, problem.rows[0], TRACE)
    filter = EigenfactorFilter.start(problem.root @ problem.root.T, np.zeros(len(problem.root)))
    total = 0.0
    for k in range(len(problem.transition)):
        filter.measure(problem.rows[0, k])
        total += filter.factors.eigenvalues.sum()
        filter.propagate(problem.transition[k], problem.noise_root[k])
    assert cost == pytest.approx(total, rel=1e-10)
    assert np.allclose(state @ state.T, filter.factors.covariance, rtol=1e-9, atol=1e-12 * np.max(np.abs(state)) ** 2)


@pytest.mark.parametrize("kind", [TRACE, LARGEST_EIGENVALUE])
def test_limits_leave_a_valid_bound(kind):
    """A narrow or short search may miss the optimum, but its bound stays below and its cost above."""
    gaps = 0
    for seed in range(30):
        problem = instance(seed, kind, epochs=6, candidates=3)
        best, _ = enumerate_all(problem)
        for limits in ({"width": 1}, {"width": 2}, {"max_nodes": 1}, {"max_nodes": 60}):
            found = search(problem, **limits)
            assert found.lower_bound <= best * (1 + 1e-10), (seed, limits)
            assert found.cost >= best * (1 - 1e-10), (seed, limits)
            assert found.cost < np.inf
            gaps += found.cost - found.lower_bound > 1e-6 * found.cost
    assert gaps > 0, "no limit came into play, the test says nothing"


def test_an_interrupted_search_returns_the_best_so_far():
    problem = instance(3, TRACE, epochs=6, candidates=3)
    best, _ = enumerate_all(problem)
    found = search(problem, monitor=Monitor(interrupted=2))
    assert found.stopped
    assert found.lower_bound <= best <= found.cost * (1 + 1e-12)


def test_a_known_sequence_wins_a_tie():
    """Two equal candidates: every sequence costs the same, so the one that came first stays."""
    problem = instance(4, TRACE, epochs=4, candidates=2)
    rows = np.stack([problem.rows[0], problem.rows[0]])
    same = SequenceProblem(
        problem.root, problem.transition, problem.noise_root, problem.starts, rows, problem.together, TRACE
    )
    known = (1, 0, 1, 1)
    found = search(same, incumbents=[known])
    assert found.sequence == known
    assert found.proven
    assert search(same).sequence == (0, 0, 0, 0)


class Ticking(Monitor):
    """Its clock goes on by ten milliseconds whenever somebody looks: the same on every machine."""

    ticks = 0

    @property
    def seconds(self):
        self.ticks += 1
        return 1e-2 * self.ticks


def test_a_time_limit_is_kept_and_leaves_floors_for_the_bound():
    """Many candidates, a large state: stopped long before the end, yet with a bound above zero."""
    g = np.random.default_rng(0)
    n, steps, count = 12, 60, 40
    rows = np.tile(g.standard_normal((count, 1, 1, n)), (1, steps, 1, 1))
    transition = np.tile(0.98 * np.linalg.qr(g.standard_normal((n, n)))[0], (steps, 1, 1))
    noise_root = np.tile(0.3 * np.eye(n), (steps, 1, 1))
    together = np.ascontiguousarray(np.concatenate(list(rows), axis=1))
    problem = SequenceProblem(3 * np.eye(n), transition, noise_root, np.arange(0, 61, 3), rows, together, TRACE)
    watch = Ticking(time_limit=1.0)
    found = search(problem, monitor=watch)
    assert found.stopped and found.nodes < 200_000
    assert watch.ticks < 130  # once it has passed the search looks at the clock a few times more and ends
    assert 0 < found.lower_bound < found.cost < np.inf
    together_alone = problem.root.copy()
    least = advance(together_alone, transition, noise_root, together, TRACE)
    assert found.lower_bound >= least * (1 - 1e-12)

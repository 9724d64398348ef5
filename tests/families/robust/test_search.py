"""The search against full enumeration, and its bounds against sequences that break them if they could."""

import numpy as np
import pytest

from occontrol.core.monitor import Monitor
from occontrol.families.robust.bound import plane_of, relaxed_policy, split_recursion, value_of, walk
from occontrol.families.robust.ellipsoid_size import Size
from occontrol.families.robust.search import SearchOptions, contraction, search
from occontrol.families.robust.slots import one_step, slot_table
from occontrol.families.robust.tails import branch_on_tails
from tests.families.robust.random_tables import SIZES, compare_with_enumeration, every, random_problem


@pytest.mark.slow
def test_the_search_equals_full_enumeration_and_one_step_is_never_better():
    assert compare_with_enumeration(20) > 4  # choosing step by step is no oracle


def test_merging_and_dropping_keep_the_bound_below_the_optimum():
    """Tiny limits force both; the bound must stay a bound."""
    rng, merged, dropped = np.random.default_rng(3), 0, 0
    for _ in range(5):
        table, _, _ = random_problem(rng, 6, sensors=(3,))
        best = table.costs(every(table)).min()
        for options in (
            SearchOptions(0.1, 3, 10_000, tails=False),
            SearchOptions(0.01, 2, 4, tails=False),
            SearchOptions(0.1, 4, 6, 20, tails=False),
            SearchOptions(1e-3, 2, 4),
        ):
            found = search(table, options=options)
            assert found.lower_bound <= best * (1 + 1e-11)
            assert found.cost >= best * (1 - 1e-12)
            merged += found.merged
            dropped += found.dropped
    assert merged > 0
    assert dropped > 0


@pytest.mark.parametrize("terms", SIZES)
def test_planes_lie_below_every_completion(terms):
    """From random policies and nodes, at every edge; a plane that is tight somewhere, so that the test can fail."""
    rng = np.random.default_rng(11)
    table, _, _ = random_problem(rng, 6)
    table = slot_table(table.flow, table.edges, np.eye(table.flow.n) * 2, np.ones(table.flow.n), 1.0, Size.of(terms))
    assert table is not None
    policies = [rng.dirichlet(np.ones(table.sensors), table.count) for _ in range(4)] + [relaxed_policy(table)[0]]
    sequences = rng.integers(table.sensors, size=(40, table.count))
    costs, nodes = table.costs(sequences), [table.ordinary(s) for s in sequences]
    closest = np.inf
    for v in policies:
        for power in (np.inf, 16.0):
            plane = plane_of(table, v, walk(table, v, table.start, power=power))
            for cost, path in zip(costs, nodes, strict=True):
                for edge in range(table.count + 1):
                    bound = value_of(plane, edge, path[edge])
                    assert bound <= cost * (1 + 1e-10)
                    closest = min(closest, 1 - bound / cost)
    assert closest < 0.05


def test_every_better_sequence_ends_in_a_tail_that_is_left():
    """Against enumeration, with the optimum itself and a worse size as what is known."""
    rng, cut = np.random.default_rng(21), 0
    for _ in range(3):
        table, _, _ = random_problem(rng, 6, sensors=(3,))
        sequences = every(table)
        costs = table.costs(sequences)
        weights, plane, bound = relaxed_policy(table)
        for known in (costs.min() * 1.02, costs.min() * 1.0001):
            tails = branch_on_tails(table, weights, plane, bound, known, 0.0, Monitor())
            depth = len(tails[0].choices)
            left = {tail.choices for tail in tails}
            cut += 3**depth - len(left)
            for sequence, cost in zip(sequences, costs, strict=True):
                end = tuple(int(i) for i in sequence[len(sequence) - depth :])
                assert cost >= known * (1 - 1e-11) or end in left
            for tail in tails:
                ending = np.all(sequences[:, 6 - depth :] == np.array(tail.choices), axis=1)
                assert tail.bound <= costs[ending].min() * (1 + 1e-10)
    assert cut > 10


def test_the_gradient_of_a_relaxed_policy():
    table, _, _ = random_problem(np.random.default_rng(4), 4)
    v = np.random.default_rng(0).dirichlet(np.ones(table.sensors), table.count)
    path, step = walk(table, v, table.start), 1e-6
    for k, j in ((0, 0), (2, 1), (3, 0)):
        up, down = v.copy(), v.copy()
        up[k, j] += step
        down[k, j] -= step
        difference = (walk(table, up, table.start).value - walk(table, down, table.start).value) / (2 * step)
        assert path.gradient[k, j] == pytest.approx(difference, rel=1e-5, abs=1e-9)


def test_the_kernel_of_the_athans_family_sees_the_same_problem():
    """Its split recursion for N tends to the exact size, second order in the panels."""
    from occontrol.scheduling.sweep import Sweep

    rng = np.random.default_rng(9)
    table, _, _ = random_problem(rng, 4)
    table = slot_table(table.flow, table.edges, np.eye(table.flow.n) * 2, np.ones(table.flow.n), 1.0, Size.of("trace"))
    assert table is not None
    v = rng.dirichlet(np.ones(table.sensors), table.count)
    exact, errors = walk(table, v, table.start), []
    for panels in (40, 80):
        recursion, parts = split_recursion(table, table.level * np.eye(table.flow.n), panels)
        value, gradient = Sweep(recursion).cost_and_gradient(np.repeat(v, parts, axis=0))
        errors.append(abs(value - exact.value))
        summed = gradient.reshape(table.count, parts, -1).sum(axis=1)
    assert errors[1] < errors[0] / 3.5
    assert errors[1] < 1e-3 * exact.value
    assert summed == pytest.approx(exact.gradient, rel=2e-2, abs=1e-4)


def test_contraction_is_true_of_real_pairs():
    rng = np.random.default_rng(2)
    table, _, _ = random_problem(rng, 5)
    shrink = contraction(table)
    assert np.all(shrink <= 1)
    assert np.min(shrink) < 0.9999
    for _ in range(30):
        s = rng.integers(table.sensors, size=table.count)
        path, e = table.ordinary(s), rng.uniform(0.01, 0.5)
        N = path[1] * (1 + e)
        for slot in range(1, table.count):
            e *= shrink[slot, s[slot]]
            from occontrol.families.robust.scattering import advance

            N = advance(N, table.of(slot, int(s[slot])))
            assert np.linalg.eigvalsh((1 + e) * path[slot + 1] - N)[0] >= -1e-12 * np.max(N)


@pytest.mark.slow
@pytest.mark.parametrize("sensors", [3, 4])
def test_forty_slots_without_enumeration(sensors):
    table, weight, center = random_problem(np.random.default_rng(sensors), 40, (3,), (sensors,))
    monitor = Monitor()
    greedy = one_step(table, weight, center, 1.0)
    found = search(table, [greedy], SearchOptions(node_limit=20_000), monitor)
    gap = 1 - found.lower_bound / found.cost
    print(f"{sensors}^40 sequences, {found.nodes} nodes, widest layer {found.widest}, gap {100 * gap:.3g} %")
    assert found.nodes < 50_000
    assert gap <= 0.01
    assert found.cost <= table.cost(greedy)
    random = np.random.default_rng(1).integers(sensors, size=(2000, 40))
    assert np.min(table.costs(random)) >= found.lower_bound
    assert monitor.history


def test_a_time_limit_and_an_interruption_leave_a_bound():
    table, _, _ = random_problem(np.random.default_rng(8), 12, (3,), (3,))
    full = search(table)
    stopped = search(table, monitor=Monitor(time_limit=0.0))
    assert stopped.limit == "time_limit"
    assert stopped.lower_bound <= full.cost * (1 + 1e-11)
    assert stopped.cost >= full.lower_bound
    assert search(table, monitor=Monitor(interrupted=2)).limit == "interrupted"

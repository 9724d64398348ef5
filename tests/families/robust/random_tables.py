"""Random tables of the robust family, small enough to try every sequence, and the search against all of them.

`scripts/campaign_robust_search.py` does on hundreds what the tests do on a few.
"""

import itertools

import numpy as np

from occontrol.core.signal import as_signal
from occontrol.families.robust.ellipsoid_size import Size
from occontrol.families.robust.scattering import Flow
from occontrol.families.robust.search import search
from occontrol.families.robust.slots import one_step, slot_table

SIZES = ["trace", "volume", "longest-axis", {"volume": 1, "longest-axis": 10}, {"trace": 1, "volume": 2}]


def random_problem(rng, slots, states=(2, 3), sensors=(2, 3), coupling=0.3):
    """A random table that is uniformly robustly observable, with X0, x0, d."""
    while True:
        n, M = int(rng.choice(states)), int(rng.choice(sensors))
        A = rng.normal(size=(n, n))
        A -= (max(np.linalg.eigvals(A).real.max(), 0) + 0.1) * rng.uniform(0.5, 1.2) * np.eye(n)
        B, K = rng.normal(size=(n, int(rng.integers(1, n + 1)))), coupling * rng.normal(size=(1, n))
        C = [rng.normal(size=(1, n)) * rng.uniform(0.5, 3) for _ in range(M)]
        weight, center, end = np.diag(rng.uniform(0.3, 3, n)), rng.normal(size=n), rng.uniform(1, 3)
        flow = Flow(as_signal(A), as_signal(B), as_signal(K), [as_signal(c) for c in C])
        size = Size.of(SIZES[int(rng.integers(len(SIZES)))])
        table = slot_table(flow, np.linspace(0, end, slots + 1), weight, center, 1.0, size)
        if table is not None:
            return table, weight, center


def every(table):
    return np.array(list(itertools.product(range(table.sensors), repeat=table.count)))


def compare_with_enumeration(count, seed=7):
    """Compare the search with every sequence on `count` tables; how often choosing step by step was worse.

    AssertionError where the search misses the optimum, its bound is none, or a step-by-step choice beats the optimum.
    """
    rng, worse = np.random.default_rng(seed), 0
    for number in range(count):
        table, weight, center = random_problem(rng, int(rng.integers(3, 7)))
        costs = table.costs(every(table))
        found, best = search(table), costs.min()
        assert abs(found.cost - best) <= 1e-10 * best, number
        assert abs(table.cost(found.sequence) - found.cost) <= 1e-13 * found.cost, number
        assert found.cost * (1 - 2e-11) <= found.lower_bound <= best * (1 + 1e-12), number
        greedy = table.cost(one_step(table, weight, center, 1.0))
        assert greedy >= best * (1 - 1e-12), number
        worse += greedy > best * (1 + 1e-6)
    return worse

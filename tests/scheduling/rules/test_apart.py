"""The tree at several places at once finds what one place finds, and finds it again."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from occontrol.core.monitor import Monitor
from occontrol.core.spread import Spread
from occontrol.scheduling.rules.apart import Apart
from occontrol.scheduling.rules.tree import Search, Tree, TreeOptions
from tests.scheduling.rules.enumeration import optimum
from tests.scheduling.rules.small_problems import small, task_of


class Pickled(Spread):
    """Two places of this process that get copies, as processes do."""

    count = 2

    def hold(self, function, pieces):
        """See Spread.hold."""
        kept = [pickle.loads(pickle.dumps(piece)) for piece in pieces]
        return lambda *words: [pickle.loads(pickle.dumps(function(piece, *words))) for piece in kept]


def searched(seed: int, spread: Spread | None) -> tuple[Tree, Search]:
    p, alpha, goal = small(seed, 9)
    task = task_of(p, alpha, goal)
    start = np.full(task.oracle.shape, 1.0 / task.oracle.shape[1])
    monitor = Monitor() if spread is None else Monitor(spread=spread)
    search = Search(task, TreeOptions(gap=1e-7, most=50_000), monitor, [])
    return search.run(start, None, None if spread is None else Apart), search


@pytest.mark.parametrize("seed", [1028, 1072, 1085])
def test_two_places_end_where_one_ends_and_where_enumeration_ends(seed: int) -> None:
    best = optimum(*small(seed, 9))[0]
    alone, _ = searched(seed, None)
    both, search = searched(seed, Pickled())
    again, _ = searched(seed, Pickled())
    if not np.isfinite(best):
        assert both.best is None and both.lower_bound == np.inf
        return
    assert alone.best is not None and both.best is not None and again.best is not None
    assert both.best.value == pytest.approx(best, rel=1e-7) == alone.best.value
    assert best * (1 - 1e-6) - 1e-9 <= both.lower_bound <= best + 1e-9 * abs(best)
    assert (again.best.value, again.lower_bound, again.nodes) == (both.best.value, both.lower_bound, both.nodes)
    assert both.complete and search.bundle is not None and both.nodes > 4

"""Times that are the same, wherever they are counted from and in whatever unit."""

from __future__ import annotations

import numpy as np
import pytest

from occontrol.core.clock import elapsed, lengths, nearest_edge, tolerance


@pytest.mark.parametrize("origin", [0.0, 1.7e9, -3e5])
@pytest.mark.parametrize("unit", [1.0, 1e-9, 1e9])
def test_an_edge_is_found_and_a_time_beside_it_is_not(origin: float, unit: float) -> None:
    edges = (origin + np.arange(5.0)) * unit
    index, same = nearest_edge(np.array([(origin + 2) * unit, (origin + 2.4) * unit, (origin + 2.999) * unit]), edges)
    assert index.tolist() == [2, 2, 3] and same.tolist() == [True, False, False]


def test_the_spacing_beside_the_edge_counts_not_the_size_of_the_time() -> None:
    edges = np.array([0.0, 1e-9, 1e3])
    index, same = nearest_edge(np.array([1.3e-9, 1e-9 * (1 + 1e-10)]), edges)
    assert index.tolist() == [1, 1] and same.tolist() == [False, True]
    assert tolerance(1e-9, 1e-9) < 1e-17 and tolerance(4.0, 1.7e9) < 1e-5 * 4


def test_equal_spacing_is_meant_where_the_doubles_cannot_say_it() -> None:
    edges = 1.7e9 + np.linspace(0, 4, 401)
    assert np.ptp(np.diff(edges)) > 1e-7  # what the doubles say
    assert np.array_equal(elapsed(edges), np.linspace(0, 4, 401)) and np.ptp(lengths(edges)) == 0.0


def test_other_spacing_is_left_alone() -> None:
    edges = np.array([0.0, 1.0, 2.0 + 1e-9, 3.0])
    assert np.array_equal(elapsed(edges), edges) and np.array_equal(lengths(edges), np.diff(edges))

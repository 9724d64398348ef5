"""Placement of a movable sensor: known maxima, walls, constraints, many peaks, and what cannot be placed."""

from __future__ import annotations

import numpy as np
import pytest

from occontrol.core.errors import InfeasibleError
from occontrol.families.vlambda.placement import grid_of, place
from occontrol.families.vlambda.sensor import Region


def test_an_inner_maximum_and_a_wall():
    where, height = place(Region([[0.0, 1.0]]), 0, lambda p: 2 - (p[:, 0] - 0.377) ** 2)
    assert where == pytest.approx([0.377], abs=1e-6)
    assert height == pytest.approx(2.0, abs=1e-12)
    where, _ = place(Region([[0.0, 1.0]]), 0, lambda p: np.exp(p[:, 0]))
    assert where == pytest.approx([1.0], abs=1e-12)
    where, _ = place(Region([[0.4, 0.4]]), 0, lambda p: p[:, 0])
    assert where == pytest.approx([0.4])


def test_the_highest_of_many_peaks_beats_a_dense_grid():
    g = np.random.default_rng(0)
    dense = np.linspace(0, 1, 200_001)[:, None]
    for _ in range(20):
        a, b, c = g.uniform(0.2, 1, 3)
        f = lambda p, a=a, b=b, c=c: (a * np.sin(7 * p[:, 0]) + b * np.sin(23 * p[:, 0] + 1) + c * p[:, 0]) ** 2  # noqa: E731
        where, height = place(Region([[0.0, 1.0]]), 0, f)
        assert height >= np.max(f(dense)) * (1 - 1e-9)
        assert 0 <= where[0] <= 1


def test_two_coordinates_with_a_curved_constraint():
    """Largest x + y inside the unit circle: at (1, 1)/sqrt 2."""
    region = Region([[-1.0, 1.0], [-1.0, 1.0]], ["p1**2 + p2**2 - 1"])
    where, height = place(region, 0, lambda p: 5 + p[:, 0] + p[:, 1])
    assert where == pytest.approx(np.full(2, np.sqrt(0.5)), abs=1e-5)
    assert height == pytest.approx(5 + np.sqrt(2), abs=1e-8)
    assert np.sum(where**2) <= 1 + 1e-8


def test_a_constraint_that_moves_with_k():
    region = Region([[0.0, 10.0]], ["p1 - k"])
    for k in (1, 4, 7):
        where, _ = place(region, k, lambda p: p[:, 0])
        assert where == pytest.approx([k], abs=1e-6)


def test_a_small_allowed_spot_between_the_grid_points_is_found():
    region = Region([[0.0, 1.0], [0.0, 1.0]], ["(p1 - 0.61)**2 + (p2 - 0.33)**2 - 1e-5"])
    where, _ = place(region, 0, lambda p: p[:, 0])
    assert np.hypot(where[0] - 0.61, where[1] - 0.33) <= np.sqrt(1e-5) + 1e-4


def test_equal_peaks_go_to_the_first():
    where, _ = place(Region([[0.0, 1.0]]), 0, lambda p: np.sin(2 * np.pi * p[:, 0]) ** 2)
    assert where == pytest.approx([0.25], abs=1e-5)


def test_nowhere_to_be():
    with pytest.raises(InfeasibleError, match=r"at k = 3 no location of sensor 'eye' satisfies its constraints"):
        place(Region([[0.0, 1.0]], ["p1 + 1"]), 3, lambda p: p[:, 0], "eye")
    with pytest.raises(InfeasibleError, match="sensor 'eye' measures nothing finite anywhere"):
        place(Region([[0.0, 1.0]]), 3, lambda p: p[:, 0] * np.nan, "eye")


def test_the_grid_holds_the_corners_and_stays_small():
    points = grid_of(Region([[0.0, 1.0], [2.0, 4.0]]), 5)
    assert points.shape == (25, 2)
    assert {(0.0, 2.0), (1.0, 4.0)} <= {tuple(p) for p in points}
    assert len(grid_of(Region([[0.0, 1.0]] * 6), 50)) <= 4096


@pytest.mark.parametrize("width", [1e-8, 1e-10, 1e-12])
def test_a_set_between_the_points_of_the_grid_is_found_and_kept_to(width):
    """|p1 - 0.3141| <= sqrt(width): the best point of it for a growing merit is its upper end, and not beyond."""
    region = Region([[0.0, 1.0]], [f"(p1-0.3141)*(p1-0.3141)-{width!r}"])
    where, merit = place(region, 0, lambda p: p[:, 0])
    assert region.allowed(0, where[None])[0]
    assert where[0] == pytest.approx(0.3141 + np.sqrt(width), abs=0.02 * np.sqrt(width))
    assert merit == where[0]


def test_where_all_places_are_equal_the_lowest_corner_wins():
    for bounds in ([[0.0, 3.0]], [[-1.0, 1.0], [2.0, 5.0]]):
        region = Region(bounds)
        where, _ = place(region, 0, lambda p: np.cos(p[:, 0]) ** 2 + np.sin(p[:, 0]) ** 2)
        assert list(where) == [low for low, _ in bounds]

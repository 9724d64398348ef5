"""Schedules on grids: which edges are the same, what is carried over, and every refusal in the words that are read."""

from __future__ import annotations

import numpy as np
import pytest

from occontrol.core.errors import ProblemError
from occontrol.core.schedule import Schedule, constant_schedule, snap

NAMES = ("radar", "doppler", "idle")


def schedule(edges, choices, names=NAMES):
    return Schedule(np.array(edges), np.eye(len(names))[list(choices)], names)


def test_weights_follow_the_time_and_the_names():
    given = schedule([0.0, 1.0, 2.5, 4.0], [0, 2, 1])
    edges = np.array([0.0, 0.5, 1.0, 2.5, 3.0, 4.0])
    weights = given.on_grid(edges, ("idle", "doppler", "camera", "radar"), select=1)
    #                    idle doppler camera radar
    assert weights.tolist() == [[0, 0, 0, 1], [0, 0, 0, 1], [1, 0, 0, 0], [0, 1, 0, 0], [0, 1, 0, 0]]


def test_fractions_and_several_places_for_idle():
    given = Schedule(np.array([0.0, 1.0]), np.array([[0.25, 0.0, 1.75]]), NAMES)
    assert given.on_grid(np.array([0.0, 0.5, 1.0]), NAMES, select=2).tolist() == [[0.25, 0.0, 1.75]] * 2


def test_the_union_of_edges_keeps_those_of_the_grid_bit_for_bit():
    grid = np.array([0.0, 0.1, 0.2, 0.1 + 0.2, 0.4])
    given = schedule([0.0, 0.1 * (1 + 1e-15), 0.25, 0.3, 0.4], [0, 1, 0, 1])
    edges = given.common_edges(grid)
    assert edges.tolist() == [0.0, 0.1, 0.2, 0.25, 0.1 + 0.2, 0.4]
    assert np.argmax(given.on_grid(edges, NAMES), axis=1).tolist() == [0, 1, 1, 0, 1]


# a grid and how far a switch may lie from its edge there: seconds since 1970 at 100 Hz, and nanoseconds
CLOCKS = {
    "unix": (1.7e9 + 0.01 * np.arange(11), 4e-7, 2e-6),
    "nanoseconds": (1e-10 * np.arange(11), 0.5e-19, 2e-19),
    "around zero": (np.linspace(-1.0, 1.0, 11), 1e-10, 1e-9),
    "beside a long interval": (np.array([0.0, 1e-6, 1e6]), 0.5e-15, 1e-14),
}


@pytest.mark.parametrize("clock", CLOCKS)
def test_tolerances_are_relative_to_the_interval_and_to_the_ulps_of_the_time(clock):
    edges, near, far = CLOCKS[clock]
    at = edges[1]
    assert snap(np.array([at + near, at - near]), edges).tolist() == [at, at]
    apart = snap(np.array([at + far, at - far]), edges)
    assert np.all(apart != at)
    given = schedule([edges[0], at + near, edges[-1]], [0, 1])
    assert np.array_equal(given.common_edges(edges), edges)
    assert np.argmax(given.on_grid(edges, NAMES), axis=1).tolist() == [0] + [1] * (len(edges) - 2)
    given = schedule([edges[0], at + far, edges[-1]], [0, 1])
    finer = given.common_edges(edges)
    assert len(finer) == len(edges) + 1
    assert np.argmax(given.on_grid(finer, NAMES), axis=1).tolist() == [0, 0] + [1] * (len(edges) - 2)
    with pytest.raises(ProblemError, match=r"the schedule switches at t = .*, inside the interval \["):
        given.on_grid(edges, NAMES)


def test_a_switch_half_a_nanosecond_from_an_edge_is_not_at_the_edge():
    """An absolute tolerance of 1e-9 would move every switch of this horizon onto its first edge."""
    edges = np.array([0.0, 1e-9, 2e-9])
    given = schedule([0.0, 0.5e-9, 2e-9], [0, 1])
    assert given.common_edges(edges).tolist() == [0.0, 0.5e-9, 1e-9, 2e-9]


def test_an_edge_without_a_switch_may_lie_anywhere():
    given = schedule([0.0, 0.3, 1.0], [1, 1])
    assert given.on_grid(np.array([0.0, 0.5, 1.0]), NAMES).tolist() == [[0, 1, 0]] * 2


@pytest.mark.parametrize(
    ("span", "words"),
    [
        ((1.0, 4.0), "nothing is scheduled between t = 0 and 1"),
        ((0.0, 3.0), "nothing is scheduled between t = 3 and 4"),
        ((-1.0, 4.0), "the schedule starts at -1, the horizon at 0"),
        ((0.0, 4.5), "the schedule ends at 4.5, the horizon at 4"),
        ((1.0, 3.0), "nothing is scheduled between t = 0 and 1"),
    ],
)
def test_a_schedule_is_not_stretched_over_another_horizon(span, words):
    given, edges = constant_schedule(np.array(span), NAMES, [1, 0, 0]), np.linspace(0, 4, 9)
    for call in (lambda: given.on_grid(edges, NAMES), lambda: given.common_edges(edges)):
        with pytest.raises(ProblemError) as error:
            call()
        assert str(error.value) == f"{words}\n  hint: the schedule must cover the horizon [0, 4]"


def test_sensors_that_are_not_known():
    edges = np.array([0.0, 1.0])
    given = schedule([0.0, 1.0], [0], ("radr", "doppler"))
    with pytest.raises(ProblemError, match=r"there is no sensor 'radr'\n  hint: did you mean 'radar'\?"):
        given.on_grid(edges, NAMES)
    unused = schedule([0.0, 1.0], [1], ("radr", "doppler"))
    assert unused.on_grid(edges, NAMES).tolist() == [[0, 1, 0]]


@pytest.mark.parametrize(
    ("weights", "select", "words"),
    [
        ([1.2, 0.0, 0.0], None, r"the weight of sensor 'radar' is 1.2 at t = 0, it must lie between 0 and 1"),
        ([0.5, 0.0, 0.0], 1, r"the weights add up to 0.5 at t = 0, but select is 1"),
        ([1.0, 1.0, 0.0], 1, r"the weights add up to 2 at t = 0, but select is 1"),
        ([1.0, 0.0, 0.0], 2, r"the weights add up to 1 at t = 0, but select is 2"),
    ],
)
def test_weights_out_of_range(weights, select, words):
    given = constant_schedule(np.array([0.0, 4.0]), NAMES, weights)
    with pytest.raises(ProblemError, match=words):
        given.on_grid(np.array([0.0, 4.0]), NAMES, select)


def test_rounding_of_weights_is_no_mistake():
    given = constant_schedule(np.array([0.0, 4.0]), NAMES, [1 + 5e-7, -5e-7, 0.0])
    assert given.on_grid(np.array([0.0, 4.0]), NAMES, 1)[0, 0] == 1 + 5e-7


def test_a_segment_far_shorter_than_the_grid_tells_apart_does_not_vanish() -> None:
    grid = np.array([0.0, 1.0, 2.0])
    schedule = Schedule(np.array([0.0, 9.5e-11, 1.0, 2.0]), np.array([[1.0, 0], [0, 1], [1, 0]]), ("a", "b"))
    edges = schedule.common_edges(grid)
    assert edges.tolist() == [0.0, 9.5e-11, 1.0, 2.0]
    assert schedule.on_grid(edges, ("a", "b")).tolist() == schedule.weights.tolist()
    # an edge that no other time claims is still met
    assert snap(np.array([0.0, 9.5e-11, 1.0 + 1e-10]), grid).tolist() == [0.0, 9.5e-11, 1.0]

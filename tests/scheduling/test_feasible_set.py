"""The set of schedules as one object: what it lets in, what it refuses and in what words, and its bounds."""

import itertools

import numpy as np
import pytest

from occontrol.scheduling.feasible_set import FeasibleSet, IntervalPolytopes

NAMES = ("radar", "camera", "sonar")
EDGES = np.array([0.0, 1.0, 2.0, 4.0, 5.0])


def windowed(select=1):
    """Four intervals, three sensors; the camera is out of its window on the first two."""
    upper = np.ones((4, 3))
    upper[:2, 1] = 0.0
    return IntervalPolytopes(upper, select, EDGES, NAMES)


def only(*choices):
    return np.eye(3)[list(choices)]


@pytest.mark.parametrize(("weights", "words"), [
    (np.ones((4, 1)) * [1, 0, 1], "schedule[0]: on interval 1, between t = 0 and 1, the weights add up to 2, not to 1, "
     "and on 3 other intervals\n  hint: 1 sensor at a time: the weights of an interval add up to 1"),
    (only(0, 0, 0, 2) * 0.5, "the weights add up to 0.5, not to 1"),
    (np.ones((4, 1)) * [5, 0, -4], "on interval 1, between t = 0 and 1, sensor 'radar' has weight 5, and on 3 other"),
    (np.ones((4, 1)) * [5, 0, -4],
     "sensor 'sonar' has weight -4, and on 3 other intervals\n  hint: a weight is not negative"),
    (only(0, 1, 1, 1), "schedule[1]: on interval 2, between t = 1 and 2, sensor 'camera' has weight 1, but is not "
     "available\n  hint: use it inside its windows only"),
    (np.where(only(0, 0, 2, 2) > 0, np.nan, 0.0), "sensor 'radar' has weight nan"),
    (np.ones((3, 3)) / 3, "schedule: the weights are 3 x 3, there are 4 intervals and 3 sensors"),
])  # fmt: skip
def test_what_is_wrong_is_said_with_sensor_and_interval(weights, words):
    allowed = windowed()
    text = "\n".join(str(m) for m in allowed.check(weights))
    assert words in text
    assert weights.shape != allowed.shape or not allowed.contains(weights)


def test_five_times_two_sensors_is_five_mistakes_too_many_on_both():
    found = IntervalPolytopes(np.ones((2, 2)), 1).check(np.full((2, 2), 5.0))
    assert [m.what for m in found] == [
        "on interval 1 sensor '1' has weight 5, and on 1 other interval",
        "on interval 1 sensor '2' has weight 5, and on 1 other interval",
        "on interval 1 the weights add up to 10, not to 1, and on 1 other interval",
    ]
    assert found[0].hint == "at most 1" and found[0].path == ("schedule", 0)


def test_two_sensors_where_one_is_asked_for_and_one_where_two_are():
    both, one = np.array([[1.0, 1.0]]), np.array([[1.0, 0.0]])
    single, pair = (IntervalPolytopes(np.ones((1, 2)), select) for select in (1, 2))
    assert single.contains(one) and pair.contains(both)
    assert not single.contains(both) and not pair.contains(one)
    assert "add up to 2, not to 1" in single.check(both)[0].what
    assert "add up to 1, not to 2" in pair.check(one)[0].what


def test_idle_may_fill_all_places():
    allowed = IntervalPolytopes(np.array([[1.0, 1.0, 2.0]]), 2, names=("a", "b", "idle"))
    assert allowed.contains(np.array([[0.0, 0.0, 2.0]]))
    assert "weight 3" in allowed.check(np.array([[0.0, -1.0, 3.0]]))[1].what


def test_what_belongs_to_the_set_is_let_in():
    allowed = windowed()
    rng = np.random.default_rng(0)
    drawn = rng.normal(size=allowed.shape)
    for v in (allowed.uniform(), allowed.vertex(drawn), allowed.project(drawn), allowed.round(allowed.uniform())):
        assert allowed.check(v) == [] and allowed.contains(v)
        assert allowed.check(v + 1e-8) == []  # what a file rounds off
        assert not allowed.contains(v + 1e-3)


def schedules(allowed):
    for choice in itertools.product(range(3), repeat=4):
        if allowed.contains(only(*choice)):
            yield only(*choice)


def test_the_vertex_is_the_cheapest_schedule_and_the_bound_holds():
    allowed, rng = windowed(), np.random.default_rng(3)
    for _ in range(5):
        g, v = rng.normal(size=allowed.shape), allowed.project(rng.normal(size=allowed.shape))
        least = min(float(np.vdot(g, w)) for w in schedules(allowed))
        assert np.vdot(g, allowed.vertex(g)) == pytest.approx(least, abs=1e-12)
        # of a linear cost every policy proves the optimum
        assert allowed.bound(float(np.vdot(g, v)), v, g) == pytest.approx(least, abs=1e-12)
        assert np.all(allowed.excess(v, g) >= -1e-12)


def test_the_compiled_mixture_is_the_plain_one():
    allowed, rng = windowed(), np.random.default_rng(4)
    constants, gradients = rng.normal(size=6), rng.normal(size=(6, *allowed.shape))
    for rounds in (1, 2, 7, 200):
        fast = allowed.mixture(constants, gradients, 2, rounds)
        plain = FeasibleSet.mixture(allowed, constants, gradients, 2, rounds)
        assert fast == pytest.approx(plain, rel=1e-9)
    single = max(a + np.vdot(g, allowed.vertex(g)) for a, g in zip(constants, gradients, strict=True))
    assert fast >= single - 1e-9
    lowest = min(max(a + np.vdot(g, w) for a, g in zip(constants, gradients, strict=True)) for w in schedules(allowed))
    assert fast <= lowest + 1e-9
    assert allowed.mixture(constants, gradients, 2, 200, wanted=-np.inf) == allowed.mixture(constants, gradients, 2, 1)


def test_rounding_follows_the_lengths_of_the_intervals():
    allowed = IntervalPolytopes(np.ones((4, 2)), 1, EDGES)
    half = np.full((4, 2), 0.5)
    for backward in (False, True):
        w = allowed.round(half, backward)
        assert allowed.contains(w) and np.array_equal(w, np.round(w))
        used = np.cumsum(np.diff(EDGES)[:, None] * (w - half), axis=0)
        assert np.max(np.abs(used)) <= np.max(np.diff(EDGES))
    # 1, 1, 2, 1 long, ties to the first sensor
    assert np.flatnonzero(allowed.round(half)[:, 0]).tolist() == [0, 2]
    assert np.flatnonzero(allowed.round(half, backward=True)[:, 0]).tolist() == [0, 1, 3]


def test_exchanges_and_swaps_stay_in_the_set():
    allowed = windowed()
    for w in schedules(allowed):
        leaves, enters = allowed.exchange_masks(w)
        swaps = allowed.swap_mask(w)
        for k, j, e in itertools.product(range(4), range(3), range(3)):
            trial = w.copy()
            trial[k, j] -= 1.0
            trial[k, e] += 1.0
            if j != e:
                assert (leaves[k, j] and enters[k, e]) == allowed.contains(trial)
        for k in range(3):
            trial = w.copy()
            trial[[k, k + 1]] = trial[[k + 1, k]]
            assert swaps[k] == allowed.contains(trial)


def test_a_part_is_the_set_of_its_intervals():
    allowed = windowed()
    part = allowed.part(1, 3)
    assert part.shape == (2, 3) and part.places == 1
    assert part.contains(only(0, 1)) and not part.contains(only(1, 0))
    assert "between t = 1 and 2, sensor 'camera'" in part.check(only(1, 0))[0].what


def test_the_face_of_a_policy_lists_its_free_weights_by_interval():
    allowed = windowed()
    v = np.array([[0.5, 0.0, 0.5], [1.0, 0.0, 0.0], [0.2, 0.3, 0.5], [1e-8, 0.4, 0.6 - 1e-8]])
    g = np.zeros((4, 3))
    g[3, 0] = 1.0
    face = allowed.face(v, g, 1e-6)
    assert face.listed.tolist() == [0, 2, 6, 7, 8, 10, 11] and face.ends.tolist() == [2, 5, 7]
    assert face.move[3].tolist() == [-1e-8, 0.0, 1e-8]  # the sliver goes to its bound at once
    assert not np.any(face.move[:3])

"""All intervals at once have the availability that each has alone, wherever windows begin and end."""

import itertools

import numpy as np
import pytest

from occontrol.core.sensor import Sensor


@pytest.mark.parametrize("origin", [0.0, 1.7e9])
@pytest.mark.parametrize("seed", range(10))
def test_intervals_at_once_are_as_available_as_one_by_one(seed, origin):
    rng = np.random.default_rng(seed)
    edges = origin + np.sort(np.concatenate([[0.0, 10.0], rng.uniform(0, 10, 30)]))
    inner = np.sort(rng.choice(edges, 8, replace=False))
    ends = inner + rng.choice([0.0, 1e-12, 1e-6, 0.1], 8) * rng.choice([-1, 1], 8)
    windows = [(a, b) for a, b in itertools.pairwise(ends) if a < b and rng.random() < 0.7]
    sensor = Sensor("s", [[1.0]], [[1.0]], windows=windows or [(origin, origin + 10.0)])
    alone = [sensor.available(a, b) for a, b in itertools.pairwise(edges)]
    assert np.array_equal(sensor.available_between(edges), alone)
    assert any(alone) or not windows or all(b - a < 1 for a, b in windows)


def test_windows_that_touch_count_as_one_for_all_intervals():
    sensor = Sensor("s", [[1.0]], [[1.0]], windows=[(0.0, 1.5), (1.5, 3.0), (3.5, 4.0)])
    assert sensor.available_between(np.array([0.0, 1.0, 2.0, 3.0, 4.0])).tolist() == [True, True, True, False]

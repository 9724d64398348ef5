"""Samples at nearly the times of a schedule: moved within the stated tolerance, refused beyond it."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from occontrol.core.errors import ProblemError, UsageError
from occontrol.core.irregular import expected_times, moved
from occontrol.core.measurement import Measurement

TIMES = np.array([0.5, 1.0, 1.5, 3.0])


def samples(*times: float, sensor: str = "a") -> list[Measurement]:
    return [Measurement(t, sensor, np.array([float(i)]), i + 2) for i, t in enumerate(times)]


def test_each_goes_to_the_nearest_time_and_keeps_its_values() -> None:
    given = samples(0.58, 0.93, 1.5, 2.92)
    result, said = moved(given, TIMES, 0.1)
    assert [m.time for m in result] == list(TIMES) and [m.values[0] for m in result] == [0, 1, 2, 3]
    assert said == "3 samples moved to the times of the schedule, by at most 0.08"
    assert moved(samples(*TIMES), TIMES, 0.1)[1] == ""
    assert moved(samples(1.1), TIMES[1:2], 0.2)[0][0].time == 1.0


@pytest.mark.parametrize(
    ("times", "what"),
    [
        ((0.58, 2.8), "line 3: the sample of sensor 'a' at t = 2.8 is 0.2 from the nearest time"),
        ((0.45, 0.52), "line 3: two samples of sensor 'a' belong to t = 0.5\n  hint: the other is at t = 0.45"),
        ((9.0, 8.0, 7.0), "is 6 from the nearest time, and 2 more lines like it\n  hint: the tolerance is 0.1"),
    ],
)
def test_what_is_too_far_or_twice_is_refused(times: tuple[float, ...], what: str) -> None:
    with pytest.raises(ProblemError) as caught:
        moved(samples(*times), TIMES, 0.1)
    assert what in str(caught.value)


def test_a_tolerance_is_a_time() -> None:
    with pytest.raises(UsageError, match="the tolerance is -1"):
        moved([], TIMES, -1.0)
    with pytest.raises(UsageError, match="whole steps"):
        expected_times(SimpleNamespace())
    assert np.array_equal(expected_times(SimpleNamespace(edges=np.arange(3.0))), [1, 2])

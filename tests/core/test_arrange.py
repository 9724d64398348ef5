"""Measurements onto intervals: where each belongs, and the words in which the others are refused."""

import numpy as np
import pytest

from occontrol.core.arrange import arrange
from occontrol.core.errors import ProblemError
from occontrol.core.measurement import Measurement

EDGES = np.array([0.0, 1.0, 2.0, 4.0])
NAMES, ROWS, IN_USE = ("a", "b", "idle"), (1, 2, 0), ((0,), (0, 1), ())


def samples(*given):
    return arrange(EDGES, NAMES, ROWS, IN_USE, [Measurement(t, name, np.array(z)) for t, name, z in given])


def test_each_sample_ends_its_interval_whatever_the_order():
    got = samples((2.0, "b", [1.0, np.nan]), (1.0, "a", [3.0]), (2.0, "a", [4.0]))
    assert [sorted(k) for k in got] == [["a"], ["a", "b"], []]
    assert got[0]["a"] == [3.0] and got[1]["a"] == [4.0]
    assert got[1]["b"][0] == 1.0 and np.isnan(got[1]["b"][1])


def test_times_may_be_rounded_by_a_hundredth_of_the_interval():
    assert "a" in samples((1.0 + 0.009, "a", [1.0]))[0]
    assert "a" in samples((1.0 - 0.009, "a", [1.0]))[0]
    with pytest.raises(ProblemError, match="not at the end of an interval"):
        samples((1.0 + 0.011, "a", [1.0]))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ((5.0, "a", [1.0]), "the sample of sensor 'a' at t = 5 lies outside the horizon [0, 4]"),
        ((0.0, "a", [1.0]), "the sample of sensor 'a' at t = 0 lies outside the horizon [0, 4]"),
        ((1.4, "a", [1.0]), "the sample of sensor 'a' at t = 1.4 is not at the end of an interval\n"
                            "  hint: the nearest ends are 1 and 2"),
        ((np.nan, "a", [1.0]), "the sample of sensor 'a' has no finite time"),
        ((1.0, "c", [1.0]), "there is no sensor 'c'\n  hint: sensors: a, b, idle"),
        ((1.0, "b", [1.0, 2.0]), "sensor 'b' is not in use over [0, 1]\n  hint: in use: a"),
        ((4.0, "a", [1.0]), "sensor 'a' is not in use over [2, 4]\n  hint: in use: no sensor"),
        ((2.0, "b", [1.0]), "the sample of sensor 'b' has 1 values, its C has 2 rows"),
        ((1.0, "a", [np.inf]), "the sample of sensor 'a' is infinite"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused_in_these_words(given, words):
    with pytest.raises(ProblemError) as error:
        samples(given)
    assert str(error.value).startswith(words)


def test_all_mistakes_are_named_together_with_their_lines():
    twice = [Measurement(1.0, "a", np.array([1.0]), 2), Measurement(1.0, "a", np.array([2.0]), 3)]
    with pytest.raises(ProblemError) as error:
        arrange(EDGES, NAMES, ROWS, IN_USE, [*twice, Measurement(9.0, "a", np.array([1.0]), 4)])
    assert "line 3: sensor 'a' has a second sample at t = 1" in str(error.value)
    assert "line 4: the sample of sensor 'a' at t = 9 lies outside" in str(error.value)

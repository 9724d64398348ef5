"""Measurements onto intervals and steps: where each belongs, and the words in which the others are refused."""

import numpy as np
import pytest

from occontrol.core.arrange import STEP_SLACK, arrange, step_times
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
        ((1.0, "c", [1.0]), "there is no sensor 'c'\n  hint: there are: a, b, idle"),
        ((1.0, "b", [1.0, 2.0]), "sensor 'b' is not in use over [0, 1]\n  hint: in use: a"),
        ((4.0, "a", [1.0]), "sensor 'a' is not in use over [2, 4]\n  hint: in use: no sensor"),
        ((2.0, "b", [1.0]), "the sample of sensor 'b' has 1 value, it must have 2"),
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


def test_the_same_mistake_on_many_lines_is_named_once():
    late = [Measurement(9.0 + k, "a", np.array([1.0]), k + 2) for k in range(126)]
    other = Measurement(1.0, "a", np.array([np.inf]), 300)
    with pytest.raises(ProblemError) as error:
        arrange(EDGES, NAMES, ROWS, IN_USE, [*late, other])
    first, second = error.value.mistakes
    assert first.place == "line 2"
    assert first.what == (
        "the sample of sensor 'a' at t = 9 lies outside the horizon [0, 4], and 125 more lines like it"
    )
    assert (second.place, second.what) == ("line 300", "the sample of sensor 'a' is infinite")
    with pytest.raises(ProblemError, match="and 1 more line like it"):
        arrange(EDGES, NAMES, ROWS, IN_USE, late[:2])


STEPS = step_times(1, 3)


def at_steps(*given, in_use=None):
    measurements = [Measurement(t, name, np.array(z), 7) for t, name, z in given]
    return arrange(STEPS, NAMES, ROWS, in_use, measurements, slack=STEP_SLACK, instants=True)


def test_at_steps_a_sample_belongs_to_its_own_time():
    got = at_steps((3.0, "b", [1.0, np.nan]), (1.0, "a", [3.0]), (3.0, "a", [4.0]))
    assert [list(k) for k in got] == [["a"], [], ["b", "a"]]  # in the order of the lines
    assert got[2]["a"] == [4.0]


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ((0.0, "a", [1.0]), "t = 0 lies outside the horizon [1, 3]\n  hint: t is 1, 2, .. 3"),
        ((4.0, "a", [1.0]), "t = 4 lies outside the horizon [1, 3]\n  hint: t is 1, 2, .. 3"),
        ((1.5, "a", [1.0]), "t = 1.5 is not at a step\n  hint: the nearest steps are 1 and 2"),
        ((2.000001, "a", [1.0]), "t = 2.000001 is not at a step"),
        ((2.0, "b", [1.0]), "sensor 'b' is not in use at t = 2\n  hint: in use: a"),
        ((3.0, "b", [1.0]), "sensor 'b' is not in use at t = 3\n  hint: in use: no sensor"),
        ((-np.inf, "a", [1.0]), "has no finite time"),
    ],
)
def test_what_is_at_no_step_is_refused(given, words):
    with pytest.raises(ProblemError) as error:
        at_steps(given, in_use=[(0, 1), (0,), ()])
    assert str(error.value).startswith("line 7: ") and words in str(error.value)


def test_times_of_a_clock_since_1970_are_told_apart():
    """Steps of a millisecond at 1.7e9: one ulp is 2.4e-7, a hundredth of the step 1e-5."""
    edges = 1.7e9 + 1e-3 * np.arange(6)
    given = [Measurement(float(t), "a", np.array([float(k)])) for k, t in enumerate(edges[1:])]
    got = arrange(edges, ("a",), (1,), None, given)
    assert [sample["a"][0] for sample in got] == [0, 1, 2, 3, 4]
    with pytest.raises(ProblemError, match="not at the end of an interval"):
        arrange(edges, ("a",), (1,), None, [Measurement(float(edges[2]) + 1e-4, "a", np.array([1.0]))])


def test_a_long_list_of_sensors_in_use_is_cut():
    names = tuple("abcdefghijkl")
    with pytest.raises(ProblemError, match="in use: a, b, c, d, e, f, g, h and 3 more"):
        arrange(STEPS, names, (1,) * 12, [tuple(range(11))] * 3, [Measurement(2.0, "l", np.ones(1))], instants=True)

"""Refusals of robust problem files: the words and the place; and what is accepted."""

import numpy as np
import pytest

from occontrol.api import read_problem
from occontrol.core.errors import ProblemError
from occontrol.families.robust.family import FAMILY

BASE = """\
family: robust
horizon: {end: 2.0, slots: 4}
plant:
  A: [[0, 1], [-1, -0.4]]
  B: [[0], [1]]
  K: [[0.5, 0.2]]
  initial: {center: [1, -0.5], weight: {diag: [2, 1]}, level: 1.0}
sensors:
  - {name: one, C: [[1, 0]]}
  - {name: two, C: [[0, 1]]}
size: trace
"""


def read(tmp_path, old="", new="", extra=""):
    assert old in BASE
    path = tmp_path / "x.yaml"
    path.write_text(BASE.replace(old, new, 1) + extra if old else BASE + extra, encoding="utf-8")
    return read_problem(path)


REFUSALS = [
    ("B: [[0], [1]]", "B: [[0], [1], [2]]", "", "x.yaml:5:6: B is 3x1, it must have 2 rows"),
    ("K: [[0.5, 0.2]]", "K: [[0.5]]", "", "x.yaml:6:6: K is 1x1, it must have 2 columns"),
    ("A: [[0, 1], [-1, -0.4]]", "A: [[0, 1]]", "", "x.yaml:4:6: A is 1x2, it must be"),
    ("{diag: [2, 1]}", "{diag: [2, -1]}", "", "weight is not positive definite"),
    ("{diag: [2, 1]}", "[[2, 1], [0, 1]]", "", "weight is not symmetric"),
    ("{diag: [2, 1]}", "{diag: [2, 0]}", "", "weight is not positive definite"),
    ("level: 1.0", "level: 0", "", "level is 0"),
    ("level: 1.0", "level: -2", "", "level > 0"),
    ("center: [1, -0.5]", "center: [1]", "", "center has 1 entry, the plant has 2 states"),
    ("C: [[1, 0]]", "C: [[1, 0, 0]]", "", "x.yaml:9:20: C of sensor 'one' is 1x3, but the plant has 2 states"),
    ("name: two", "name: one", "", "the name 'one' is used twice"),
    ("name: two", "name: idle", "", "'idle' is kept"),
    ("size: trace", "size: trase", "", "x.yaml:11:7: unknown size 'trase'"),
    ("size: trace", "size: {volume: 1, long: 2}", "", "unknown size 'long'"),
    ("size: trace", "size: {volume: -1}", "", "the weight of volume is -1"),
    ("size: trace", "size: {volume: 0}", "", "every weight of the size is zero"),
    ("size: trace", "size: [trace]", "", "size is neither a name nor a sum"),
    ("slots: 4", "slots: 0", "", "horizon.slots is 0"),
    ("slots: 4", "slots: 2.5", "", "whole number"),
    (", slots: 4", "", "", "neither 'slots' nor 'switch_times'"),
    ("end: 2.0, ", "", "", "horizon has no 'end'"),
    ("end: 2.0", "end: -1", "", "not after its start"),
    ("slots: 4", "switch_times: [0, 1, 0.5]", "", "must increase: 0.5 comes after 1"),
    ("slots: 4", "switch_times: [0, 1, 3]", "", "the switching time 3 lies outside the horizon [0, 2]"),
    ("slots: 4", "slots: 4, switch_times: [1]", "", "both 'switch_times' and 'slots'"),
    ("slots: 4", "slots: 4, samples: 0", "", "horizon.samples is 0"),
    ("slots: 4", "slot: 4", "", "unknown key 'slot'"),
    ("-0.4]]", "'log(t-1)']]", "", "A is not finite"),
    ("C: [[1, 0]]", "C: [['1/(t-0.5)', 0]]", "", "C of sensor 'one' is not finite at t = 0.5"),
    (
        "C: [[1, 0]]",
        "C: {times: [0, 1], values: [[[1, 0]], [[2, 0]]]}",
        "",
        "the table covers [0, 1], the horizon is [0, 2]",
    ),
    ("", "", "method: fixed\n", "needs a sequence of 4 sensors"),
    ("", "", "method: {name: fixed, sequence: [one, two]}\n", "the sequence has 2 entries, there are 4 slots"),
    ("", "", "method: {name: fixed, sequence: [one, two, three, 1]}\n", "x.yaml:12:44: there is no sensor 'three'"),
    ("", "", "method: {name: fixed, sequence: [1, 2, 3, 1]}\n", "sensor number 3 does not exist"),
    ("", "", "method: {name: optimall}\n", "unknown method 'optimall'"),
    (
        "",
        "",
        "method: {name: optimal, width: 0}\n",
        "x.yaml:12:32: width of method optimal is 0\n  hint: a whole number of at least 1",
    ),
    ("", "", "method: {name: optimal, depth: 3}\n", "unknown option 'depth' of method 'optimal'"),
]


@pytest.mark.parametrize(("old", "new", "extra", "words"), REFUSALS)
def test_a_bad_file_is_refused_with_place_and_words(old, new, extra, words, tmp_path):
    with pytest.raises(ProblemError) as caught:
        read(tmp_path, old, new, extra)
    assert words in str(caught.value)
    assert "x.yaml:" in str(caught.value)


def test_several_mistakes_are_reported_together(tmp_path):
    with pytest.raises(ProblemError) as caught:
        read(tmp_path, "K: [[0.5, 0.2]]", "K: [[0.5]]", "method: {name: nope}\nextra: 1\n")
    text = str(caught.value)
    assert "K is 1x1" in text
    assert "unknown method 'nope'" in text
    assert "unknown key 'extra'" in text


@pytest.mark.parametrize(
    "horizon",
    [
        "{switch_times: [0, 0.5, 1, 1.5, 2]}",
        "{end: 2, switch_times: [0.5, 1, 1.5]}",
        "{switch_times: [0.5, 1, 1.5, 2]}",
    ],
)
def test_switch_times_may_leave_start_and_end_out(horizon, tmp_path):
    problem = read(tmp_path, "{end: 2.0, slots: 4}", horizon)
    assert np.array_equal(problem.edges, [0, 0.5, 1, 1.5, 2])
    same = FAMILY.solve(read(tmp_path)).result["cost"]
    assert FAMILY.solve(problem).result["cost"] == pytest.approx(same, rel=1e-12)


def test_constants_formulas_and_tables_are_the_same_plant(tmp_path):
    cost = FAMILY.solve(read(tmp_path)).result["cost"]
    for old, new in (
        ("A: [[0, 1], [-1, -0.4]]", "A: [['0*t', 1], [-1, -0.4]]"),
        ("K: [[0.5, 0.2]]", "K: {times: [0, 1, 2], values: [[[0.5, 0.2]], [[0.5, 0.2]], [[0.5, 0.2]]]}"),
        ("C: [[1, 0]]", "C: [['1+0*t', 0]]"),
    ):
        assert FAMILY.solve(read(tmp_path, old, new)).result["cost"] == pytest.approx(cost, rel=1e-11)


def test_a_start_other_than_zero_shifts_time(tmp_path):
    shifted = read(tmp_path, "{end: 2.0, slots: 4}", "{start: 5, end: 7, slots: 4}")
    found, plain = FAMILY.solve(shifted), FAMILY.solve(read(tmp_path))
    assert found.result["cost"] == pytest.approx(plain.result["cost"], rel=1e-11)
    reach = plain.result["observability_horizon"]
    assert found.result["observability_horizon"] == pytest.approx(5 + reach, rel=1e-11)

"""Anchors, aliases and merges in problem files: what they build, and the limits that hold on what is expanded."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

import occontrol as oc
from occontrol.api import document
from occontrol.core.errors import ProblemError
from occontrol.files.anchors import MOST_COPIED
from occontrol.files.yaml_text import read_yaml

PLAIN = """
family: athans
horizon: {end: 3, intervals: 12}
plant: {A: [[0, 1], [0, -0.4]], noise: {diag: [0, 0.5]}, initial: {covariance: {diag: [0, 0.5]}}}
sensors:
  - {name: a, C: [[1, 0]], noise: [[0.1]], cost: 2, windows: [[0, 1], [2, 3]]}
  - {name: b, C: [[1, 0]], noise: [[0.1]], cost: 3, windows: [[0, 1], [2, 3]]}
objective: {output: [[1, 0]]}
"""
SHORT = """
family: athans
horizon: {end: 3, intervals: 12}
plant: {A: [[0, 1], [0, -0.4]], noise: &q {diag: [0, 0.5]}, initial: {covariance: *q}}
sensors:
  - &radar {name: a, C: &row [[1, 0]], noise: [[0.1]], cost: 2, windows: [[0, 1], [2, 3]]}
  - {<<: *radar, name: b, cost: 3}
objective: {output: *row}
"""


def test_a_file_with_anchors_is_the_file_written_out(tmp_path: Path) -> None:
    for name, text in (("plain", PLAIN), ("short", SHORT)):
        (tmp_path / f"{name}.yaml").write_text(text)
    plain, short = (oc.read_problem(tmp_path / f"{name}.yaml") for name in ("plain", "short"))
    assert {**document(plain), "name": ""} == {**document(short), "name": ""}


def test_an_alias_is_a_copy() -> None:
    data = read_yaml("a: &x {b: [1, 2]}\nc: *x\nd: [*x, *x]\n", "f").data
    assert data == {"a": {"b": [1, 2]}, "c": {"b": [1, 2]}, "d": [{"b": [1, 2]}] * 2}
    data["c"]["b"].append(3)
    assert data["a"] == {"b": [1, 2]} and data["d"][0] == data["d"][1] == {"b": [1, 2]}


def test_own_keys_win_then_the_first_of_a_list() -> None:
    data = read_yaml("a: &x {p: 1, q: 2}\nb: &y {q: 3, r: 4}\nc: {r: 9, <<: [*x, *y]}\n", "f").data
    assert data["c"] == {"p": 1, "q": 2, "r": 9}


def test_a_mistake_in_what_was_brought_in_is_named_where_it_is_written(tmp_path: Path) -> None:
    (tmp_path / "x.yaml").write_text(SHORT.replace("noise: [[0.1]]", "noise: [[-0.1]]"))
    with pytest.raises(ProblemError) as caught:
        oc.read_problem(tmp_path / "x.yaml")
    assert "x.yaml:6:47: noise of sensor 'a' is not positive definite" in str(caught.value)
    assert "x.yaml:6:47: noise of sensor 'b' is not positive definite" in str(caught.value)


def test_anchors_around_long_lists_of_numbers(tmp_path: Path) -> None:
    rows = ", ".join(f"[{i}.5, {i}, 3, 4]" for i in range(2000))
    data = read_yaml(f"a: &x [{rows}]\nb: &y {{c: [{rows}]}}\nd: *x\ne: *y\n", "f").data
    assert len(rows) > 20_000 and np.array_equal(data["d"], data["a"]) and np.array_equal(data["e"]["c"], data["a"])


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("a: &x [1, *x]", "f:1:11: the alias '*x' stands inside of what it refers to"),
        ("a: &x {<<: *x}", "f:1:12: the alias '*x' stands inside of what it refers to"),
        ("a: *x\nb: &x 1", "f:1:4: there is no anchor '&x' before the alias '*x'"),
        ("a: &long 1\nb: *lnog", "no anchor '&lnog' before the alias '*lnog'\n  hint: did you mean 'long'?"),
        ("a: &x 1\nb: &x 2", "f:2:4: the anchor '&x' stands twice"),
        ("&x a: 1", "f:1:1: the anchor '&x' stands before a key"),
        ("a: &x 1\n*x : 2", "a key must be a word|this is not YAML"),
        ("a: &x 1\nb: {<<: *x}", "f:2:9: '<<' takes a mapping, or a list of mappings"),
    ],
)
def test_what_is_refused(text: str, what: str) -> None:
    with pytest.raises(ProblemError) as caught:
        found = read_yaml(text, "f")
        raise found.placed(found.mistakes)
    assert any(each in str(caught.value) for each in what.split("|")), str(caught.value)


def test_a_bomb_is_counted_as_it_would_expand() -> None:
    bomb = "a: &a [1, 1, 1, 1, 1, 1, 1, 1, 1]\n"
    bomb += "".join(f"{b}: &{b} [{', '.join([f'*{a}'] * 9)}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True))
    began = time.process_time()
    with pytest.raises(ProblemError, match=f"aliases bring in more than {MOST_COPIED} values"):
        read_yaml(bomb, "f")
    assert time.process_time() - began < 2.0
    deep = "a: &a [[[[[[[[[[1]]]]]]]]]]\n" + "".join(
        f"{b}: &{b} [[[[[[[[*{a}]]]]]]]]\n" for a, b in zip("abcdef", "bcdefg", strict=True)
    )
    with pytest.raises(ProblemError, match="nested deeper than 40 levels"):
        read_yaml(deep, "f")

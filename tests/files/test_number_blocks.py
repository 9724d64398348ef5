"""Lists of numbers that are read at once: the same data and the same places as the parser's, in all its forms."""

from __future__ import annotations

import random

import pytest

from occontrol.core.errors import ProblemError
from occontrol.files import number_blocks, yaml_text
from occontrol.files.number_blocks import MARK, Shortened, cut
from occontrol.files.positions import Place


def both(source: str):
    return yaml_text.read_yaml(source, "x.yaml"), yaml_text._read(Shortened(source), "x.yaml")


def tree(place: Place):
    inside = place.inside
    if isinstance(inside, dict):
        inside = {key: tree(value) for key, value in inside.items()}
    elif isinstance(inside, list):
        inside = [tree(value) for value in inside]
    return place.line, place.column, place.key, inside


@pytest.fixture(autouse=True)
def always_worthwhile(monkeypatch):
    monkeypatch.setattr(number_blocks, "WORTHWHILE", 0)


TEXTS = {
    "rows": "a: [[1, 2.5, -3e-2], [4, 5, 6]]\nb: 3\n",
    "lines": "a: [[1, 2, 3, 4, 5, 6],\n    [4, 5, 6],\n\n  [7, 8, 9]]   # a remark [1, 2]\nb: {c: 1}\n",
    "in a mapping": "p: {a: [[1, 2, 3, 4, 5, 6, 7, 8, 9]], b: [[1, 2, 3, 4, 5, 6, 7, 8, 9]], c: [x, 1]}\nq: 2\n",
    "lines in a mapping": "p: {a: [[1, 2, 3,\n 6, 7, 8, 9]], b: [[1, 2, 3,\n 4, 5, 6, 7, 8, 9]], c: [x, 1]}\nq: 2\n",
    "items": "v:\n  - [[1, 2, 3, 4], [5, 6, 7, 8]]\n  - [[2, 3, 4], [6, 7, 8]]\n  - [a, [2, 3, 4, 5, 6, 7, 8, 9]]\n",
    "returns": "a: [[1, 2, 3, 4, 5, 6],\r\n    [4, 5, 6]]\r\nb: 3\r\n",
    "beginning with a break": "a: [\n  [1, 2, 3, 4, 5, 6],\n  [4, 5, 6]\n  ]\nb: 3\n",
    "short forms": "a: [.5, 1., -.5, 1.e3, .5e-3, 100000000000000000000000]\nb: 3\n",
    "not JSON": "a: [007, +1, 1 2, 3, 4, 5, 6, 7, 8, 9]\nb: [1, 2, 3, 4, 5, 6, 7, 8, 9,]\n",
    "words": "a: [1, 2, 3, 4, 5, 6, 7, 8, e, 9]\nb: [1, 2, 3, 4, 5, 6, 7, 8, -, 9]\n",
    "quoted": "a: '[1, 2, 3, 4, 5, 6, 7, 8, 9, 10]'\nb: \"[1, 2, 3, 4, 5, 6, 7, 8, 9, 10]\"\nc: 1\n",
    "text": "a: from [1, 2, 3, 4, 5, 6, 7, 8, 9, 10]\nb: |\n  [1, 2, 3, 4, 5, 6, 7, 8, 9, 10]\n",
    "comment": "# [1, 2, 3, 4, 5, 6, 7, 8, 9, 10]\na: [1, 2, 3, 4, 5, 6, 7, 8, 9, 10] # [1, 2, 3, 4, 5, 6, 7, 8]\n",
    "deep": "a: [[[[[[[[[[[[1, 2, 3, 4, 5, 6, 7]]]]]]]]]]]]\n",
    "mark": f"a: '{MARK}0'\nb: [1, 2, 3, 4, 5, 6, 7, 8, 9, 10]\n",
    "other breaks": "a: [1, 2, 3, 4, 5, 6, 7, 8, 9, 10]\nb: 'x\u2028y'\n",
    "alone": "[1, 2, 3, 4, 5, 6, 7, 8, 9, 10]\n",
    "empty lists": "a: [[], [], [], [], [], [], [], []]\nb: [[], [1], [], [], [], [], [], []]\n",
}


@pytest.mark.parametrize("name", TEXTS)
def test_the_same_data_and_places(name):
    quick, slow = both(TEXTS[name])
    assert repr(quick.data) == repr(slow.data)
    assert tree(quick.places) == tree(slow.places)


def test_it_is_used_at_all():
    used = [name for name, text in TEXTS.items() if cut(text).blocks]
    assert {"rows", "lines", "in a mapping", "lines in a mapping", "items", "returns", "short forms"} <= set(used)


@pytest.mark.parametrize(
    "text",
    [
        "[1, 2, 3, 4, 5, 6, 7, 8, 9, 10]: 1\n",
        "{[1, 2, 3, 4, 5, 6, 7, 8, 9, 10]: 1}\n",
        "a: &x [1, 2, 3, 4, 5, 6, 7, 8, 9, 10]\n",
        "a: !!set [1, 2, 3, 4, 5, 6, 7, 8, 9, 10]\n",
        "a: [1, 2, 3, 4, 5, 6, 7, 8, 9, 10]x\n",
        "a: [1, 2, 3, 4, 5, 6, 7, 8, 9, 10]\n  b\n",
        "a: [1, 2, 3, 4, 5, 6, 7, 8, 9, 10]\nb: *c\n",
        "a: [1, 2, 3, 4, 5, 6, 7, 8, 9, 10\nb: 1\n",
        "a: [1, 2, 3, 4, 5, 6, 7, 8, 9, 10]\na: [1, 2, 3, 4, 5, 6, 7, 8, 9, 10]\n",
        "a:\n" + "".join("  " * i + f"k{i}:\n" for i in range(1, 38)) + "  " * 38 + "z: [[[[1, 2, 3, 4, 5, 6]]]]\n",
    ],
)
def test_the_same_refusals(text):
    def outcome(read):
        try:
            return [str(m) for m in read().mistakes]
        except ProblemError as error:
            return str(error)

    assert outcome(lambda: yaml_text.read_yaml(text, "x")) == outcome(lambda: yaml_text._read(Shortened(text), "x"))


@pytest.mark.parametrize("seed", range(30))
def test_random_documents(seed):
    r = random.Random(seed)

    def value(depth):
        kind = r.random()
        if depth > 3 or kind < 0.3:
            return r.choice(["1", "-2.5e-3", ".5", "x", "'[1, 2, 3, 4, 5, 6, 7, 8, 9]'", "2", "3.25", "17"])
        gap = r.choice(["", " ", "\n      "])
        if kind < 0.8:
            plain = r.random() < 0.7
            numbers = ["1", "-2.5", "[3, 4]", "1e5"]
            items = [r.choice(numbers) if plain else value(depth + 1) for _ in range(r.randint(1, 9))]
            return "[" + gap + (", " + gap).join(items) + gap + "]"
        return "{" + ", ".join(f"k{i}: {value(depth + 1)}" for i in range(r.randint(1, 3))) + "}"

    text = "".join(f"key{i}:\n    - {value(0)}\n    - {value(0)}  # [1, 2, 3]\n" for i in range(8))
    quick, slow = both(text)
    assert repr(quick.data) == repr(slow.data)
    assert tree(quick.places) == tree(slow.places)


def test_a_large_table_and_a_mistake_in_it():
    rows = "".join(f"      - [[{k}, 2.5, {-k}], [1, 2, 3], [{k}e-3, 0, 1]]\n" for k in range(3000))
    text = f"v:\n{rows}end: yes\n"
    text = text.replace("[[1234, 2.5", "[[1234, abc")
    quick, slow = both(text)
    assert quick.data == slow.data
    assert quick.locate(("v", 1234, 0, 1)) == slow.locate(("v", 1234, 0, 1)) == (1236, 17)
    assert quick.locate(("v", 2999, 2, 2)) == slow.locate(("v", 2999, 2, 2))


def test_every_character_is_looked_at_once(monkeypatch):
    looked_at = 0

    class Counting:
        def match(self, source, start):
            nonlocal looked_at
            found = pattern.match(source, start)
            looked_at += found.end() - start
            return found

    pattern = number_blocks._RUN
    monkeypatch.setattr(number_blocks, "_RUN", Counting())
    text = "v:\n" + "      - [[1.25, 2.5, 3.5], [1, 2, 3]]\n" * 5000
    assert len(cut(text).blocks) == 5000
    assert looked_at <= len(text)

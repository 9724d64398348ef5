"""Several mistakes of one problem file are reported together, also where one of them hides a size or a whole part."""

import pytest

from occontrol.api import read_problem
from occontrol.core.errors import ProblemError

ROBUST = """family: robust
horizon: {end: 2, slots: 4}
plant:
  A: [[0, 1], [-1, -0.4]]
  B: [[0], [1]]
  K: [[1, 2]]
  initial: {center: [1, 0], weight: {identity: 2}, level: 1}
sensors:
  - {name: a, C: [[1, 0]]}
  - {name: b, C: [[0, 1]]}
size: trace
method: {name: fixed, sequence: [a, b, a, b]}
"""
PRECISION = """family: precision
plant: {f: ["x2", "-sin(x1)"], step: 0.1, substeps: 2}
measurement: {h: ["x1", "x2"], names: [angle, rate]}
initial: {mean: [1, 0], covariance: {identity: 2}}
noise: {identity: 2, scale: 0.1}
filter: {name: enkf, members: 20}
batch: 2
bound: {factor: 0.5}
caps: [1, 2]
prices: [1, 1]
prune: {sensors: 1, by: sensor}
method: {name: barrier}
"""
LATE_ROBUST = [("[0, 1]]}\nsize: trace", "[0, 1, 0]]}\nsize: trase"), ("level: 1", "level: 0"), ("a, b, a, b", "a, c")]
LATE_ROBUST_WORDS = ["C of sensor 'b' is 1x3", "unknown size 'trase'", "level is 0", "there is no sensor 'c'"]
LATE_PRECISION = [("[1, 2]", "[1, -2]"), ("prices: [1, 1]", "prices: 0"), ("factor: 0.5", "factor: 0")]
LATE_PRECISION_WORDS = ["caps entry 2 is -2", "prices is 0", "bound.factor is 0"]


def reported(tmp_path, text: str) -> str:
    path = tmp_path / "p.yaml"
    path.write_text(text)
    with pytest.raises(ProblemError) as caught:
        read_problem(path)
    assert all(str(path) in m.place for m in caught.value.mistakes)
    return str(caught.value)


def changed(text: str, changes) -> str:
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return text


@pytest.mark.parametrize(
    ("old", "new", "first"),
    [
        ("  A: [[0, 1], [-1, -0.4]]\n", "", "plant has no 'A'"),
        ("[-1, -0.4]]", "[-1, -0.4, 3]]", "row 2 has 3 entries"),
        ("[-1, -0.4]]", "[-1, 'foo(t)']]", "unknown function 'foo'"),
        ("  B: [[0], [1]]\n", "  B: [[0, 1]]\n", "B is 1x2, it must have 2 rows"),
        ("weight: {identity: 2}", "weight: [[1, 1], [0, 1]]", "weight is not symmetric"),
        ("slots: 4", "slots: 0", "horizon.slots is 0"),
        ("horizon: {end: 2, slots: 4}\n", "", "the problem has no 'horizon'"),
        ("{name: a, ", "{", "sensor 1 has no 'name'"),
        ("{name: a, C: [[1, 0]]}", "{name: b, C: [[1, 0]]}", "the name 'b' is used twice"),
        (", C: [[1, 0]]", "", "sensor 'a' has no 'C'"),
        ("slots: 4", "slots: 4, samples: 0", "horizon.samples is 0"),
    ],
)
def test_robust(tmp_path, old, new, first):
    text = reported(tmp_path, changed(changed(ROBUST, LATE_ROBUST), [(old, new)]))
    for words in (first, *LATE_ROBUST_WORDS):
        assert words in text
    assert "empty" not in text  # nothing is said about what stands in for the lacking part


@pytest.mark.parametrize(
    ("old", "new", "first"),
    [
        ("-sin(x1)", "-sin(x9)", "unknown name 'x9'"),
        ("step: 0.1", "step: -1", "step is -1"),
        ('h: ["x1", "x2"]', 'h: ["x1", "foo(x2)"]', "unknown function 'foo'"),
        ("[angle, rate]", "[angle, angle]", "the name 'angle' is used twice"),
        ("mean: [1, 0]", "mean: [1, 0, 2]", "mean has 3 entries"),
        ("covariance: {identity: 2}", "covariance: [[1, 2], [0, 1]]", "covariance is not symmetric"),
        (", covariance: {identity: 2}", "", "initial has no 'covariance'"),
        ("scale: 0.1", "scale: -0.1", "noise is not positive semidefinite"),
        ("members: 20", "members: 1", "members is 1"),
        ("members: 20", "membrs: 20", "unknown key 'membrs' in filter"),
        ("batch: 2", "batch: 0", "batch is 0"),
        ("by: sensor", "by: luck", "prune.by is 'luck'"),
        ("name: barrier", "name: barier", "unknown method 'barier'"),
        ("filter: {name: enkf, members: 20}\n", "", "the problem has no 'filter'"),
        ('measurement: {h: ["x1", "x2"], names: [angle, rate]}\n', "", "the problem has no 'measurement'"),
    ],
)
def test_precision(tmp_path, old, new, first):
    text = reported(tmp_path, changed(changed(PRECISION, LATE_PRECISION), [(old, new)]))
    for words in (first, *LATE_PRECISION_WORDS):
        assert words in text
    assert "it needs" not in text  # no size is called wrong that follows from a part that could not be read


def test_moments(tmp_path):
    text = reported(
        tmp_path,
        """family: precision
moments: {state: [[2, 0.5], [0.4, 1.5]], cross: [[1, 2, 3]], measurement: [[1, 0], [0, -1]]}
bound: {factor: 0.5, matrix: [[1]]}
caps: [1, -2, 5]
batch: 3
""",
    )
    for words in (
        "state is not symmetric",
        "cross is 1x3",
        "measurement is not positive semidefinite",
        "both factor and matrix",
        "caps entry 2 is -2",
        "caps has 3 entries, it needs 2",
        "moments are a single batch",
    ):
        assert words in text


def test_options_of_a_method_with_an_unknown_one(tmp_path):
    text = reported(
        tmp_path, ROBUST.replace("{name: fixed, sequence: [a, b, a, b]}", "{name: optimal, widht: 3, node_limit: 0}")
    )
    assert "unknown option 'widht'" in text
    assert "node_limit is 0, it must be at least 1" in text

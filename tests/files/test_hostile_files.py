"""Whatever stands in a file, the answer is a problem, a ProblemError with places, or a FileAccessError."""

import json
import re
import tempfile
import time
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from occontrol.api import document, read_measurements, read_problem, read_schedule
from occontrol.core.errors import FileAccessError, InfeasibleError, ProblemError

SEED = """\
family: athans
horizon: {start: 0, end: 2, intervals: 4, predict_at: 3}
plant:
  A: [[0, 1], ["sin(t)", -0.4]]
  noise: {identity: 2, scale: 0.5}
  initial: {mean: [1, 0], covariance: {diag: [5, 5]}}
sensors:
  - {name: radar, C: [[1, 0]], noise: [[0.1]], cost: 2.0, windows: [[0, 1]]}
  - {name: table, C: {times: [0, 2], values: [[[0, 1]], [[1, 1]]]}, noise: 0.4}
  - idle
select: 1
objective: {cost_weight: 0.1, output: [[1, 0]]}
method: {name: relaxed}
expect: {source: x, cost: 1}
"""
PLACE = re.compile(r"^\S+:\d+:\d+: .|^  hint: .")
PIECES = [
    *"[]{}:,-&*!|>'\"%@`#?~\n\t \\",
    ": ",
    "- ",
    "---\n",
    "...\n",
    "<<: ",
    "null",
    "true",
    ".nan",
    "-.inf",
    "1e999",
    "0x1f",
]
PIECES += [
    "1_000",
    "!!int ",
    "&a ",
    "*a",
    "? ",
    "family",
    "athans",
    "idle",
    "t",
    "sin(t)",
    "{file: x.npz, times: t, values: v}",
]
PIECES += [
    "{diag: [1]}",
    "{identity: 3}",
    "\ufeff",
    "\u2028",
    "\x07",
    "\x85",
    "é",
    "9" * 400,
    "{",
    "[" * 60,
    "- " * 60,
    '"\\x',
    "|2\n",
]


def verdict(name: str, content: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_bytes(content)
        try:
            problem = read_problem(path)
            json.dumps(document(problem), allow_nan=False)
            problem.require_feasible()
        except ProblemError as error:
            assert error.mistakes
            for line in str(error).splitlines():
                assert PLACE.match(line), line
        except (FileAccessError, InfeasibleError):
            pass


@settings(max_examples=150, deadline=None)
@given(st.binary(max_size=200) | st.text(max_size=100).map(lambda s: s.encode("utf-8", "surrogatepass")))
def test_random_bytes(content):
    for name in ("x.yaml", "x.json"):
        verdict(name, content)


@st.composite
def mutated(draw) -> str:
    text = SEED
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, len(text)))
        cut = draw(st.sampled_from([0, 0, 1, 2, 5, 12, 40]))
        text = text[:at] + draw(st.sampled_from(PIECES)) + text[at + cut :]
    return text


@pytest.mark.slow
@settings(max_examples=300, deadline=None)
@given(mutated())
def test_mutated_yaml(text):
    verdict("x.yaml", text.encode())


values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.sampled_from(["idle", "t", "1/t", "x", "", "sqrt(t-1)"]),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(["diag", "identity", "times", "values", "file", "name", "C", "noise", "x"]),
            inner,
            max_size=3,
        )
    ),
    max_leaves=8,
)


def spots(data, path=()):
    yield path
    children = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in children:
        yield from spots(value, (*path, key))


@pytest.mark.slow
@settings(max_examples=150, deadline=None)
@given(st.data())
def test_any_value_at_any_place(data):
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "x.yaml").write_text(SEED)
        tree = document(read_problem(Path(folder) / "x.yaml"))
    for _ in range(data.draw(st.integers(1, 3))):
        path = data.draw(st.sampled_from(list(spots(tree))[1:]))
        inner = tree
        for step in path[:-1]:
            inner = inner[step]
        if isinstance(inner, dict) and data.draw(st.booleans()):
            del inner[path[-1]]
        else:
            inner[path[-1]] = data.draw(values)
    verdict("x.json", json.dumps(tree).encode())


CELLS = [
    "0",
    "1",
    "2",
    "0.5",
    "nan",
    "inf",
    "",
    "radar",
    "table",
    "idle",
    "radar;table",
    "x",
    '"',
    "1e999",
    "-1",
    "\x00",
    "é",
]


@pytest.mark.slow
@settings(max_examples=120, deadline=None)
@given(st.lists(st.lists(st.sampled_from(CELLS), max_size=5).map(",".join), max_size=6), st.booleans())
@example(["0,2,idle"], True)
def test_any_lines_of_data(lines, header):
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "x.yaml").write_text(SEED)
        problem = read_problem(Path(folder) / "x.yaml")
        for read, first in ((read_schedule, "start,end,sensors"), (read_measurements, "t,sensor,z1")):
            path = Path(folder) / "data.csv"
            path.write_text("\n".join([first, *lines] if header else lines), encoding="utf-8")
            try:
                read(path, problem)
            except ProblemError as error:
                assert all(str(m).startswith(str(path)) for m in error.mistakes)


@pytest.mark.parametrize(
    "content",
    [
        "{" * 100_000,
        "a: " * 100_000,
        "- " * 100_000,
        "a" * 1_000_000,
        "[" + "1," * 20_000 + "1]",
        "? " * 50_000,
        "'" * 100_001,
    ],
)
def test_large_nonsense_is_refused_soon(tmp_path, content):
    start = time.process_time()
    verdict("x.yaml", content.encode())
    assert time.process_time() - start < 8

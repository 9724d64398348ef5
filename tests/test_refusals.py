"""Every refusal of a bad problem file, with the words that the user reads and the place they point at."""

import itertools
import sys
from pathlib import Path

import pytest

from occontrol.api import read_problem
from occontrol.core.errors import FileAccessError, InfeasibleError, ProblemError

BASE = """\
family: athans
name: base
horizon: {start: 0, end: 10, intervals: 40}
plant:
  A: [[0, 1], [-1, -0.4]]
  noise: [[0, 0], [0, 0.5]]
  initial: {mean: [1, 0], covariance: {diag: [5, 5]}}
sensors:
  - {name: radar, C: [[1, 0]], noise: [[0.1]], cost: 2.0}
  - {name: doppler, C: [[0, 1]], noise: [[0.4]], cost: 0.5}
objective: {cost_weight: 0.1, output: [[1, 0]]}
"""


def cases() -> list[tuple[str, str, list[str]]]:
    """From refusals.txt: '- what stands in BASE', '+ what stands there instead', and the lines that the user reads."""
    blocks = Path(__file__).with_name("refusals.txt").read_text(encoding="utf-8").split("\n\n")
    rows = [block.strip("\n").split("\n") for block in blocks if not block.startswith("#")]
    return [(plain(old), plain(new), lines) for old, new, *lines in rows]


def plain(line: str) -> str:
    return line[2:].replace("\\n", "\n").replace("\\t", "\t")


def written(folder: Path, text: str, name: str = "x.yaml") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def refused(path: Path) -> list[str]:
    """The lines of the refusal, without the name of the file."""
    with pytest.raises(ProblemError) as error:
        read_problem(path)
    return str(error.value).replace(f"{path}:", "").split("\n")


def test_base_is_accepted(tmp_path):
    problem = read_problem(written(tmp_path, BASE))
    problem.require_feasible()
    assert problem.sensors.names == ["radar", "doppler"]


@pytest.mark.parametrize(("old", "new", "lines"), cases())
def test_words_and_place(tmp_path, old, new, lines):
    assert BASE.count(old) >= 1
    assert refused(written(tmp_path, BASE.replace(old, new, 1))) == lines


@pytest.mark.parametrize(
    ("formula", "words"),
    [
        ("+".join(["t"] * 50_000), "has 99999 characters, the limit is 10000"),
        ("max(" + ",".join(["t"] * 3_000) + ")", "has more than 5000 terms"),
        ("+".join(["t"] * 4_999), "terms in a row"),  # too many for Python's parser before 3.13
        ("+".join(["t"] * 500), "has more than 400 terms in a row"),
        ("(" * 500 + "t" + ")" * 500, "nests 500 parentheses, the limit is 100"),
        ("-" * 9000 + "t", "or is nested too deeply"),
        ("2**" * 3000 + "2", "or is nested too deeply"),
        ("9" * 5000, "is not a formula"),
        ("9" * 4000, "contains a number that is not finite"),
    ],
)
def test_formulas_that_are_too_large(tmp_path, formula, words):
    calls = itertools.count()
    sys.setprofile(lambda frame, event, argument: next(calls) and None)
    try:
        line = refused(written(tmp_path, BASE.replace("[-1, -0.4]", f'["{formula}", -0.4]')))[0]
    finally:
        sys.setprofile(None)
    assert line.startswith("5:16: A entry [2,1]: expression '") and words in line
    assert next(calls) < 3_000_000  # the refusal does not take long either


def test_numbers_that_are_too_large(tmp_path):
    text = BASE.replace("C: [[1, 0]]", "C: [[1, " + "9" * 5000 + "]]")
    assert refused(written(tmp_path, text))[0] == "9:27: C of sensor 'radar' entry [1,2] is infinite, it must be finite"


def test_deep_nesting(tmp_path):
    deep = BASE.replace("name: base", "name: " + "[" * 50 + "]" * 50)
    assert refused(written(tmp_path, deep))[0] == "2:46: nested deeper than 40 levels"
    assert refused(written(tmp_path, "a: " + "[" * 200_000))[0] == "1:43: nested deeper than 40 levels"


def test_nothing_is_executed(tmp_path):
    target = tmp_path / "executed"
    for attack in (
        f"__import__('os').system('touch {target}')",
        f"open('{target}', 'w')",
        f"(lambda: open('{target}', 'w'))()",
        f"[c for c in ().__class__.__base__.__subclasses__()][0]('{target}')",
    ):
        text = BASE.replace("[-1, -0.4]", f'["{attack}", -0.4]')
        assert "expression" in refused(written(tmp_path, text))[0]
    for tag in ("!!python/object/apply:os.system", "!!python/object/new:os.system", "!!python/name:os.system"):
        text = BASE.replace("name: base", f"name: {tag} ['touch {target}']")
        assert f"the tag '{tag}' is not allowed" in refused(written(tmp_path, text))[0]
    assert not target.exists()


def test_many_mistakes_are_reported_together_in_the_order_of_the_file(tmp_path):
    text = BASE.replace("intervals: 40", "intervals: 40, predict_at: 9").replace("diag: [5, 5]", "diag: [5, -5]")
    text = text.replace("C: [[1, 0]]", "C: [[1, 0, 0]]").replace("noise: [[0.4]], cost", "noise: [[0]], cots")
    text = text.replace("cost_weight: 0.1", "cost_weight: -1").replace("[0, 0.5]", "[0, -0.5]") + "selct: 1\n"
    assert [line for line in refused(written(tmp_path, text)) if not line.startswith("  hint")] == [
        "3:57: predict_at = 9 lies before the end of the horizon, 10",
        "6:10: noise of the plant is not positive semidefinite: its smallest eigenvalue is -0.5",
        "7:39: covariance is not positive semidefinite: its smallest eigenvalue is -5",
        "9:22: C of sensor 'radar' is 1x3, but the plant has 2 states",
        "10:41: noise of sensor 'doppler' is not positive definite: its smallest eigenvalue is 0",
        "10:48: unknown key 'cots' in sensor 'doppler'",
        "11:26: cost_weight is -1, it must be finite and not negative",
        "12:1: unknown key 'selct'",
    ]


def test_mistakes_in_sensors_are_reported_beside_those_in_the_plant(tmp_path):
    text = BASE.replace("[-1, -0.4]", "[-x, -0.4]").replace("C: [[1, 0]]", "C: [1, 0]").replace("[[0.4]]", "[[0.4, 1]]")
    assert [line for line in refused(written(tmp_path, text)) if not line.startswith("  hint")] == [
        "5:16: A entry [2,1]: expression '-x' uses the unknown name 'x'",
        "9:23: C of sensor 'radar' is a flat list, it must be a list of rows",
        "10:41: noise of sensor 'doppler' is 1x2, its C has 1 row",
    ]


def test_no_more_than_fifty_mistakes_are_listed(tmp_path):
    rows = ", ".join(["[" + ", ".join(["true"] * 20) + "]"] * 20)
    lines = refused(written(tmp_path, BASE.replace("[[0, 1], [-1, -0.4]]", f"[{rows}]")))
    assert len(lines) == 51 and lines[-1].endswith("and 350 more mistakes")


def test_windows_that_leave_no_sensor_are_infeasible_with_the_time(tmp_path):
    text = BASE.replace("cost: 2.0}", "cost: 2.0, windows: [[0, 4]]}").replace(
        "cost: 0.5}", "cost: 1, windows: [[6, 10]]}"
    )
    problem = read_problem(written(tmp_path, text))
    with pytest.raises(
        InfeasibleError, match=r"between t = 4 and 6 no sensor is available\n  hint: widen a window"
    ):
        problem.require_feasible()
    read_problem(written(tmp_path, text.replace("sensors:\n", "sensors:\n  - idle\n"))).require_feasible()


def test_all_gaps_of_a_window_plan_are_named_at_once(tmp_path):
    text = BASE.replace("cost: 2.0}", "cost: 2.0, windows: [[0, 2], [3, 5]]}").replace(
        "cost: 0.5}", "cost: 1, windows: [[6, 10]]}"
    )
    with pytest.raises(InfeasibleError, match="between t = 2 and 3, 5 and 6 no sensor is available"):
        read_problem(written(tmp_path, text)).require_feasible()


def test_select_beyond_what_windows_leave_is_infeasible(tmp_path):
    text = BASE.replace("cost: 2.0}", "cost: 2.0, windows: [[0, 4]]}") + "select: 2\n"
    problem = read_problem(written(tmp_path, text))
    with pytest.raises(
        InfeasibleError, match=r"between t = 4 and 10 only 1 of the 2 sensors to select is available"
    ):
        problem.require_feasible()


def test_alias_bomb(tmp_path):
    pairs = zip("abcdefghijklmnopqrst", "bcdefghijklmnopqrstu", strict=True)
    bomb = "a: &a [x, x]\n" + "".join(f"{b}: &{b} [*{a}, *{a}]\n" for a, b in pairs)
    assert refused(written(tmp_path, bomb))[0] == "15:12: aliases bring in more than 100000 values"
    assert refused(written(tmp_path, "family: *b\n"))[0] == "1:9: there is no anchor '&b' before the alias '*b'"


@pytest.mark.parametrize(
    ("content", "line"),
    [
        (b"", "1:1: the file is empty"),
        (b" \n\n", "1:1: the file is empty"),
        (b"# only a comment\n", "1:1: the file holds empty, it must be a mapping"),
        (b"- a\n- b\n", "1:1: the file holds a list, it must be a mapping"),
        (b"just words\n", "1:1: the file holds the text 'just words', it must be a mapping"),
        (b"\x7fELF\x00\x01\x02", "1:1: this is binary data, not a problem file"),
        (BASE.encode("utf-16"), "1:1: this is binary data, not a problem file"),
        (b"family: athans\nname: caf\xe9\n", "2:10: this is not UTF-8 text"),
        (b"family: athans\nname: \x1b[31m\n", "2:7: a character that is not allowed in YAML (binary data?)"),
    ],
)
def test_content_that_is_no_problem(tmp_path, content, line):
    path = tmp_path / "x.yaml"
    path.write_bytes(content)
    assert refused(path)[0] == line


def test_thirty_megabytes_are_refused_without_reading_them(tmp_path, monkeypatch):
    path = tmp_path / "x.yaml"
    path.write_bytes(b"# " + b"x" * (30 * 2**20))
    assert refused(path)[0] == "1:1: the file is larger than 2 MB"


def test_what_cannot_be_read(tmp_path):
    with pytest.raises(FileAccessError, match="there is no file"):
        read_problem(tmp_path / "none.yaml")
    with pytest.raises(FileAccessError, match="is a folder"):
        read_problem(tmp_path)
    with pytest.raises(FileAccessError, match="is not an ordinary file"):
        (tmp_path / "null.yaml").symlink_to("/dev/null")
        read_problem(tmp_path / "null.yaml")
    assert refused(written(tmp_path, BASE, "x.txt"))[0] == "1:1: the file name ends in '.txt'"


def test_json_has_places_too(tmp_path):
    text = (
        '{"family": "athans",\n "horizon": {"end": 10, "intervals": 4, "intervals": 5},\n "objective": {"output": NaN}}'
    )
    assert [line for line in refused(written(tmp_path, text, "x.json")) if not line.startswith("  hint")] == [
        "1:1: the problem has no 'plant'",
        "1:1: the problem has no 'sensors'",
        "2:41: the key 'intervals' stands twice",
    ]
    line = refused(written(tmp_path, '{"family": "athans",}', "x.json"))[0]  # from 3.13 on the place is the comma's
    assert line.startswith(("1:21: this is not JSON: ", "1:20: this is not JSON: "))
    assert refused(written(tmp_path, "[" * 100_000, "x.json"))[0] == "1:1: nested deeper than 40 levels"
    assert refused(written(tmp_path, '{"a":' * 45 + "1" + "}" * 45, "x.json"))[0] == "1:1: nested deeper than 40 levels"


def test_what_a_file_says_is_quoted_without_control_characters(tmp_path):
    key = '"\\e[31m' + "x" * 900 + '"'
    (line, _) = refused(written(tmp_path, BASE + f"{key}: 1\n"))
    assert line.startswith(r"12:1: unknown key '\x1b[31mxxx") and len(line) < 700


def test_mistakes_do_not_hide_one_another(tmp_path):
    """A wrong formula in A, a repeated name and unknown words leave everything else to be looked at."""
    text = BASE
    for old, new in (
        ("[-1, -0.4]", '["sin(t", -0.4]'),
        ("[0, 0.5]]", "[0, -0.5]]"),
        ("name: radar", "name: doppler"),
        ("cost: 2.0", "cost: -2.0, colour: red"),
        ("C: [[0, 1]]", "C: [[0, 1, 2]]"),
        ("output: [[1, 0]]}", "output: [[1, 0, 0]]}\nmethod: schedul"),
    ):
        assert text.count(old) == 1
        text = text.replace(old, new)
    places = [line.split(": ")[0] for line in refused(written(tmp_path, text)) if not line.startswith("  hint")]
    assert [place.split(":")[0] for place in places] == ["5", "6", "9", "9", "10", "10", "11", "12"]

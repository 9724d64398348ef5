"""The worked example of the README is run, command by command, and prints what the README shows."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from occontrol.cli import run

TEXT = (Path(__file__).resolve().parents[1] / "README.md").read_text(encoding="utf-8")
BY_HAND = "start,end,sensors\n0,8,doppler\n8,10,range\n"
NUMBER = re.compile(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?")
TARGET = 1e-4  # the gap that methods aim at when nothing else is asked
SAME = 1e-3  # of a number: other versions of the libraries below stop elsewhere within the target gap of 1e-4


def section(title: str) -> str:
    """What stands below a heading."""
    return re.split(r"^## ", TEXT.split(f"## {title}\n", 1)[1], maxsplit=1, flags=re.M)[0]


def commands(text: str) -> list[tuple[str, list[str]]]:
    """Every shown command with the lines shown below it."""
    found: list[tuple[str, list[str]]] = []
    for line in text.splitlines():
        if line.startswith("    $ occontrol "):
            found.append((line.removeprefix("    $ occontrol "), []))
        elif line.startswith("    ") and found:
            found[-1][1].append(line.strip())
        elif found and line.strip():
            found.append(("", []))
    return [pair for pair in found if pair[0]]


def tokens(line: str, table: bool) -> list[str]:
    """The words of a line without what depends on the machine's speed."""
    words = re.sub(r"\d+(\.\d+)? s$", "T s", line.strip()).split()
    words = words[:-1] if table else words
    following = [*words[1:], ""][: len(words)]
    return [f"{a}%" if b == "%" and NUMBER.fullmatch(a) else a for a, b in zip(words, following, strict=True)]


def same(shown: str, printed: str) -> bool:
    """Whether two words agree, numbers to SAME, percentages to the gap that is aimed at."""
    # a gap is the small difference of two such numbers
    if all(word.endswith("%") and word != "%" for word in (shown, printed)):
        a, b = float(shown[:-1]), float(printed[:-1])
        return abs(a - b) <= max(SAME * abs(a), 100 * TARGET)
    one, other = (NUMBER.fullmatch(word.strip("[],.;")) for word in (shown, printed))
    if one and other:
        a, b = float(one[0]), float(other[0])
        return abs(a - b) <= SAME * max(abs(a), abs(b))
    return shown == printed


@pytest.fixture
def workplace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the problem file of the example and the schedule planned by hand."""
    example = section("A worked example")
    (tmp_path / "two_radars.yaml").write_text(example.split("```yaml\n", 1)[1].split("```", 1)[0], encoding="utf-8")
    (tmp_path / "by_hand.csv").write_text(BY_HAND, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_worked_example_prints_what_the_readme_shows(workplace: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shown = commands(section("A worked example"))
    assert [command.split()[0] for command, _ in shown] == ["solve", "compare", "certify", "simulate", "filter"]
    for command, lines in shown:
        capsys.readouterr()
        assert run(command.split()) == 0, command
        streams = capsys.readouterr()
        printed = [line for line in (streams.out + streams.err).splitlines() if line.strip()]
        table = command.startswith("compare")
        for line in lines:
            expected = tokens(line, table)
            close = [p for p in printed if p.split()[:1] == line.split()[:1]] or printed
            assert any(
                len(words) == len(expected) and all(same(a, b) for a, b in zip(expected, words, strict=True))
                for words in (tokens(p, table) for p in printed)
            ), f"$ occontrol {command}\nshown   {line}\nprinted {close[:3]}"


def test_the_comparison_can_fail() -> None:
    assert same("0.16665", "0.16664") and same("gap", "gap")
    assert same("32.5%", "32.51%") and same("0.00579%", "0.00581%")
    assert not same("32.5%", "32.6%") and not same("0.00579%", "0.0159%") and not same("0.01%", "0.01")
    assert not same("0.1666", "0.1696") and not same("gap", "gaps")

"""The commands on the families that choose sensors step by step: codes and messages that belong to these families."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from occontrol.cli import run
from occontrol.cli.output import percent, with_error

Captured = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("family", ["hybrid", "precision"])
def test_certify_without_bounds_is_a_usage_mistake_however_it_is_called(family: str, capsys: Captured) -> None:
    """The family decides, not whether the schedule is there, readable, or of a run folder."""
    assert run(["init", family, "x.yaml"]) == 0
    assert run(["solve", "x.yaml", "--no-figures"]) == 0
    Path("mine.csv").write_text("start,end,sensors\n0,1,ranger\n")
    Path("bad.json").write_text("{")
    words = [["runs/x"], ["x.yaml", "runs/x"], ["runs/x", "mine.csv"]]
    words += [
        ["x.yaml", "mine.csv"],
        ["x.yaml", "bad.json"],
        ["x.yaml", "nowhere.csv"],
        ["x.yaml", "mine.csv", "--json"],
    ]
    for each in words:
        capsys.readouterr()
        assert run(["certify", *each]) == 2
        out, err = capsys.readouterr()
        assert f"family {family} cannot certify schedules" in err
        assert "these can: athans, vlambda, robust" in err
        assert out == ""
    assert run(["certify", "x.yaml"]) == 2


def test_compare_shows_errors_beside_their_numbers_and_every_fixed_sensor(capsys: Captured) -> None:
    assert run(["init", "hybrid", "x.yaml"]) == 0
    capsys.readouterr()
    assert run(["compare", "x.yaml", "--out", "c"]) == 0
    table = capsys.readouterr().out
    header, *rows = [line for line in table.splitlines() if line.strip() and "─" not in line][:-1]
    assert "average rms" in header and "standard error" not in header
    assert [row.split()[0] for row in rows][-2:] == ["fixed:ranger", "fixed:doppler"]
    assert all(row.count("±") == 4 for row in rows)
    assert run(["compare", "x.yaml", "--out", "c", "--json", "--methods", "fixed:doppler"]) == 0
    assert json.loads(capsys.readouterr().out)["methods"][0]["average_rms_standard_error"] > 0
    assert run(["compare", "x.yaml", "--methods", "fixed:dopler"]) == 2
    assert "did you mean 'doppler'?" in capsys.readouterr().err


def test_what_is_only_rounding_is_no_gap() -> None:
    assert percent(6.66e-16) == "0 %"
    assert percent(-6.66e-16) == "0 %"
    assert percent(1.5e-9) == "1.5e-07 %"
    assert percent(None) == "-"
    assert with_error(6.7938, 0.0921) == "6.7938 ± 0.092"
    assert with_error(6.7938, None) == with_error(6.7938, float("nan")) == "6.7938"


SELECTION = """
family: vlambda
horizon: {steps: 6, epoch: 3}
plant: {F: [[1, 0.1], [0, 1]], Q: {identity: 2}, initial: {covariance: {identity: 2}}}
sensors:
  - {name: one, H: [[1, 0]], R: 1}
  - {name: two, H: [[0, 1]], R: 1}
"""
ROVER = '  - {name: rover, H: [["p1", 1]], R: 1, location: {bounds: [[0, 1]], constraints: ["p1 + k - 2.5"]}}\n'


def test_a_schedule_that_is_wrong_only_for_the_epochs_is_named_by_its_file(capsys: Captured) -> None:
    Path("x.yaml").write_text(SELECTION)
    Path("mine.csv").write_text("start,end,sensors\n0,2,one\n2,6,two\n")
    assert run(["certify", "x.yaml", "mine.csv"]) == 3
    assert "mine.csv: the schedule changes inside of the epoch k = 0 .. 2" in capsys.readouterr().err
    Path("mine.csv").write_text("start,end,sensors\n0,3,one\n3,6,two\n")
    assert run(["certify", "x.yaml", "mine.csv"]) == 0
    assert "one, two" in capsys.readouterr().out


def test_a_sensor_that_has_nowhere_to_be_is_4_in_check_too(capsys: Captured) -> None:
    """p1 <= 2.5 - k leaves nothing in the box at k = 3."""
    Path("x.yaml").write_text(SELECTION + ROVER)
    for command in ("check", "solve"):
        assert run([command, "x.yaml"]) == 4
        assert "at k = 3 no location of sensor 'rover' satisfies its constraints" in capsys.readouterr().err
    assert run(["solve", "x.yaml", "--json"]) == 4
    assert json.loads(capsys.readouterr().out)["method"] == "eigenspace"
    Path("x.yaml").write_text(SELECTION + ROVER.replace("2.5", "3.5"))
    assert run(["check", "x.yaml"]) == 0
    out = capsys.readouterr().out
    assert "1 constraint" in out and "(s)" not in out

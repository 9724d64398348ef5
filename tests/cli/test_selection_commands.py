"""The commands on the families that choose sensors step by step: codes and messages that belong to these families."""

from __future__ import annotations

from pathlib import Path

import pytest

from occontrol.cli import run

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

"""Methods and options that do not belong: how the command line refuses them, before any work."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from occontrol.cli import run

Captured = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def nothing_is_solved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("occontrol.families.athans.family.AthansFamily.solve", None)


@pytest.mark.parametrize(
    ("option", "column", "said"),
    [
        ("dwell: 0", 36, "dwell of method round-robin is 0"),
        ("dwell: -3", 36, "dwell of method round-robin is -3"),
        ("relative_gap: -1", 43, "relative_gap of method round-robin is -1.0"),
    ],
)
def test_an_option_that_makes_no_sense_is_3_with_its_place(
    small_text: str, capsys: Captured, option: str, column: int, said: str
) -> None:
    lines = small_text.rstrip().split("\n")
    lines[-1] = f"method: {{name: round-robin, {option}}}"
    Path("p.yaml").write_text("\n".join(lines) + "\n")
    for command in (["solve", "p.yaml"], ["check", "p.yaml"], ["compare", "p.yaml"]):
        assert run(command) == 3
        assert capsys.readouterr().err.startswith(f"p.yaml:{len(lines)}:{column}: {said}\n  hint: a ")


def test_a_method_of_another_family_is_2_with_the_methods_of_this_one(small_file: Path, capsys: Captured) -> None:
    for command in (["solve", str(small_file), "-m", "optimal"], ["compare", str(small_file), "--methods", "optimal"]):
        assert run(command) == 2
        said = capsys.readouterr().err
        assert said.startswith("family athans has no method 'optimal'\n  hint: there are: schedule, hminimal, relaxed")


def test_an_argument_in_the_name_is_checked_too(capsys: Captured) -> None:
    assert run(["init", "hybrid"]) == 0 and run(["init", "robust"]) == 0
    assert run(["solve", "hybrid.yaml", "-m", "fixed:nobody"]) == 2
    assert "there is no sensor or group 'nobody'" in capsys.readouterr().err
    assert run(["solve", "robust.yaml", "-m", "fixed"]) == 3
    assert "a fixed schedule needs a sequence of 8 sensors" in capsys.readouterr().err


def test_the_package_is_a_program() -> None:
    for arguments, said in ((["--version"], "occontrol "), (["--help"], "Usage: occontrol")):
        command = [sys.executable, "-m", "occontrol", *arguments]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        assert said in done.stdout

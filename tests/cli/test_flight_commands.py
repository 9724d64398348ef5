"""export --to flight and --verify on the command line: files, words, exit codes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from occontrol.api import write_run
from occontrol.cli import run
from tests.files.flight.machine import needs_compiler


@pytest.fixture
def folder(tmp_path: Path, small_solution) -> Path:
    write_run(tmp_path / "two radars", small_solution.problem, small_solution)
    return tmp_path / "two radars"


def test_the_folder_holds_target_code_and_beside_it_what_is_for_the_host(folder: Path, capsys) -> None:
    assert run(["export", str(folder), "--to", "flight"]) == 0
    out = folder / "flight"
    assert sorted(p.name for p in out.iterdir()) == [
        "host", "oc_two_radars_filter.c", "oc_two_radars_filter.h", "oc_two_radars_tables.c",
    ]  # fmt: skip
    host = ["CMakeLists.txt", "MANIFEST.json", "Makefile", "README.md", "selftest.c", "vectors.h"]
    assert sorted(p.name for p in (out / "host").iterdir()) == host
    manifest = json.loads((out / "host" / "MANIFEST.json").read_text())
    assert manifest["options"] == {"precision": "double", "gains_only": False, "no_plan": False}
    assert manifest["run"] in (out / "oc_two_radars_filter.h").read_text()
    assert manifest["bytes"]["filter"] == 8 * (2 + 2 + 1 + 1 + 2)  # x, d, l, nis, two counters and a flag
    assert len(capsys.readouterr().out.splitlines()) == 9


@needs_compiler
def test_verify_compiles_and_compares(folder: Path, capsys) -> None:
    out = ["--out", str(folder.parent / "code"), "--prefix", "demo", "--precision", "single"]
    assert run(["export", str(folder), "--to", "flight", *out]) == 0
    capsys.readouterr()
    assert run(["export", str(folder), "--to", "flight", *out, "--verify"]) == 0
    text = capsys.readouterr().out
    assert "9 files are what the run gives" in text and "passed: " in text and "ns a step" in text
    tables = folder.parent / "code" / "demo_tables.c"
    tables.write_text(tables.read_text().replace("0.0F", "0.5F", 1))
    assert run(["export", str(folder), "--to", "flight", *out, "--verify"]) == 7
    text = capsys.readouterr().out
    assert "DIFFERENT from what the run gives: demo_tables.c" in text
    assert "FAILED: a table has changed since it was written" in text


def test_without_a_compiler_that_is_said(folder: Path, capsys, monkeypatch) -> None:
    assert run(["export", str(folder), "--to", "flight"]) == 0
    monkeypatch.setenv("PATH", "")
    assert run(["export", str(folder), "--to", "flight", "--verify"]) == 0
    text = capsys.readouterr().out
    assert "gcc, clang, cc, arm-linux-gnueabihf-gcc, qemu-arm: not found on this computer" in text
    assert "nothing: no compiler was found" in text


@pytest.mark.parametrize(
    "words, said",
    [
        (["--to", "flite"], "there is no format 'flite'\n  hint: did you mean 'flight'?"),
        (["--to", "flight", "--precision", "half"], "there is no precision 'half'\n  hint: there are: double, single"),
        (["--to", "flight", "--prefix", "2x"], "'2x' cannot begin the names of C functions"),
        (["--to", "flight", "--gains-only", "--no-plan"], "--gains-only and --no-plan leave nothing of the filter"),
        (["--to", "csv", "--gains-only"], "--to csv has no gains_only\n  hint: that is for --to flight"),
        (["--to", "csv", "--verify"], "there is nothing to verify in --to csv\n  hint: --verify is for --to flight"),
        (["--to", "flight", "--out", "RUN/current"], "lies where RUN keeps its results"),
    ],
)
def test_refusals(folder: Path, words: list[str], said: str, capsys) -> None:
    assert run(["export", str(folder), *[word.replace("RUN", str(folder)) for word in words]]) == 2
    assert said.replace("RUN", str(folder)) in capsys.readouterr().err

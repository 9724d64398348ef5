"""`report`: the page and the pictures again, the numbers as they are."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import occontrol
from occontrol.cli import run

Captured = pytest.CaptureFixture[str]


def one_picture(problem: object, solution: object) -> dict:
    from occontrol.files.figures.style import house_style, new_figure

    with house_style():
        figure = new_figure((4, 3), "one picture")
    figure.subplots().plot([1, 2], label="a")
    return {"overview": figure}


@pytest.fixture
def folder(tmp_path: Path, small_solution, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr("occontrol.api.pages.figures_of", one_picture)  # pictures have their own tests
    occontrol.write_run(tmp_path / "run", small_solution.problem, small_solution)
    return tmp_path / "run"


def test_the_page_is_drawn_again_and_the_numbers_stay(folder: Path, capsys: Captured) -> None:
    before = {name: (folder / name).read_bytes() for name in ("problem.json", "result.json", "arrays.npz")}
    origin = json.loads((folder / "provenance.json").read_text())
    for words in ([], ["--static"]):
        assert run(["report", str(folder), *words]) == 0
        assert capsys.readouterr().out == f"written  {folder}/report.html\n"
        assert {name: (folder / name).read_bytes() for name in before} == before
        text = (folder / "report.html").read_text()
        assert ('id="panels0"' in text) == (not words) and json.loads(before["result.json"])["digest"] in text
        now = json.loads((folder / "provenance.json").read_text())
        assert {k: v for k, v in now.items() if k != "files"} == {k: v for k, v in origin.items() if k != "files"}
        assert {"report.html", "figures/overview.png"} <= set(now["files"])
    occontrol.read_run(folder)
    # the next result takes all of it away
    assert run(["certify", str(folder), "--out", str(folder.with_name("other")), "--no-figures"]) == 0
    assert run(["solve", str(folder / "problem.json"), "--out", str(folder.with_name("other")), "--no-figures"]) == 0
    assert not (folder.with_name("other") / "report.html").exists()


def test_a_picture_that_cannot_be_drawn_changes_nothing(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert run(["report", str(folder), "--static"]) == 0
    before = (folder / "report.html").read_bytes()

    def broken(*_) -> dict:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("occontrol.api.pages.figures_of", broken)
    assert run(["report", str(folder)]) == 8
    assert (folder / "report.html").read_bytes() == before


def test_what_is_no_run_is_refused(folder: Path, tmp_path: Path, capsys: Captured) -> None:
    assert run(["report", str(tmp_path / "nowhere")]) == 8
    assert "nowhere: no such run folder" in capsys.readouterr().err
    shutil.copytree(folder, tmp_path / "broken", symlinks=True)
    (tmp_path / "broken" / "current" / "arrays.npz").write_bytes(b"")
    assert run(["report", str(tmp_path / "broken")]) == 3
    assert "arrays.npz is damaged" in capsys.readouterr().err
    assert not (tmp_path / "broken" / "report.html").exists()


def test_a_run_without_figures_loads_nothing_that_draws(small_file: Path) -> None:
    code = (
        "import sys\nfrom occontrol.cli import run\n"
        f"assert run(['solve', {str(small_file)!r}, '--out', {str(small_file.with_name('r'))!r}, '--no-figures', "
        "'--method', 'best-single']) == 0\n"
        "print([name for name in ('bokeh', 'matplotlib', 'PIL', 'jinja2') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"

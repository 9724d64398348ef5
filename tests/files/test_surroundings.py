"""Nothing outside of the run folder is created, changed or deleted, whatever the command, and however it ends."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

import occontrol.api
from occontrol.cli import run

ROOT = Path(__file__).resolve().parents[2]


def snapshot(folder: Path, but: Path | None = None) -> dict[str, tuple]:
    """Every name below a folder with kind, size, times and content; what lies in `but` is left out."""
    found: dict[str, tuple] = {}
    for path in sorted(folder.rglob("*")):
        if but is not None and (path == but or but in path.parents):
            continue
        state = path.lstat()
        content = os.readlink(path) if path.is_symlink() else ""
        if path.is_file() and not path.is_symlink():
            content = hashlib.sha256(path.read_bytes()).hexdigest()
        times = () if path.is_dir() else (state.st_mtime_ns, state.st_ctime_ns)
        found[str(path.relative_to(folder))] = (state.st_mode, state.st_ino, content, *times)
    return found


@pytest.fixture
def parent(tmp_path: Path, small_text: str) -> Path:
    """A folder with a problem file, a user's notes, a link, and other people's things around the run folder."""
    parent = tmp_path / "parent"
    (parent / "beside" / "deep").mkdir(parents=True)
    (parent / "p.yaml").write_text(small_text.replace("schedule, relative_gap: 1.0e-4", "greedy"))
    (parent / "beside" / "notes.txt").write_text("mine")
    (parent / "beside" / "deep" / "result.json").write_text("{}")
    (parent / "link").symlink_to(parent / "beside")
    (parent / ".runs").mkdir()
    (parent / ".runs" / "lock").write_text("not yours")
    return parent


def pictures(stage: Path, problem: object, solution: object, content: object) -> None:
    """A report as small as one can be: it is the place of pictures that is asked for here, not what is on them."""
    (stage / "figures").mkdir()
    (stage / "figures" / "one.png").write_bytes(b"picture")
    (stage / "report.html").write_text("report")


def test_only_the_run_folder_changes(parent: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(parent)
    monkeypatch.setattr(occontrol.api, "write_report", pictures)
    folder, problem = parent / "run", str(parent / "p.yaml")
    before = snapshot(parent)
    for figures in ("--no-figures", "--figures", "--no-figures"):  # the third removes the first
        assert run(["solve", problem, "--out", str(folder), figures]) == 0
        assert snapshot(parent, folder) == before
        assert (folder / "figures" / "one.png").exists() == (figures == "--figures")
    assert run(["solve", problem, "--out", str(folder), "--method", "random", "--resume", "--no-figures"]) == 0
    for words in (
        ["certify", problem, str(folder)], ["certify", str(folder)], ["show", str(folder)], ["check", problem],
        ["export", str(folder), "--to", "csv"],
        ["simulate", problem, "--run", str(folder), "--out", str(folder / "m.csv")],
        ["filter", str(folder), str(folder / "m.csv"), "--out", str(folder / "e.csv"), "--no-figures"],
    ):  # fmt: skip
        assert run(words) == 0, words
        assert snapshot(parent, folder) == before, words


def test_what_fails_changes_nothing_at_all(parent: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(parent)
    (parent / "bad.yaml").write_text("family: athans\n")
    problem, before = str(parent / "p.yaml"), snapshot(parent)
    for words, code in (
        (["solve", str(parent / "bad.yaml"), "--out", str(parent / "run")], 3),
        (["solve", problem, "--out", str(parent / "beside" / "notes.txt")], 8),
        (["solve", problem, "--method", "nobody", "--out", str(parent / "run")], 2),
        (["export", str(parent / "beside"), "--to", "csv"], 3),
        (["simulate", problem, "--out", problem], 2),
        (["certify", problem, str(parent / "beside" / "notes.txt")], 3),
    ):
        got = run(words)
        assert snapshot(parent) == before, words
        assert got == code, words


def test_a_killed_solve_leaves_its_surroundings_alone(parent: Path) -> None:
    folder, before = parent / "run", snapshot(parent)
    child = subprocess.Popen(
        [sys.executable, "-c", "from occontrol.cli import main; main()", "solve", str(parent / "p.yaml"), "--out",
         str(folder), "--no-figures"],
        env={**os.environ, "PYTHONPATH": str(ROOT)}, cwd=parent, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    while child.poll() is None and not (folder / ".runs").exists():
        pass
    child.kill()
    child.wait()
    assert snapshot(parent, folder) == before

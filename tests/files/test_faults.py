"""A short form of scripts/campaign_faults.py, and what that campaign does not count: links, locks, better results."""

from __future__ import annotations

import dataclasses
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from occontrol.api import document, read_run, write_run
from occontrol.cli import run
from occontrol.core.errors import FileAccessError, ProblemError
from occontrol.core.solution import Solution, Status
from occontrol.files.atomic import replacing, write_text
from occontrol.files.run_folder import RESULT, locked, place_run
from occontrol.files.run_record import PROVENANCE

SCRIPT = Path(__file__).resolve().parents[2] / "scripts" / "campaign_faults.py"


@pytest.mark.slow
def test_a_short_campaign_of_faults() -> None:
    """In a process of its own: the campaign also looks at the memory that it took."""
    counts = ["--kills", "6", "--contests", "1", "--starts", "1", "--signals", "0", "--mutants", "40"]
    done = subprocess.run([sys.executable, str(SCRIPT), *counts], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def with_gap(solution: Solution, status: Status, gap: float) -> Solution:
    """The same solution, ended otherwise, with another gap."""
    top = dataclasses.replace(solution.numbers.top, relative_gap=gap)
    numbers = dataclasses.replace(solution.numbers, relative_gap=gap, top=top)
    return dataclasses.replace(solution, status=status, numbers=numbers)


def test_an_interrupted_result_never_replaces_a_better_one(tmp_path: Path, small_solution: Solution) -> None:
    text = document(small_solution.problem)
    first = with_gap(small_solution, Status.CERTIFIED, 7e-5)
    assert place_run(tmp_path, text, first).folder == tmp_path
    placed = place_run(tmp_path, text, with_gap(small_solution, Status.INTERRUPTED, 0.39))
    assert placed.folder == tmp_path / "interrupted"
    assert placed.remark == f"{tmp_path} keeps its certified result with a gap of 0.007 %"
    assert read_run(tmp_path)[1].status is Status.CERTIFIED
    assert read_run(tmp_path / "interrupted")[1].status is Status.INTERRUPTED
    worse = place_run(tmp_path, text, with_gap(small_solution, Status.LIMIT, 0.5))
    assert worse.folder is None and "interrupted keeps its with a gap of 39 %" in worse.remark
    assert place_run(tmp_path, text, first).folder == tmp_path
    assert not (tmp_path / "interrupted").exists()


def test_a_better_interrupted_result_replaces_a_worse_one(tmp_path: Path, small_solution: Solution) -> None:
    text = document(small_solution.problem)
    place_run(tmp_path, text, with_gap(small_solution, Status.INTERRUPTED, 0.3))
    assert place_run(tmp_path, text, with_gap(small_solution, Status.INTERRUPTED, 0.1)).folder == tmp_path
    assert place_run(tmp_path, text, with_gap(small_solution, Status.INTERRUPTED, 0.2)).folder != tmp_path


def test_another_problems_complete_result_gives_way_to_complete_ones_only(
    tmp_path: Path, small_solution: Solution
) -> None:
    text = document(small_solution.problem)
    place_run(tmp_path, text, small_solution)
    other = {**text, "select": 1, "name": "other", "objective": {**text["objective"], "cost_weight": 0.2}}
    placed = place_run(tmp_path, other, with_gap(small_solution, Status.INTERRUPTED, 1e-9))
    assert placed.folder == tmp_path / "interrupted" and "another problem" in placed.remark
    assert place_run(tmp_path, other, small_solution).folder == tmp_path
    named = {**text, "name": "renamed", "method": {"name": "greedy"}}
    assert (
        place_run(tmp_path / "x", text, small_solution).content["digest"]
        == (place_run(tmp_path / "y", named, small_solution).content["digest"])
    )


def test_same_run_same_bytes(tmp_path: Path, small_solution: Solution) -> None:
    for name in "ab":
        write_run(tmp_path / name, small_solution.problem, small_solution)
    for name in ("problem.json", "arrays.npz", RESULT):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    origin = json.loads((tmp_path / "a" / PROVENANCE).read_text())
    assert {"machine", "blas", "threads", "command", "start", "end", "files"} <= origin.keys()


def test_only_what_was_written_is_deleted_and_no_link_is_followed(tmp_path: Path, small_solution: Solution) -> None:
    """The record of a received run names a user's file, through a link, and files outside of the folder."""
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "precious.png").write_text("precious")
    folder = tmp_path / "run"
    write_run(folder, small_solution.problem, small_solution)
    (folder / "notes.txt").write_text("mine")
    (folder / ".runs" / "1" / "figures").symlink_to(outside)
    kept = folder / ".runs" / "1" / RESULT
    content = json.loads(kept.read_text())
    digest = "sha256:" + __import__("hashlib").sha256(b"precious").hexdigest()
    content["files"] |= {"figures/precious.png": digest, "../outside/precious.png": digest, "notes.txt": digest}
    kept.write_text(json.dumps(content))
    for _ in range(3):  # the first run is the previous one, then it is removed
        write_run(folder, small_solution.problem, small_solution)
    assert not (folder / ".runs" / "1" / RESULT).exists()
    assert (outside / "precious.png").read_text() == "precious" and (folder / "notes.txt").read_text() == "mine"


@pytest.mark.parametrize("name", ["figures", ".incoming", ".runs", "current", "result.json", "interrupted"])
def test_a_link_at_our_places_is_refused(tmp_path: Path, small_solution: Solution, name: str) -> None:
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "x").write_text("x")
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / name).symlink_to(outside)
    with pytest.raises(FileAccessError, match="occontrol"):
        write_run(folder, small_solution.problem, small_solution)
    assert [p.name for p in outside.iterdir()] == ["x"]


def test_a_link_in_a_received_run_folder_that_leads_out_is_refused(tmp_path: Path, small_solution: Solution) -> None:
    write_run(tmp_path / "run", small_solution.problem, small_solution)
    secret = tmp_path / "secret.json"
    secret.write_text("{}")
    kept = tmp_path / "run" / ".runs" / "1" / RESULT
    kept.unlink()
    kept.symlink_to(secret)
    with pytest.raises(ProblemError, match="leads out of the run folder"):
        read_run(tmp_path / "run")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes")
def test_a_pipe_in_a_run_folder_is_not_read(tmp_path: Path, small_solution: Solution) -> None:
    write_run(tmp_path, small_solution.problem, small_solution)
    kept = tmp_path / ".runs" / "1" / "arrays.npz"
    kept.unlink()
    os.mkfifo(kept)
    with pytest.raises(ProblemError, match="not an ordinary file"):
        read_run(tmp_path)


def test_a_folder_in_use_is_refused_before_any_work_and_a_stale_lock_is_not(
    tmp_path: Path, small_file: Path, small_solution: Solution, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "run"
    code = "import sys, pathlib; from occontrol.files.run_lock import locked\nwith locked(pathlib.Path(sys.argv[1])):"
    code += "\n print('in', flush=True); sys.stdin.read()"
    child = subprocess.Popen(
        [sys.executable, "-c", code, str(folder)], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(SCRIPT.parents[1])},
    )  # fmt: skip
    assert child.stdout is not None and child.stdout.readline() == b"in\n"
    assert run(["solve", str(small_file), "--out", str(folder)]) == 8
    assert f"{folder}: in use by pid {child.pid}" in capsys.readouterr().err
    child.kill()
    child.wait()
    write_run(folder, small_solution.problem, small_solution)
    assert read_run(folder)[1].cost == small_solution.cost


def test_a_lock_without_a_result_leaves_nothing(tmp_path: Path) -> None:
    with locked(tmp_path / "deep" / "run"):
        assert (tmp_path / "deep" / "run").is_dir()
    assert list(tmp_path.iterdir()) == []


def test_a_run_folder_of_the_first_edition_is_read_and_replaced(tmp_path: Path, small_solution: Solution) -> None:
    write_run(tmp_path / "new", small_solution.problem, small_solution)
    old = tmp_path / "old"
    old.mkdir()
    for name in ("problem.json", "arrays.npz", RESULT):
        (old / name).write_bytes((tmp_path / "new" / name).read_bytes())
    assert read_run(old)[1].cost == small_solution.cost
    (old / "mine.txt").write_text("mine")
    write_run(old, small_solution.problem, small_solution)
    assert read_run(old)[1].cost == small_solution.cost
    assert sorted(p.name for p in old.iterdir() if p.name not in (".runs", "current")) == [
        "arrays.npz", "mine.txt", "problem.json", "provenance.json", RESULT,
    ]  # fmt: skip


def test_a_file_that_the_user_put_in_our_place_is_kept(tmp_path: Path, small_solution: Solution) -> None:
    (tmp_path / "problem.json").write_text("mine")
    write_run(tmp_path, small_solution.problem, small_solution)
    assert (tmp_path / "problem.json.old").read_text() == "mine"
    assert read_run(tmp_path)[1].cost == small_solution.cost


def test_an_unfinished_write_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    write_text(tmp_path / "x", "old")
    with pytest.raises(FileAccessError, match="No space left"), replacing(tmp_path / "x") as file:
        file.write(b"new")
        raise OSError(28, "No space left on device")
    assert (tmp_path / "x").read_text() == "old" and [p.name for p in tmp_path.iterdir()] == ["x"]
    (tmp_path / ".y.writing-1-00000000-00000000").write_text("left by another boot")
    (tmp_path / ".y.writing-mine").write_text("a user's")
    write_text(tmp_path / "x", "new")
    assert sorted(p.name for p in tmp_path.iterdir()) == [".y.writing-mine", "x"]


def test_a_link_is_replaced_and_not_written_through(tmp_path: Path) -> None:
    (tmp_path / "theirs").write_text("theirs")
    (tmp_path / "x").symlink_to(tmp_path / "theirs")
    write_text(tmp_path / "x", "mine")
    assert (tmp_path / "theirs").read_text() == "theirs" and (tmp_path / "x").read_text() == "mine"


def test_output_over_input_is_refused(
    tmp_path: Path, small_file: Path, small_solution: Solution, capsys: pytest.CaptureFixture[str]
) -> None:
    write_run(tmp_path / "run", small_solution.problem, small_solution)
    samples = tmp_path / "m.csv"
    samples.write_text("t,sensor,z1\n0.1,range,0.5\n")
    (tmp_path / "alias.csv").hardlink_to(samples)
    before = small_file.read_bytes()
    for words in (
        ["simulate", small_file, "--out", small_file],
        ["filter", tmp_path / "run", samples, "--out", samples],
        ["filter", tmp_path / "run", samples, "--out", tmp_path / "alias.csv"],
        ["filter", tmp_path / "run", samples, "--out", tmp_path / "run" / "result.json"],
        ["export", tmp_path / "run", "--to", "npz", "--out", tmp_path / "run" / "arrays.npz"],
        ["export", tmp_path / "run", "--to", "csv", "--out", tmp_path / "run" / ".runs" / "1"],
        ["solve", tmp_path / "run" / "problem.json", "--out", tmp_path / "run"],
        ["solve", small_file, "--log", small_file, "--out", tmp_path / "other"],
    ):
        assert run([str(word) for word in words]) == 2, words
        assert "hint: name another output" in capsys.readouterr().err
    assert small_file.read_bytes() == before and samples.read_text().startswith("t,sensor")
    assert read_run(tmp_path / "run")[1].cost == small_solution.cost


@pytest.mark.parametrize("name", ["../x", "/tmp/x", "a/b", "é", "file", "", "a" * 65, "1a"])
def test_names_of_arrays_never_become_paths(tmp_path: Path, small_solution: Solution, name: str, capsys) -> None:
    import hashlib

    write_run(tmp_path / "run", small_solution.problem, small_solution)
    kept = tmp_path / "run" / ".runs" / "1"
    arrays = {"extra": np.zeros(3), **small_solution.arrays}
    arrays[name] = arrays.pop("extra")
    import zipfile

    with zipfile.ZipFile(kept / "arrays.npz", "w") as archive:
        for each, value in arrays.items():
            with archive.open(f"{each}.npy", "w") as file:
                np.lib.format.write_array(file, value)
    content = json.loads((kept / RESULT).read_text())
    content["files"]["arrays.npz"] = "sha256:" + hashlib.sha256((kept / "arrays.npz").read_bytes()).hexdigest()
    (kept / RESULT).write_text(json.dumps(content))
    for format in ("csv", "npz", "c", "mat", "json"):
        assert run(["export", str(tmp_path / "run"), "--to", format, "--out", str(tmp_path / "out")]) == 3
        assert name in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_lock_whose_owner_has_not_yet_written_its_number_is_waited_for(tmp_path: Path, monkeypatch) -> None:
    """The number comes a moment after the lock: the message names the owner all the same, and never a dead one."""
    import fcntl

    from occontrol.files import run_lock

    (tmp_path / ".runs").mkdir()
    path = tmp_path / ".runs" / "lock"
    path.write_text("999999999 00000000\n")  # of a process that is no more
    waited: list[float] = []
    with open(path, "r+b", buffering=0) as other:
        fcntl.flock(other, fcntl.LOCK_EX)

        def pause(seconds: float) -> None:
            waited.append(seconds)
            if len(waited) == 3:
                other.truncate(0)
                os.pwrite(other.fileno(), f"{os.getpid()} {run_lock.boot()}\n".encode(), 0)

        monkeypatch.setattr(run_lock.time, "sleep", pause)
        with pytest.raises(FileAccessError, match=f"in use by pid {os.getpid()}"), locked(tmp_path):
            pass
    assert len(waited) == 3

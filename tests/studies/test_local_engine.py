"""Processes of this machine: each task once, failures kept, a dead worker costs its own task one try."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import occontrol as oc
from occontrol.studies import read_study
from occontrol.studies.engines import local
from occontrol.studies.engines.local import run_here
from occontrol.studies.folder import StudyFolder
from occontrol.studies.queue import TaskQueue
from occontrol.studies.run_task import run_task
from occontrol.studies.tasks import plan
from tests.studies.study_texts import VARY, write_study


def prepared(folder: Path, text: str = VARY) -> StudyFolder:
    """A study's folder with its tasks, nothing done."""
    study = read_study(write_study(folder, text))
    found = StudyFolder(study.folder)
    found.write(study, plan(study))
    return found


def finished(study: Path) -> list[Path]:
    """Its results; what a killed worker left half written may stay until the system forgets the process."""
    return sorted(p for p in (study / "results").iterdir() if not p.name.startswith("."))


def sweep(path: Path, *words: str) -> subprocess.CompletedProcess:
    """`occontrol sweep` in a process of its own."""
    line = [sys.executable, "-m", "occontrol", "sweep", str(path), *words]
    return subprocess.run(line, capture_output=True, text=True, timeout=300)


def test_each_result_is_what_solve_finds(tmp_path: Path) -> None:
    folder = prepared(tmp_path)
    _, entries = folder.read()
    for entry in entries:
        assert run_task(str(folder.path), entry.identity) == ""
        problem, solution = oc.read_run(folder.result_folder(entry.identity))
        again = oc.solve(oc.read_problem(folder.task_file(entry.identity)))
        assert problem.cost_weight == entry.point["objective.cost_weight"]
        assert solution.cost == again.cost
        np.testing.assert_array_equal(solution.schedule.weights, again.schedule.weights)


def test_a_failed_task_keeps_its_words_and_is_tried_three_times(tmp_path: Path, monkeypatch) -> None:
    folder = prepared(tmp_path)
    _, entries = folder.read()
    folder.task_file(entries[0].identity).write_text("{", encoding="utf-8")
    progress = run_here(folder, entries[:2], 2)
    assert (progress.done, progress.failed) == (1, 1)
    said = folder.failures(entries[0].identity)
    assert len(said) == 3 and all("JSON" in words for words in said)
    assert folder.missing(entries[:1]) == []


def test_what_has_failed_is_tried_behind_all_others(tmp_path: Path) -> None:
    folder = prepared(tmp_path)
    _, entries = folder.read()
    for entry, times in ((entries[0], 2), (entries[1], 1)):
        for _ in range(times):
            folder.failed(entry.identity, "killed")
    queue, order = TaskQueue(folder, folder.missing(entries)), []
    while (entry := queue.take()) is not None:
        order.append(entry.identity)
    assert order == [e.identity for e in (*entries[2:], entries[1], entries[0])]


@pytest.mark.slow
def test_a_killed_worker_costs_its_task_one_try_and_no_other_anything(tmp_path: Path) -> None:
    folder = prepared(tmp_path)
    _, entries = folder.read()
    killed: list[int] = []
    made = local._new_place

    def place():
        found = made()
        if not killed:
            found.pid.add_done_callback(lambda done: (killed.append(done.result()), os.kill(done.result(), 9)))
        return found

    local._new_place = place
    try:
        progress = run_here(folder, entries, 1)
    finally:
        local._new_place = made
    assert killed and progress.done == len(entries) and progress.failed == 0
    assert [p.name for p in (folder.path / "failures").iterdir()] == []


@pytest.mark.slow
def test_a_task_that_takes_too_long_fails_and_says_so(tmp_path: Path) -> None:
    folder = prepared(tmp_path)
    _, entries = folder.read()
    progress = run_here(folder, entries[:1], 1, timeout=1e-3)
    assert progress.failed == 1
    assert folder.failures(entries[0].identity) == ["took longer than task_timeout, 0.001 s"] * 3


@pytest.mark.slow
def test_the_table_is_the_same_whatever_the_number_of_workers_and_who_was_killed(tmp_path: Path) -> None:
    tables = []
    for name, jobs in (("one", 1), ("two", 2)):
        path = write_study(tmp_path, VARY, name=name)
        if jobs == 2:
            process = subprocess.Popen([sys.executable, "-m", "occontrol", "sweep", str(path), "-j", "2"])
            deadline = time.monotonic() + 60
            results = tmp_path / name / "results"
            while time.monotonic() < deadline and not (results.is_dir() and any(results.iterdir())):
                time.sleep(0.02)
            process.send_signal(signal.SIGKILL)
            process.wait()
        done = sweep(path, "--jobs", str(jobs), "--no-figures")
        assert done.returncode == 0, done.stderr
        text = (tmp_path / name / "table.csv").read_bytes()
        tables.append(text)
        assert len(finished(tmp_path / name)) == 6
    assert tables[0] == tables[1]
    arrays = [
        {p.name: (p / "arrays.npz").read_bytes() for p in finished(tmp_path / name)}
        for name in ("one", "two")
    ]
    assert arrays[0] == arrays[1]


@pytest.mark.slow
def test_exit_codes_and_what_is_left(tmp_path: Path) -> None:
    path = write_study(tmp_path)
    assert sweep(path, "--status").returncode == 8
    folder = prepared(tmp_path)
    _, entries = folder.read()
    run_here(folder, entries[:2], 1)
    left = sweep(path, "--status", "--json")
    assert left.returncode == 5
    told = json.loads(left.stdout)
    assert (told["tasks"], told["done"], told["left"], told["failed"]) == (6, 2, 4, 0)
    for k in range(3):
        folder.failed(entries[5].identity, f"try {k}")
    done = sweep(path, "--jobs", "2")
    assert done.returncode == 6 and f"{entries[5].identity} failed: try 2" in done.stderr
    rows = json.loads((folder.path / "table.json").read_text())["rows"]
    assert [row["status"] for row in rows] == ["certified"] * 5 + ["failed"]
    assert sweep(path, "--retry", "--jobs", "1").returncode == 0
    pictures = {p.name for p in (folder.path / "figures").iterdir()}
    assert pictures == {"lines.png", "front.png"}


def test_a_changed_problem_never_meets_old_results(tmp_path: Path) -> None:
    folder = prepared(tmp_path)
    _, before = folder.read()
    run_here(folder, before[:1], 1)
    assert folder.done(before[0].identity)
    text = (tmp_path / "base.yaml").read_text()
    study = read_study(tmp_path / "study.yaml")
    (tmp_path / "base.yaml").write_text(text.replace("end: 4", "end: 5"))
    folder.write(study, plan(study))
    _, after = folder.read()
    assert not any(folder.done(e.identity) for e in after)
    (tmp_path / "base.yaml").write_text(text)
    folder.write(study, plan(study))
    assert folder.done(folder.read()[1][0].identity)

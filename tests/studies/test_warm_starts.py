"""Warm starts along an axis: rows in their order, the same bytes whoever does what, parts that keep rows together."""

from __future__ import annotations

from pathlib import Path

import pytest

from occontrol.core.errors import ProblemError
from occontrol.studies import read_study
from occontrol.studies.engines.local import run_here
from occontrol.studies.folder import Entry, StudyFolder
from occontrol.studies.queue import TaskQueue, part_of
from occontrol.studies.run_task import run_task
from occontrol.studies.tasks import plan
from tests.studies.study_texts import BASE, VARY, write_study

WARM = VARY + "warm_start: objective.cost_weight\n"


def prepared(folder: Path, text: str = WARM) -> StudyFolder:
    """A study's folder with its tasks, nothing done."""
    folder.mkdir(exist_ok=True)
    study = read_study(write_study(folder, text))
    found = StudyFolder(study.folder)
    found.write(study, plan(study))
    return found


def test_every_point_starts_at_the_one_before_it_in_its_row(tmp_path: Path) -> None:
    entries = prepared(tmp_path).read()[1]
    cold = prepared(tmp_path / "cold", VARY).read()[1]
    assert [e.start for e in cold] == [None] * 6
    by_noise = [entries[:3], entries[3:]]
    for row in by_noise:
        assert [e.start for e in row] == [None, row[0].identity, row[1].identity]
    # the first of a row is the same task as without warm starts, the others are tasks of their own
    same = {e.identity for e in entries} & {e.identity for e in cold}
    assert same == {row[0].identity for row in by_noise}


def test_the_results_do_not_depend_on_who_does_them(tmp_path: Path) -> None:
    alone = prepared(tmp_path / "alone")
    entries = alone.read()[1]
    for entry in entries:
        assert run_task(str(alone.path), entry.identity, entry.start) == ""
    shared = prepared(tmp_path / "shared")
    progress = run_here(shared, entries, 2)
    assert progress.done == len(entries)
    for entry in entries:
        one, other = (f.result_folder(entry.identity) / "arrays.npz" for f in (alone, shared))
        assert one.read_bytes() == other.read_bytes()


def test_a_warm_result_is_proven_as_a_cold_one_is(tmp_path: Path) -> None:
    import occontrol as oc

    folder = prepared(tmp_path)
    entries = folder.read()[1]
    for entry in entries:
        run_task(str(folder.path), entry.identity, entry.start)
        warm = oc.read_run(folder.result_folder(entry.identity))[1].certificate
        cold = oc.solve(oc.read_problem(folder.task_file(entry.identity))).certificate
        assert warm.cost >= cold.lower_bound and cold.cost >= warm.lower_bound
        assert abs(warm.lower_bound - cold.lower_bound) <= 1e-3 * cold.cost


def test_what_waits_for_a_task_that_failed_for_good_begins_cold(tmp_path: Path) -> None:
    folder = prepared(tmp_path)
    row = folder.read()[1][:2]
    queue = TaskQueue(folder, row)
    assert queue.take() == row[0] and queue.take() is None and len(queue) == 1
    for _ in range(3):
        folder.failed(row[0].identity, "no")
    assert queue.take() == row[1]
    assert run_task(str(folder.path), row[1].identity, row[1].start) == ""
    queue.again(row[1])
    queue.again(row[0], first=True)
    assert queue.take() == row[0]


def test_parts_keep_rows_together_and_share_them_out() -> None:
    def name(i: int) -> str:
        return f"{i:016x}"

    entries = [Entry(name(i), {}, None, name(i - 1) if i % 3 else None) for i in range(12)]  # four rows of three
    parts = [part_of(entries, i, 2) for i in range(2)]
    assert [len(p) for p in parts] == [6, 6] and sorted(parts[0] + parts[1], key=entries.index) == entries
    for part in parts:
        known = {e.identity for e in part}
        assert all(e.start is None or e.start in known for e in part)
    single = [Entry(name(i), {}, None) for i in range(7)]
    assert [len(part_of(single, i, 3)) for i in range(3)] == [3, 2, 2]


@pytest.mark.parametrize(
    ("text", "base", "words"),
    [
        (VARY + "warm_start: plant.A\n", BASE, "plant.A does not vary"),
        (
            "base: base.yaml\nvary: {method.accuracy: [0.1]}\nwarm_start: method.accuracy\n",
            "precision",
            "always begins anew",
        ),
    ],
)
def test_refusals(tmp_path: Path, text: str, base: str, words: str) -> None:
    if base == "precision":
        base = (Path(__file__).parents[2] / "occontrol/families/precision/template.yaml").read_text(encoding="utf-8")
    with pytest.raises(ProblemError, match=words) as caught:
        plan(read_study(write_study(tmp_path, text, base)))
    assert "study.yaml:" in str(caught.value)

"""Run folders: written all or nothing, read back to the identical numbers, damage named."""

from __future__ import annotations

import dataclasses
import json
import os
import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from occontrol.api import read_run, write_run
from occontrol.core.errors import FileAccessError, ProblemError
from occontrol.core.result import PlainResult
from occontrol.core.solution import Solution
from occontrol.files import run_store
from occontrol.files.plain_json import to_json
from occontrol.files.received_arrays import read_arrays
from occontrol.files.run_folder import ARRAYS, PROBLEM, RESULT

Damage = Callable[[Path], object]


def other(solution: Solution) -> Solution:
    """A result that differs in its file of arrays and in its cost."""
    arrays = {**solution.arrays, "switching": solution.arrays["switching"] + 1}
    numbers = dataclasses.replace(solution.numbers, cost=solution.cost + 1)
    return dataclasses.replace(solution, arrays=arrays, numbers=numbers)


def visible(folder: Path) -> list[str]:
    """What a user sees, but for the link that switches."""
    return sorted(p.name for p in folder.iterdir() if p.name not in (".runs", "current"))


def test_a_run_reads_back_to_the_identical_numbers(tmp_path: Path, small_solution: Solution) -> None:
    content = write_run(tmp_path / "deep" / "run", small_solution.problem, small_solution)
    problem, back = read_run(tmp_path / "deep" / "run")
    assert back.cost == small_solution.cost
    assert back.certificate == small_solution.certificate
    assert back.arrays.keys() == small_solution.arrays.keys()
    for name, array in small_solution.arrays.items():
        assert np.array_equal(back.arrays[name], array) and back.arrays[name].dtype == array.dtype
    assert back.schedule is not None and back.schedule.segments() == small_solution.result["schedule"]
    recorded = {"files": content["files"], "digest": content["digest"]}
    assert json.loads(to_json({**back.as_dict(), **recorded})) == json.loads(to_json(content))
    assert back.problem is problem


def test_the_problem_in_the_folder_costs_the_same(tmp_path: Path, small_solution: Solution) -> None:
    import occontrol

    write_run(tmp_path / "run", small_solution.problem, small_solution)
    problem, back = read_run(tmp_path / "run")
    assert back.schedule is not None
    assert occontrol.certify(problem, back.schedule).cost == pytest.approx(small_solution.cost, rel=1e-12)


def test_solutions_are_plain_data_that_pickle(small_solution: Solution) -> None:
    assert pickle.loads(pickle.dumps(small_solution)).cost == small_solution.cost


def test_the_same_arrays_make_the_same_bytes(tmp_path: Path, small_solution: Solution) -> None:
    for name in "ab":
        write_run(tmp_path / name, small_solution.problem, small_solution)
    assert (tmp_path / "a" / ARRAYS).read_bytes() == (tmp_path / "b" / ARRAYS).read_bytes()


def test_not_a_number_becomes_null(tmp_path: Path, small_solution: Solution) -> None:
    numbers = PlainResult({**small_solution.result, "lower_bound": float("-inf"), "odd": [float("nan"), np.float64(1)]})
    write_run(tmp_path, small_solution.problem, dataclasses.replace(small_solution, numbers=numbers))
    content = json.loads((tmp_path / RESULT).read_text(), parse_constant=pytest.fail)
    assert content["lower_bound"] is None and content["odd"] == [None, 1.0]
    assert read_run(tmp_path)[1].certificate is None


def test_files_of_the_user_stay_where_they_are(tmp_path: Path, small_solution: Solution) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "figures").mkdir()
    (tmp_path / "figures" / "mine.png").write_text("mine too")
    for solution in (small_solution, other(small_solution)):
        write_run(tmp_path, small_solution.problem, solution)
        assert read_run(tmp_path)[1].cost == solution.cost
    assert (tmp_path / "notes.txt").read_text() == "mine"
    assert (tmp_path / "figures" / "mine.png").read_text() == "mine too"
    assert visible(tmp_path) == ["arrays.npz", "figures", "notes.txt", PROBLEM, "provenance.json", RESULT]


def test_pictures_of_an_earlier_result_go_with_it(tmp_path: Path, small_solution: Solution) -> None:
    def draw(folder: Path, content: dict) -> None:
        (folder / "figures").mkdir()
        (folder / "figures" / "convergence.png").write_text("a picture")

    write_run(tmp_path, small_solution.problem, small_solution, draw)
    (tmp_path / "figures" / "mine.png").write_text("mine")
    write_run(tmp_path, small_solution.problem, other(small_solution))
    assert [p.name for p in (tmp_path / "figures").iterdir()] == ["mine.png"]


def test_an_earlier_result_stays_when_the_new_one_cannot_be_completed(tmp_path: Path, small_solution: Solution) -> None:
    write_run(tmp_path, small_solution.problem, small_solution)

    def fail(folder: Path, content: dict) -> None:
        raise OSError(28, "No space left on device")

    with pytest.raises(FileAccessError, match="No space left"):
        write_run(tmp_path, small_solution.problem, other(small_solution), fail)
    assert read_run(tmp_path)[1].cost == small_solution.cost
    assert visible(tmp_path) == ["arrays.npz", PROBLEM, "provenance.json", RESULT]
    assert sorted(p.name for p in (tmp_path / ".runs").iterdir()) == ["1", "lock"]


def test_a_writer_killed_at_any_rename_leaves_one_whole_result(
    tmp_path: Path, small_solution: Solution, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Killed(BaseException):
        pass

    for moves in range(9):
        folder = tmp_path / str(moves)
        write_run(folder, small_solution.problem, small_solution)
        done = 0

        def dying(function):
            def move(source: Path, target: Path) -> None:
                nonlocal done
                if done == moves:  # noqa: B023
                    raise Killed
                done += 1
                function(source, target)

            return move

        with monkeypatch.context() as patch:
            patch.setattr(run_store.os, "replace", dying(os.replace))
            patch.setattr(run_store.os, "rename", dying(os.rename))
            try:
                write_run(folder, small_solution.problem, other(small_solution))
            except Killed:
                pass
        shown = read_run(folder)[1].cost
        assert shown in (small_solution.cost, small_solution.cost + 1)
        assert json.loads((folder / RESULT).read_text())["cost"] == shown
        write_run(folder, small_solution.problem, small_solution)
        assert read_run(folder)[1].cost == small_solution.cost
        assert not [p for p in folder.rglob("*") if ".writing-" in p.name]
        assert len([p for p in (folder / ".runs").iterdir() if p.is_dir()]) <= 2


def truncate(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-40])


def change_the_cost_weight(path: Path) -> None:
    path.write_text(path.read_text().replace('"cost_weight": 0.1', '"cost_weight": 0.2'))


DAMAGES: list[tuple[str, Damage, str]] = [
    (RESULT, Path.unlink, "result.json is missing"),
    (PROBLEM, Path.unlink, "problem.json is missing"),
    (ARRAYS, Path.unlink, "arrays.npz is missing"),
    (RESULT, truncate, "not a complete JSON file"),
    (RESULT, lambda p: p.write_bytes(b"\xff\x00\xfe"), "not a text file"),
    (RESULT, lambda p: p.write_text("[]"), "not the result of a run"),
    (RESULT, lambda p: p.write_text(p.read_text().replace('"certified"', '"perfect"')), "unknown status 'perfect'"),
    (RESULT, lambda p: p.write_text(p.read_text().replace('"cost": ', '"cost": NaN, "was": ', 1)), "holds NaN"),
    (PROBLEM, truncate, "problem.json is damaged, or does not belong"),
    (PROBLEM, change_the_cost_weight, "problem.json is damaged, or does not belong"),
    (ARRAYS, truncate, "arrays.npz is damaged, or does not belong"),
]


@pytest.mark.parametrize(("name", "damage", "words"), DAMAGES)
def test_damage_is_named(tmp_path: Path, small_solution: Solution, name: str, damage: Damage, words: str) -> None:
    write_run(tmp_path, small_solution.problem, small_solution)
    damage(tmp_path / name)
    with pytest.raises(ProblemError) as caught:
        read_run(tmp_path)
    assert words in str(caught.value) and str(tmp_path) in str(caught.value)


def test_arrays_that_hold_python_objects_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "x.npz", a=np.array([{}], dtype=object))
    with pytest.raises(ProblemError, match=r"not a readable \.npz file"):
        read_arrays(open(tmp_path / "x.npz", "rb"), "x.npz")


def test_a_folder_that_is_not_there_and_one_that_is_a_file(tmp_path: Path, small_solution: Solution) -> None:
    with pytest.raises(FileAccessError, match="no such run folder"):
        read_run(tmp_path / "nothing")
    (tmp_path / "file").write_text("mine")
    for folder in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(FileAccessError, match="file is not a folder"):
            write_run(folder, small_solution.problem, small_solution)
    assert (tmp_path / "file").read_text() == "mine"


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_without_permission(tmp_path: Path, small_solution: Solution) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(FileAccessError, match="no permission"):
        write_run(tmp_path / "run", small_solution.problem, small_solution)


@pytest.mark.parametrize(
    ("name", "spoil", "words"),
    [
        ("weights", lambda a: a * np.nan, "the weights of the schedule are not all numbers from 0 upwards"),
        ("weights", lambda a: a - 1.0, "the weights of the schedule are not all numbers from 0 upwards"),
        ("weights", lambda a: a.astype(complex), "edges and weights are not real numbers"),
        ("weights", lambda a: a.astype(str), "edges and weights are not real numbers"),
        ("edges", lambda a: a[::-1].copy(), "the edges of the schedule are not increasing numbers"),
    ],
)
def test_arrays_that_are_no_schedule(tmp_path: Path, small_solution: Solution, name, spoil, words) -> None:
    arrays = {**small_solution.arrays, name: spoil(small_solution.arrays[name])}
    write_run(tmp_path, small_solution.problem, dataclasses.replace(small_solution, arrays=arrays))
    with pytest.raises(ProblemError, match=words):
        read_run(tmp_path)


@pytest.mark.parametrize(
    ("key", "value", "code"), [("iterations", "1e999", 3), ("seconds", "1e999", 0), ("continuous", "3", 0)]
)
def test_numbers_in_a_result_that_are_none(
    tmp_path: Path, small_solution: Solution, key: str, value: str, code: int
) -> None:
    from occontrol.cli import run

    content = write_run(tmp_path, small_solution.problem, small_solution)
    (tmp_path / RESULT).resolve().write_text(json.dumps({**content, key: "@"}).replace('"@"', value))
    assert run(["certify", str(tmp_path)]) == code

"""A run whose solver added edges is still the run of its problem, for every command, and of no other."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from occontrol.api import document, is_run_of, read_problem, read_run
from occontrol.cli import run
from occontrol.cli.solve import _earlier
from occontrol.files.run_choice import problem_digest, same_problem

DIFFUSE = """\
family: athans
horizon: {start: 0, end: 4, intervals: 20}
plant:
  A: [[0, 1], [-1, -0.4]]
  noise: {diag: [0, 0.5]}
  initial: {covariance: {diag: [1e8, 1e8]}}
sensors:
  - {name: range, C: [[1, 0]], noise: 0.1, cost: 2.0}
  - {name: doppler, C: [[0, 1]], noise: 0.4, cost: 0.5}
objective: {cost_weight: 0.01, running: {diag: [1, 0]}, output: [[1, 0]]}
method: {name: schedule, relative_gap: 1.0e-2}
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with p.yaml and its run, to which the solver added edges."""
    folder = tmp_path_factory.mktemp("added")
    (folder / "p.yaml").write_text(DIFFUSE)
    assert run(["solve", str(folder / "p.yaml"), "--out", str(folder / "run"), "--no-figures"]) == 0
    content = json.loads((folder / "run" / "result.json").read_text())
    assert content["added_edges"], "the solver added nothing, the tests would say nothing"
    return folder


def test_simulate_and_filter_follow_it(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    samples = place / "m.csv"
    assert run(["simulate", str(place / "p.yaml"), "--run", str(place / "run"), "--out", str(samples)]) == 0
    edges = read_run(place / "run")[1].schedule.edges  # type: ignore[union-attr]
    times = {float(line.split(",")[0]) for line in samples.read_text().splitlines()[1:]}
    assert len(times) > 4 and times <= {float(t) for t in edges}
    capsys.readouterr()
    assert run(["filter", str(place / "run"), str(samples), "--out", str(place / "e.csv"), "--no-figures"]) == 0


def test_certify_checks_what_it_states(place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stated = json.loads((place / "run" / "result.json").read_text())
    for words in ([str(place / "p.yaml"), str(place / "run")], [str(place / "run")]):
        assert run(["certify", *words, "--json"]) == 0
        found = json.loads(capsys.readouterr().out)
        assert found["cost"] == pytest.approx(stated["cost"], rel=1e-12)
    # a false cost in the run is seen through the file, too
    shutil.copytree((place / "run" / "current").resolve(), tmp_path / "run")
    (tmp_path / "run" / "result.json").write_text(json.dumps({**stated, "cost": 0.9 * stated["cost"]}))
    assert run(["certify", str(place / "p.yaml"), str(tmp_path / "run")]) == 7


def test_resume_goes_on_from_it(place: Path) -> None:
    earlier = _earlier(place / "run", read_problem(place / "p.yaml"))
    assert earlier is not None and earlier.cost == read_run(place / "run")[1].cost


def test_another_problem_is_refused_whatever_the_record_says(
    place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "other.yaml").write_text(DIFFUSE.replace("cost: 2.0", "cost: 1.0"))
    other = read_problem(tmp_path / "other.yaml")
    solved, _ = read_run(place / "run")
    assert not is_run_of(place / "run", solved, other)
    words = ["simulate", str(tmp_path / "other.yaml"), "--run", str(place / "run"), "--out", str(tmp_path / "m.csv")]
    assert run(words) == 3
    assert "is the run of another problem than" in capsys.readouterr().err
    posed = document(other)
    assert not same_problem(posed, document(solved), problem_digest(posed))  # a record that lies
    mine = document(read_problem(place / "p.yaml"))
    assert same_problem(mine, document(solved), problem_digest(mine))
    assert not same_problem(mine, document(solved)) and not same_problem(mine, document(solved), "sha256:0")
    fewer = document(solved)
    fewer["horizon"]["edges"] = fewer["horizon"]["edges"][::2]
    assert not same_problem(mine, fewer, problem_digest(mine))  # an edge of the file is missing

"""init --example, init --from, schema, completion, and progress away from a terminal."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

import occontrol as oc
from occontrol.cli import run
from occontrol.cli.watch import watched
from occontrol.families import names, shipped_schema
from occontrol.files.examples import examples

Captured = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def in_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_an_example_comes_with_its_tables_and_never_over_a_file(capsys: Captured) -> None:
    assert run(["init", "--example", "tracking_network"]) == 0
    assert "tracking_network.yaml, tracking_network.npz written" in capsys.readouterr().out
    first = Path("tracking_network.yaml").read_text().splitlines()[0]
    assert first.startswith("# yaml-language-server: $schema=")
    assert json.loads(Path(first.partition("$schema=")[2]).read_text())["$id"] == "urn:occontrol:0.2:athans"
    assert len(oc.read_problem("tracking_network.yaml").sensors) > 1
    assert run(["init", "--example", "tracking_network"]) == 8
    assert run(["init", "--example", "tracking_network", "other.yaml"]) == 8
    assert "tracking_network.npz exists already" in capsys.readouterr().err
    assert not Path("other.yaml").exists()


def test_every_example_reads_where_it_was_copied() -> None:
    assert len(examples()) > 20
    for name in ("reentry_waveforms", "moments_small", "four_radars"):
        assert run(["init", "--example", name, f"{name}_here.yaml"]) == 0
        oc.read_problem(f"{name}_here.yaml")


@pytest.mark.parametrize(
    ("words", "code", "text"),
    [
        (["--example", "tracking_netwrk"], 2, "there is no example 'tracking_netwrk'\n  hint: did you mean"),
        ([], 2, "init needs a family"),
        (["athans", "x.yaml", "--example", "four_radars"], 2, "init takes one of FAMILY, --example and --from"),
        (["--from", "none.mat"], 8, "there is no file none.mat"),
        (["--from", "text.mat"], 3, "not a readable .mat file\n  hint: in MATLAB: save -v7 FILE"),
        (["--from", "h5.mat"], 3, "version 7.3, which is HDF5\n  hint: in MATLAB: save -v7 FILE"),
        (["--from", "lacks.mat"], 3, "there is no C in the file\n  hint: it holds: A"),
        (["--from", "shape.mat"], 3, "Q is 1x1, it must be 2x2"),
        (["--from", "through.mat"], 3, "D is not zero\n  hint: subtract D u from the measurements"),
    ],
)
def test_what_init_refuses(words: list[str], code: int, text: str, capsys: Captured) -> None:
    Path("text.mat").write_text("hello " * 100)
    Path("h5.mat").write_bytes(b"MATLAB 7.3 MAT-file".ljust(512) + b"\x89HDF\r\n")
    savemat("lacks.mat", {"A": np.eye(2), "name": "word"})
    savemat("shape.mat", {"A": np.eye(2), "C": np.eye(2), "Q": 1.0})
    savemat("through.mat", {"A": np.eye(2), "C": np.eye(2), "D": np.ones((2, 1))})
    assert run(["init", *words]) == code
    assert text in capsys.readouterr().err


@pytest.mark.parametrize("step", [0.0, 0.1])
def test_a_state_space_of_matlab_becomes_a_problem_with_the_same_bits(step: float) -> None:
    A = np.array([[1 / 3, 1.0], [-np.pi, -0.1]])
    parts = {"A": A, "C": np.array([[1.0, 0.1], [0.0, 1 / 7]]), "Q": np.diag([0, 0.3]), "R": np.diag([0.7, 0.2])}
    savemat("model.mat", parts | {"P0": 2 * np.eye(2), "x0": np.array([[1.0], [2.0]])} | ({"Ts": step} if step else {}))
    assert run(["init", "--from", "model.mat"]) == 0
    problem = oc.read_problem("model.yaml")
    plant = problem.plant  # type: ignore[attr-defined]
    assert np.array_equal((plant.F if step else plant.A).at(0), A)
    assert np.array_equal((plant.Q if step else plant.noise).at(0), parts["Q"])
    assert np.array_equal(plant.covariance, 2 * np.eye(2)) and np.array_equal(plant.mean, [1, 2])
    assert [s.name for s in problem.sensors] == ["y1", "y2"]
    assert np.array_equal(np.vstack([s.C.at(0) for s in problem.sensors]), parts["C"])
    assert [s.noise.at(0)[0, 0] for s in problem.sensors] == [0.7, 0.2]


def test_schema_prints_what_is_shipped_for_one_family_and_for_all(capsys: Captured) -> None:
    assert run(["schema", "vlambda"]) == 0
    assert json.loads(capsys.readouterr().out) == json.loads(shipped_schema("vlambda").read_text())
    assert run(["schema"]) == 0
    union = json.loads(capsys.readouterr().out)
    assert union["properties"]["family"]["enum"] == names() and union["$id"] == "urn:occontrol:0.2:problem"
    assert run(["schema", "--out", "s.json"]) == 0
    assert json.loads(Path("s.json").read_text()) == union
    assert run(["schema", "athens"]) == 2


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("occontrol ", {"solve", "init", "schema", "export"}),
        ("occontrol init ro", {"robust"}),
        ("occontrol export x --to ", {"flight", "fmu", "csv", "json", "npz", "mat", "c"}),
        ("occontrol solve x.yaml --method gre", {"greedy"}),
        ("occontrol solve h.yaml --method ", {"scheduled", "fixed", "alternate", "random"}),
        ("occontrol show ", {"runs/mine"}),
        ("occontrol init --example four", {"four_radars"}),
    ],
)
def test_the_shell_is_offered_what_can_follow(line: str, offered: set[str]) -> None:
    Path("h.yaml").write_text("family: hybrid\n")
    Path("runs/mine").mkdir(parents=True)
    Path("runs/mine/result.json").write_text("{}")
    words = {"COMP_WORDS": line, "COMP_CWORD": str(len(line.split(" ")) - 1), "_OCCONTROL_COMPLETE": "complete_bash"}
    done = subprocess.run(
        [sys.executable, "-m", "occontrol"], env=os.environ | words, capture_output=True, text=True, check=True
    )
    assert offered <= set(done.stdout.split())
    if line == "occontrol solve h.yaml --method ":
        assert "greedy" not in done.stdout.split()


def test_away_from_a_terminal_progress_is_a_line_every_so_often(
    capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("occontrol.cli.watch.EVERY", 0.05)
    with watched() as monitor:
        monitor.stage = "schedule"
        monitor.report(3, 2.0, 1.5)
        time.sleep(0.3)
    lines = capsys.readouterr().err.splitlines()
    assert 2 <= len(lines) <= 7
    assert all(line.startswith("schedule · iteration 3 · cost 2 · bound 1.5 · gap 25 %") for line in lines)
    time.sleep(0.15)
    assert capsys.readouterr().err == ""

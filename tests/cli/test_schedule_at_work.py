"""simulate, filter, tradeoff and export on the command line, and the filter that needs NumPy alone."""

from __future__ import annotations

import ast
import csv
import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

import occontrol
from occontrol.api import write_run
from occontrol.cli import run

ROOT = Path(__file__).resolve().parents[2]
STANDALONE = ROOT / "docs" / "run_the_schedule.py"


@pytest.fixture
def here(tmp_path, monkeypatch, small_solution):
    """A folder with a finished run of the small problem and simulated measurements."""
    monkeypatch.chdir(tmp_path)
    write_run(tmp_path / "done", small_solution.problem, small_solution)
    measurements, truth = occontrol.simulate(small_solution.problem, small_solution, 7)
    from occontrol.files.tables import write_measurements, write_truth

    write_measurements("m.csv", measurements)
    write_truth("m.truth.csv", truth)
    return tmp_path


def table(path) -> tuple[list[str], np.ndarray]:
    with open(path) as file:
        rows = list(csv.reader(file))
    return rows[0], np.array([[float(x or "nan") for x in row] for row in rows[1:]])


def test_simulate_writes_what_the_library_draws_and_seeds_count(here, small_text):
    (here / "radars.yaml").write_text(small_text)
    assert run(["simulate", "radars.yaml", "--run", "done", "--out", "again.csv", "--seed", "7"]) == 0
    assert (here / "again.csv").read_text() == (here / "m.csv").read_text()
    assert (here / "again.truth.csv").read_text() == (here / "m.truth.csv").read_text()
    assert run(["simulate", "radars.yaml", "--run", "done", "--out", "other.csv", "--seed", "8"]) == 0
    assert (here / "other.csv").read_text() != (here / "m.csv").read_text()
    assert (here / "m.csv").read_text().splitlines()[0] == "t,sensor,z1"


def test_filter_works_from_a_run_folder_copied_elsewhere(here, capsys):
    shutil.copytree("done", "elsewhere/copy")
    shutil.rmtree("done")
    assert run(["filter", "elsewhere/copy", "m.csv", "--out", "e.csv"]) == 0
    report = capsys.readouterr().err
    assert "NIS: " in report and "99 % band" in report and "NEES against m.truth.csv: " in report
    header, rows = table("e.csv")
    assert header[:8] == ["t", "x1", "x2", "sd_x1", "sd_x2", "w1", "sd_w1", "nis"]
    assert header[8:] == ["w1_now", "sd_w1_now", "nees"] and len(rows) == 41
    assert {p.name for p in here.glob("e.*.png")} == {"e.estimates.png", "e.prediction.png", "e.consistency.png"}
    truth = table("m.truth.csv")[1]
    np.testing.assert_array_equal(truth[:, 0], rows[:, 0])
    assert np.max(np.abs((rows[:, 1:3] - truth[:, 1:]) / rows[:, 3:5])) < 4.5


def test_missing_samples_are_announced_and_wrong_ones_refused_with_their_line(here, capsys):
    lines = Path("m.csv").read_text().splitlines()
    Path("short.csv").write_text("\n".join(lines[:3] + lines[6:]) + "\n")
    assert run(["filter", "done", "short.csv", "--out", "e.csv", "--no-figures"]) == 0
    assert "3 of " in (report := capsys.readouterr().err) and "missing" in report
    cells = lines[4].split(",")
    Path("wrong.csv").write_text("\n".join([*lines[:4], f"9.5,{cells[1]},{cells[2]}", *lines[5:]]) + "\n")
    assert run(["filter", "done", "wrong.csv", "--out", "none.csv"]) == 3
    message = capsys.readouterr().err
    assert f"wrong.csv:5: the sample of sensor '{cells[1]}' at t = 9.5 lies outside the horizon [0, 4]" in message
    assert "Traceback" not in message and not Path("none.csv").exists()
    assert run(["filter", "done", "m.csv", "--out", "e.csv", "--model", "exakt"]) == 2
    assert run(["filter", "done", "m.csv", "--out", "e.csv", "--model", "exact", "--no-figures"]) == 0


@pytest.mark.parametrize("damage", ["truncated", "flipped", "emptied", "missing"])
def test_a_damaged_run_folder_is_refused(here, capsys, damage):
    path = here / "done" / "arrays.npz"
    data = bytearray(path.read_bytes())
    if damage == "missing":
        path.unlink()
    else:
        if damage == "flipped":
            data[len(data) // 2] ^= 0xFF
        path.write_bytes({"truncated": data[: len(data) // 2], "flipped": data, "emptied": b""}[damage])
    code = run(["filter", "done", "m.csv", "--out", "e.csv"])
    message = capsys.readouterr().err
    assert code == 3
    assert "arrays.npz" in message and "Traceback" not in message and not Path("e.csv").exists()


def compare_with_standalone(out: Path, exported: str, measurements: str) -> None:
    command = [sys.executable, "-I", str(STANDALONE), exported, measurements, "alone.csv"]
    subprocess.run(command, check=True, cwd=out)
    ours = table(out / "e.csv")[1]
    alone = np.genfromtxt(out / "alone.csv", delimiter=",")
    ours = ours[:, : alone.shape[1]]
    assert np.array_equal(np.isnan(ours), np.isnan(alone))
    scale = np.nanmax(np.abs(ours), axis=0)
    assert np.nanmax(np.abs(ours - alone) / np.where(scale > 0, scale, 1)) < 1e-12


@pytest.mark.parametrize("form", ["npz", "json"])
@pytest.mark.parametrize("dropped", [False, True])
def test_the_script_in_numpy_alone_reproduces_the_filter(here, form, dropped):
    lines = Path("m.csv").read_text().splitlines()
    Path("n.csv").write_text("\n".join(lines[:5] + lines[8 if dropped else 5 :]) + "\n")
    assert run(["filter", "done", "n.csv", "--out", "e.csv", "--no-figures"]) == 0
    assert run(["export", "done", "--to", form, "--out", f"x.{form}"]) == 0
    compare_with_standalone(here, f"x.{form}", "n.csv")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["attitude_telemetry", "reentry_waveforms"])
def test_the_script_also_follows_shipped_problems(name, solved, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    solution = solved(name)
    write_run("done", solution.problem, solution)
    assert run(["simulate", str(ROOT / "problems" / f"{name}.yaml"), "--run", "done", "--out", "m.csv"]) == 0
    assert run(["filter", "done", "m.csv", "--out", "e.csv", "--no-figures"]) == 0
    assert run(["export", "done", "--to", "npz", "--out", "x.npz"]) == 0
    compare_with_standalone(tmp_path, "x.npz", "m.csv")


def test_the_script_imports_numpy_only():
    tree = ast.parse(STANDALONE.read_text(encoding="utf-8"))
    names = {a.name for node in ast.walk(tree) if isinstance(node, ast.Import) for a in node.names}
    assert names == {"csv", "json", "sys", "numpy"}
    assert not [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]


def test_mat_files_hold_the_run(here, small_solution):
    assert run(["export", "done", "--to", "mat", "--out", "run.mat"]) == 0
    content = loadmat("run.mat", simplify_cells=True)
    np.testing.assert_array_equal(content["arrays"]["covariance"], small_solution.arrays["covariance"])
    assert content["sensors"].tolist() == ["range", "doppler", "idle"]
    assert content["result"]["cost"] == small_solution.cost
    assert content["filter"]["gain"].shape[0] == 40


def test_tradeoff_prints_a_table_and_writes_a_folder(tmp_path, monkeypatch, small_file, capsys):
    monkeypatch.chdir(tmp_path)
    assert run(["tradeoff", str(small_file), "--weights", "1e-2:1:4"]) == 0
    assert "lower bound" in capsys.readouterr().out
    folder = tmp_path / "runs" / "radars-tradeoff"
    files = {p.name for p in folder.iterdir()}
    pictures = {"front.png", "schedules.png", "tradeoff.html"}
    assert files == {"tradeoff.json", "front.csv", "arrays.npz"} | pictures
    header, rows = table(folder / "front.csv")
    assert header[:3] == ["cost_weight", "observation_cost", "error"] and len(rows) == 4
    np.testing.assert_allclose(rows[:, 0], np.geomspace(1e-2, 1, 4))
    assert run(["tradeoff", str(small_file), "--weights", "1e-2:1:4", "--json", "--no-figures"]) == 0
    assert json.loads(capsys.readouterr().out) == json.loads((folder / "tradeoff.json").read_text())


@pytest.mark.parametrize("weights", ["1:2", "0:1:3", "2:1:3", "a:b:c", "1:inf:3"])
def test_tradeoff_refuses_bad_weights(weights, small_file, capsys):
    assert run(["tradeoff", str(small_file), "--weights", weights]) == 2
    assert "is not FROM:TO:COUNT" in capsys.readouterr().err

"""Problem files with readings from the command line: solve, certify, simulate, filter, export, compare, refusals."""

import csv
import json
from dataclasses import dataclass

import numpy as np
import pytest

from occontrol.api import document, read_problem, read_run, read_schedule, solve
from occontrol.cli import run
from occontrol.core.errors import ProblemError, UsageError
from occontrol.families.athans.methods import Collocation

STEPS = """family: athans
name: two sensors in discrete time
horizon: {steps: 6}
plant:
  F: [[1, 0.5], ["-0.3+0.01*k", 0.9]]
  Q: {diag: [0, 0.04]}
  initial: {covariance: {diag: [4, 1]}}
sensors:
  - {name: one, H: [[1, 0]], R: [[0.25]], cost: 0.02}
  - {name: two, H: [[0, 1]], R: [[0.1]], cost: "0.01+0.001*k", windows: [[1, 3], [5, 5]]}
select: 0..1
objective: {output: [[1, 0]], at: posterior, running: {diag: [0.1, 0]}, running_at: prior}
"""
SAMPLES = """family: athans
name: three looks
horizon: {start: 0, end: 3, samples: 6, predict_at: 4}
sensing: samples
plant:
  A: [[0, 1], [-1, -0.4]]
  B: [[0], [1]]
  input: ["sin(t)"]
  noise: {diag: [0, 0.5]}
  initial: {mean: [1, 0], covariance: {diag: [5, 5]}}
sensors:
  - {name: range, C: [[1, 0]], noise: [[0.1]], cost: 0.2}
  - {name: doppler, C: [[0, 1]], variance: [[0.4]], cost: 0.05, windows: [[0.4, 2]]}
  - idle
objective: {output: [[1, 0]]}
"""
FILES = {"steps": STEPS, "samples": SAMPLES}


@dataclass
class Done:
    """What a command left behind."""

    code: int
    out: str
    err: str


@pytest.fixture
def run_cli(capsys):
    def call(*words) -> Done:
        capsys.readouterr()
        code = run([str(word) for word in words])
        return Done(code, *capsys.readouterr())

    return call


@pytest.fixture
def path(tmp_path, request):
    file = tmp_path / "p.yaml"
    file.write_text(FILES[request.param])
    return file


@pytest.mark.parametrize("path", FILES, indirect=True)
def test_a_problem_survives_its_document(path, tmp_path):
    problem = read_problem(path)
    again = tmp_path / "again.json"
    again.write_text(json.dumps(document(problem)))
    assert document(read_problem(again)) == document(problem)


@pytest.mark.parametrize("path", FILES, indirect=True)
def test_from_the_file_to_the_estimate(path, tmp_path, run_cli):
    out = tmp_path / "run"
    done = run_cli("solve", path, "--out", out)
    assert done.code == 0 and "for every schedule of these readings" in done.out
    assert {p.name for p in (out / "figures").iterdir()} >= {"overview.png", "schedule.png", "deviations.png"}
    problem, solution = read_run(out)
    assert solution.schedule.segments() == solution.result["schedule"]
    assert np.array_equal(solution.schedule.weights, solution.arrays["weights"])
    result = json.loads((out / "result.json").read_text())
    assert result["top"] == {**{k: result[k] for k in ("cost", "lower_bound", "relative_gap")}, "of": "problem"}
    assert run_cli("certify", out).code == 0
    data = tmp_path / "z.csv"
    assert run_cli("simulate", path, "--run", out, "--out", data).code == 0
    assert run_cli("filter", out, data, "--out", tmp_path / "x.csv").code == 0
    rows = list(csv.DictReader((tmp_path / "x.csv").open()))
    assert len(rows) == problem.readings + 1
    assert run_cli("export", out, "--to", "csv", "--out", tmp_path / "csv").code == 0
    lines = (tmp_path / "csv" / "schedule.csv").read_text().splitlines()
    assert lines[0] == "start,end,sensors" and len(lines) == problem.readings + 1
    assert all(line.split(",")[0] == line.split(",")[1] for line in lines[1:])
    back = read_schedule(tmp_path / "csv" / "schedule.csv", problem)
    assert np.array_equal(back.weights, solution.schedule.weights)
    for kind in ("json", "mat", "c", "npz"):
        assert run_cli("export", out, "--to", kind, "--out", tmp_path / f"p.{kind}").code == 0
    done = run_cli("tradeoff", path, "--weights", "0.1:10:3", "--out", tmp_path / "front")
    assert done.code == 0, done.err


@pytest.mark.parametrize("path", FILES, indirect=True)
def test_every_method_but_collocation(path, tmp_path, run_cli):
    problem = read_problem(path)
    best = solve(problem)
    for name in ("hminimal", "greedy", "round-robin", "random", "best-single"):
        other = solve(problem, name)
        assert other.cost >= best.result["lower_bound"] * (1 - 1e-9)
        assert other.result["lower_bound"] <= best.cost * (1 + 1e-9)
    relaxed = solve(problem, "relaxed")
    assert relaxed.cost <= best.cost * (1 + 1e-9)
    with pytest.raises(UsageError, match="collocation does not do readings at instants"):
        solve(problem, Collocation())
    assert run_cli("solve", path, "--method", "collocation", "--out", tmp_path / "c").code == 2


@pytest.mark.parametrize("path", ["steps"], indirect=True)
def test_schedules_that_anybody_writes(path, tmp_path, run_cli):
    problem, file = read_problem(path), tmp_path / "s.csv"

    def weights(text: str) -> list:
        file.write_text("start,end,sensors\n" + text)
        schedule = read_schedule(file, problem)
        return [";".join(entry["sensors"]) for entry in schedule.segments()]

    assert weights("0,1,one\n3,3,two\n") == ["one", "one", "idle", "two", "idle", "idle"]
    assert weights("0,5,idle\n") == ["idle"] * 6
    for text, words in (
        ("0.5,0.6,one\n", "there is no reading at k = 0.5"),
        ("0,1,one\n1,1,two\n", "k = 1 is named a second time"),
        ("0,0,three\n", "there is no sensor 'three'"),
        ("0,0,one;two\n", "2 sensors are read at k = 0, but select is 1"),
    ):
        with pytest.raises(ProblemError, match=words):
            weights(text)
    file.write_text("start,end,sensors\n0,0,two\n")
    done = run_cli("certify", path, file)
    assert done.code == 3 and "sensor 'two' has weight 1, but is not available" in done.err
    listed = tmp_path / "s.json"
    listed.write_text(json.dumps([{"k": 0, "sensors": ["one"]}, {"k": 5, "sensors": ["two"]}]))
    schedule = read_schedule(listed, problem)
    assert [entry["sensors"] for entry in schedule.segments()] == [["one"], *[["idle"]] * 4, ["two"]]


@pytest.mark.parametrize(
    "old, new, words",
    [
        ("steps: 6", "steps: 0", "horizon.steps is 0"),
        ("steps: 6", "steps: 6, epoch: 1.5", "horizon.epoch is 1.5"),
        ("select: 0..1", "select: 2..1", "select is 2..1, there are 2 sensors"),
        ("select: 0..1", "select: 3", "select is 3, there are 2 sensors"),
        ("at: posterior", "at: later", "at is 'later'"),
        ("running_at: prior", "running_at: integral", "running_at is 'integral'"),
        ("R: [[0.25]]", "R: [[-0.25]]", "R of sensor 'one' is not positive definite"),
        ("H: [[1, 0]]", "H: [[1, 0, 0]]", "H of sensor 'one' is 1x3, but the plant has 2 states"),
        ("windows: [[1, 3], [5, 5]]", "windows: [[7, 9]]", "no window of sensor 'two' holds a reading"),
        ("cost: 0.02", "cost: -1", "cost of sensor 'one' is -1 at k = 0"),
        ("output: [[1, 0]], ", "output: [[1, 0, 3]], ", "output is 1x3"),
        ("F:", "C: 1\n  F:", "unknown key 'C'"),
        ("name: two sensors in discrete time", "method: {name: collocation}", "collocation does not do readings"),
    ],
)
def test_refusals_name_the_place(tmp_path, old, new, words, run_cli):
    file = tmp_path / "p.yaml"
    file.write_text(STEPS.replace(old, new, 1))
    done = run_cli("solve", file, "--out", tmp_path / "run")
    assert words in done.err and done.code == (2 if "collocation" in words else 3)


@pytest.mark.parametrize(
    "old, new, words",
    [
        ("samples: 6", "sample_times: [0, 2, 1]", "sample times must increase: 1 comes after 2"),
        ("samples: 6", "sample_times: [0, 5]", "the sample time 5 lies outside the horizon"),
        ("samples: 6", "samples: 6, sample_times: [0]", "horizon has both 'samples' and 'sample_times'"),
        ("samples: 6, ", "", "horizon has no 'sample_times'"),
        ("predict_at: 4", "predict_at: 2", "predict_at = 2 lies before the end of the horizon, 3"),
        ("variance: [[0.4]]", "variance: [[0.4]], every: 1", "sensor 'doppler': every belongs to continuous sensing"),
        ("output: [[1, 0]]", "output: [[1, 0]], at: posterior", "at belongs to discrete time"),
        ("{output: [[1, 0]]}", "{cost_weight: 1}", "objective has neither 'output' nor 'running'"),
    ],
)
def test_refusals_of_samples(tmp_path, old, new, words, run_cli):
    file = tmp_path / "p.yaml"
    file.write_text(SAMPLES.replace(old, new, 1))
    done = run_cli("solve", file, "--out", tmp_path / "run")
    assert words in done.err and done.code == 3


def test_a_file_without_enough_sensors_is_infeasible(tmp_path, run_cli):
    file = tmp_path / "p.yaml"
    file.write_text(STEPS.replace("select: 0..1", "select: 2"))
    done = run_cli("solve", file, "--out", tmp_path / "run")
    assert done.code == 4 and "at k = 0, 4 fewer than 2 sensors can be read" in done.err

"""Problem files of the selection family: forms, the way back, and what is refused, with its place."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from occontrol.api import read_run, solve
from occontrol.cli import run
from occontrol.core.errors import ProblemError
from occontrol.files.figures import compare_figure, figures_of
from occontrol.files.problem_file import document, read_problem

ROOT = Path(__file__).parents[3]
PROBLEMS = sorted(p for p in (ROOT / "problems").glob("*.yaml") if "family: vlambda" in p.read_text())
TEMPLATE = ROOT / "occontrol" / "families" / "vlambda" / "template.yaml"

GOOD = """family: vlambda
horizon: {steps: 12, epoch: 4}
plant:
  F: [[1, "0.1+0.01*k"], [0, 0.9]]
  G: [[0], [1]]
  Q: [["0.1*(1+0.1*sin(k))"]]
  initial: {mean: [1, 0], covariance: {diag: [4, 1]}}
sensors:
  - {name: a, H: [[1, 0]], R: 0.5}
  - {name: b, H: {times: [0, 6], values: [[[0, 1]], [[1, 1]]], interpolation: previous}, R: [["0.2+0.01*k"]]}
  - name: c
    H: [["cos(p1)", "sin(p1)*(1+0.01*k)"]]
    R: [["1+0.1*p1"]]
    location: {bounds: [[0, 3]], constraints: ["p1 - 2 - 0.01*k"]}
select: 2
scales: [1, 2]
criterion: trace
method: {name: lookahead, depth: 2, grid: 5}
expect: {source: nobody, cost: 1.5, tolerance: 0.1}
"""


def written(tmp_path, text, name="p.yaml"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def refusal(tmp_path, text):
    with pytest.raises(ProblemError) as caught:
        read_problem(written(tmp_path, text))
    return str(caught.value)


def test_every_form_reads_solves_and_comes_back_identical(tmp_path):
    problem = read_problem(written(tmp_path, GOOD))
    assert problem.select == 2
    assert problem.criterion == "trace"
    assert problem.method.depth == 2
    assert problem.sampled.transition[3][0, 1] == pytest.approx(0.13 * 2)  # in scaled states
    assert problem.sampled.sensors[1].H[7] == pytest.approx(np.array([[1.0, 2.0]]))
    text = json.dumps(document(problem))
    again = read_problem(written(tmp_path, text, "p.json"))
    assert json.dumps(document(again)) == text
    a, b = solve(problem), solve(again)
    assert a.result == {**b.result}
    assert all(np.array_equal(a.arrays[key], b.arrays[key]) for key in a.arrays)
    for entry in a.result["schedule"]:
        assert len(entry["sensors"]) == 2
        if "c" in entry["sensors"]:
            assert 0 <= entry["location"][0] <= 2 + 0.01 * entry["k"] + 1e-9


@pytest.mark.parametrize("path", [*PROBLEMS, TEMPLATE], ids=lambda p: p.stem)
def test_the_problem_files_read_solve_and_draw(path):
    problem = read_problem(path)
    solution = solve(problem)
    if problem.expect:
        assert solution.cost == pytest.approx(problem.expect["cost"], rel=problem.expect["tolerance"])
    names = figures_of(problem, solution)
    assert list(names) == ["overview", "deviations"]
    assert compare_figure(problem, {"eigenspace": solution, "round-robin": solve(problem, "round-robin")}) is not None


MISTAKES = [
    ("steps: 12", "steps: 0", ":2:", "horizon.steps is 0"),
    ("epoch: 4", "epoch: 2.5", ":2:", "epoch"),
    ("epoch: 4", "epochs: 4", ":2:", "epoch"),
    ('"0.1+0.01*k"', '"0.1+0.01*t"', ":4:", "unknown name 't'"),
    ("[0, 0.9]]", "[0, 0.9], [1, 1]]", ":4:", "F is 3x2"),
    ("G: [[0], [1]]", "G: [[0, 1], [1, 0]]", ":6:", "Q is 1x1"),
    ("0.1*(1+0.1*sin(k))", "0.5-0.1*k", ":6:", "not positive semidefinite at k = 6"),
    ("diag: [4, 1]", "diag: [4, -1]", ":7:", "covariance is not positive semidefinite"),
    ("mean: [1, 0]", "mean: [1, 0, 3]", ":7:", "mean has 3 entries, the plant has 2 states"),
    ("H: [[1, 0]]", "H: [[1, 0, 0]]", ":9:", "H of sensor 'a' is 1x3, but the plant has 2 states"),
    ("R: 0.5", "R: 0", ":9:", "R of sensor 'a' is not positive definite"),
    ("R: 0.5", "R: [[1, 0], [0, 1]]", ":9:", "R of sensor 'a' is 2x2, its H has 1 row"),
    ("0.2+0.01*k", "0.2-0.1*k", ":10:", "R of sensor 'b' is not positive definite at k = 2"),
    ("0.2+0.01*k", "1/(k-3)**2", ":10:", "not finite at k = 3"),
    ("times: [0, 6]", "times: [1, 6]", ":10:", "the horizon is k = 0 .. 11"),
    ("cos(p1)", "cos(p2)", ":12:", "unknown name 'p2'"),
    ("cos(p1)", "1/p1", ":12:", "H of sensor 'c' is not finite at k = 0, p = 0"),
    ("1+0.1*p1", "1-p1", ":13:", "R of sensor 'c' is not positive definite"),
    ("bounds: [[0, 3]]", "bounds: [[3, 0]]", ":14:", "the bounds of p1 are [3, 0]"),
    ("bounds: [[0, 3]]", "bounds: [0, 3]", ":14:", "one [low, high] pair per coordinate"),
    ("p1 - 2 - 0.01*k", "p1 - q", ":14:", "unknown name 'q'"),
    ("location: {bounds", "place: {bounds", ":14:", "unknown key 'place'"),
    ("name: b", "name: a", ":10:", "the name 'a' is used twice"),
    ("select: 2", "select: 4", ":15:", "select is 4, there are 3 sensors"),
    ("select: 2", "select: 0", ":15:", "select is 0"),
    ("scales: [1, 2]", "scales: [1]", ":16:", "scales has 1 entry, the plant has 2 states"),
    ("scales: [1, 2]", "scales: [1, 0]", ":16:", "a scale is not a finite number above 0"),
    ("criterion: trace", "criterion: {name: determinant}", ":17:", "unknown criterion 'determinant'"),
    ("name: lookahead", "name: lookahed", ":18:", "did you mean 'lookahead'"),
    ("depth: 2", "depth: 0", ":18:", "depth is 0"),
    ("{name: lookahead, depth: 2, grid: 5}", "{name: fixed, sensor: zz}", ":18:", "there is no sensor 'zz'"),
    ("{name: lookahead, depth: 2, grid: 5}", "{name: fixed, sensor: a}", ":18:", "1 sensor is named, select is 2"),
    ("{name: lookahead, depth: 2, grid: 5}", "{name: random, seed: -1}", ":18:", "seed"),
    ("{name: lookahead, depth: 2, grid: 5}", "{name: eigenspace, tolerance: 2}", ":18:", "tolerance is 2"),
]


@pytest.mark.parametrize(("old", "new", "place", "words"), MISTAKES, ids=[f"{n}" for _, n, _, _ in MISTAKES])
def test_mistakes_name_their_place(tmp_path, old, new, place, words):
    assert GOOD.count(old) == 1
    message = refusal(tmp_path, GOOD.replace(old, new))
    assert words in message, message
    assert f"p.yaml{place}" in message, message


def test_several_mistakes_are_reported_together(tmp_path):
    text = GOOD.replace("R: 0.5", "R: 0").replace("select: 2", "select: 9").replace("diag: [4, 1]", "diag: [4, -1]")
    message = refusal(tmp_path, text)
    assert "select is 9" in message
    assert "covariance is not positive semidefinite" in message
    assert "R of sensor 'a' is not positive definite" in message
    message = refusal(tmp_path, text.replace("name: b", "name: a").replace("epoch: 4", "epoch: 0"))
    for words in ("'a' is used twice", "horizon.epoch is 0", "R of sensor 'a' is not positive definite"):
        assert words in message


def test_a_fixed_pair_of_sensors(tmp_path):
    text = GOOD.replace("{name: lookahead, depth: 2, grid: 5}", "{name: fixed, sensor: [b, a]}")
    problem = read_problem(written(tmp_path, text))
    assert all(e["sensors"] == ["a", "b"] for e in solve(problem).result["schedule"])
    again = read_problem(written(tmp_path, json.dumps(document(problem)), "q.json"))
    assert again.method == problem.method


@pytest.mark.slow
def test_from_file_to_run_folder_filter_and_certificate(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    written(tmp_path, GOOD)
    assert run(["check", "p.yaml"]) == 0
    assert "movable in [0, 3]" in capsys.readouterr().out
    assert run(["solve", "p.yaml", "--out", "r", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert {"schedule", "sum_trace", "sum_largest_eigenvalue", "peak_largest_eigenvalue"} <= set(result)
    assert {"epoch", "k", "sensors", "scores", "location"} <= set(result["schedule"][0])
    _, back = read_run(tmp_path / "r")
    assert back.arrays["standard_deviations"].shape == (12, 2)
    assert back.arrays["largest_eigenvalue"].shape == (12,)
    assert back.arrays["selected"].shape == (3, 2)
    assert run(["simulate", "p.yaml", "--run", "r", "--out", "m.csv", "--seed", "1"]) == 0
    assert run(["filter", "r", "m.csv", "--out", "e.csv"]) == 0
    rows = np.genfromtxt("e.csv", delimiter=",", names=True)
    assert rows["sd_x1"] == pytest.approx(back.arrays["standard_deviations"][:, 0], rel=1e-9)
    assert run(["certify", "r"]) == 0  # the recorded locations are used
    assert run(["solve", "p.yaml", "--method", "nonsense"]) == 2
    assert run(["solve", "p.yaml", "--method", "fixed:a"]) == 2
    assert run(["tradeoff", "p.yaml"]) == 2


def test_limits_end_with_exit_5_and_a_valid_bound(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    text = (ROOT / "problems" / "oshman_every_step.yaml").read_text()
    written(tmp_path, text.replace("{name: eigenspace}", "{name: optimal, max_nodes: 2000}"))
    assert run(["solve", "p.yaml", "--json", "--no-figures"]) == 5
    result = json.loads(capsys.readouterr().out)
    assert result["status"] == "limit"
    assert 0 <= result["lower_bound"] < result["cost"]
    assert result["relative_gap"] == pytest.approx(1 - result["lower_bound"] / result["cost"])
    assert result["nodes"] >= 2000


def test_nowhere_to_be_is_infeasible(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    text = GOOD.replace("p1 - 2 - 0.01*k", "p1 + 1").replace("{name: lookahead, depth: 2, grid: 5}", "eigenspace")
    written(tmp_path, text)
    assert run(["solve", "p.yaml", "--no-figures"]) == 4
    assert "no location of sensor 'c' satisfies its constraints" in capsys.readouterr().err

"""occontrol convert: a selection along epochs becomes a plan of readings."""

import json

import pytest

from occontrol.api import family_of, read_problem, solve
from occontrol.cli import run
from occontrol.core.errors import UsageError

FILE = """family: vlambda
name: two by two
horizon: {steps: 8, epoch: 2}
plant: {F: [[0.9, 0.2], [0, 0.8]], Q: {diag: [0.1, 0.2]}, initial: {covariance: {diag: [1, 2]}}}
sensors:
  - {name: one, H: [[1, 0]], R: [[0.2]]}
  - {name: two, H: [[0, 1]], R: [["0.1+0.01*k"]]}
criterion: {name: trace}
method: {name: optimal}
"""


def test_the_plan_costs_what_the_exact_search_of_the_selection_finds(tmp_path, capsys):
    source, target = tmp_path / "s.yaml", tmp_path / "s_athans.json"
    source.write_text(FILE)
    assert run(["convert", str(source), "--to", "athans"]) == 0
    captured = capsys.readouterr()
    assert str(target) in captured.out
    assert "the method optimal is left behind" in captured.err
    plan, selection = solve(read_problem(target)), solve(read_problem(source))
    assert plan.cost == pytest.approx(selection.result["cost"], rel=1e-10)
    assert plan.result["lower_bound"] <= selection.result["cost"] * (1 + 1e-9)
    chosen = [entry["sensors"] for entry in selection.result["schedule"]]
    assert [entry["sensors"] for entry in plan.result["schedule"]][::2] == chosen


def test_what_cannot_be_converted_is_refused(tmp_path, capsys):
    source = tmp_path / "s.yaml"
    source.write_text(FILE)
    with pytest.raises(UsageError, match="a problem of family vlambda does not become one of family robust"):
        family_of(read_problem(source)).converted(read_problem(source), "robust")
    assert run(["convert", str(source), "--to", "athans", "--out", str(tmp_path / "x.yaml")]) == 2
    assert run(["convert", str(source), "--to", "athans"]) == 0
    capsys.readouterr()
    assert run(["convert", str(source), "--to", "athans"]) == 8
    assert "exists already" in capsys.readouterr().err


def test_other_criteria_are_left_behind_with_a_word(tmp_path, capsys):
    source = tmp_path / "s.yaml"
    source.write_text(FILE.replace("criterion: {name: trace}\n", "").replace("method: {name: optimal}\n", ""))
    assert run(["convert", str(source), "--to", "athans", "--out", str(tmp_path / "y.json")]) == 0
    assert "the criterion largest-eigenvalue is left behind" in capsys.readouterr().err
    assert json.loads((tmp_path / "y.json").read_text())["horizon"] == {"steps": 8, "epoch": 2}

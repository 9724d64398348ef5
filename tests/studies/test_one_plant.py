"""compare --families: every family's schedule on the same plant by the same flow."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import occontrol as oc
from occontrol.cli import run
from occontrol.core.conversion import Asked
from occontrol.core.errors import UsageError
from occontrol.core.monitor import Monitor
from occontrol.studies.one_plant import side_by_side

TEXT = """\
family: athans
name: pendulum
horizon: {start: 0, end: 4, intervals: 60}
plant:
  A: [[0, 1], [-1, -0.4]]
  noise: [[0.05, 0.02], [0.02, 0.5]]
  initial: {mean: [1, 0], covariance: [[2, 0.3], [0.3, 1]]}
sensors:
  - {name: angle, C: [[1, 0]], noise: [[0.1]]}
  - {name: rate, C: [[0, 1]], noise: [[0.2]]}
objective: {output: [[1, 0], [0, 1]]}
"""


def test_every_family_is_judged_by_the_same_numbers(tmp_path: Path, capsys, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pendulum.yaml").write_text(TEXT, encoding="utf-8")
    assert run(["compare", "pendulum.yaml", "--families", "--json", "--level", "3"]) == 0
    rows = {row["family"]: row for row in json.loads(capsys.readouterr().out)["families"]}
    assert list(rows) == ["athans", "vlambda", "robust"]
    own = oc.solve(oc.read_problem("pendulum.yaml"))
    assert rows["athans"]["prediction_error"] == pytest.approx(own.result["prediction_error"], rel=1e-8)
    for row in rows.values():
        assert row["lower_bound"] <= row["cost"]
        # the whole state counts and K is zero: the set's shape is the covariance, its size the level times its trace
        assert row["worst_case"] == pytest.approx(3 * row["prediction_error"], rel=1e-5)
        assert row["cost"] >= rows["athans"]["lower_bound"] - 1e-9
    assert (tmp_path / "runs" / "pendulum-families" / "families.json").is_file()


def test_the_worst_case_of_a_robust_problem_is_with_its_own_uncertainty() -> None:
    problem = oc.read_problem(Path(__file__).resolve().parents[2] / "problems" / "robust_oscillator.yaml")
    rows = {row.family: row for row in side_by_side(problem, Asked(), Monitor())}
    own = oc.solve(problem)
    size = problem.size if isinstance(problem.size, str) else None
    assert size == "trace" and rows["robust"].worst_case == pytest.approx(own.result["cost"], rel=1e-8)
    assert all(row.worst_case >= own.result["cost"] * (1 - 1e-9) for row in rows.values() if row.switches is not None)


def test_readings_and_other_families_are_refused(tmp_path: Path) -> None:
    problem = oc.read_problem(Path(__file__).resolve().parents[2] / "problems" / "radar_discrete.yaml")
    with pytest.raises(UsageError, match="needs a plant in continuous time"):
        side_by_side(problem, Asked(), Monitor())

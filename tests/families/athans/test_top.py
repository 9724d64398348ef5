"""The pair at the top: for all switching times where that is proven, the grid's where the check did not finish."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest

import occontrol as oc
from occontrol.cli import run
from occontrol.cli.compare import comparison
from occontrol.core.errors import SolveFailed
from occontrol.core.printed import rounded_down
from occontrol.core.solution import Solution, Status
from occontrol.families.athans import assembly


def test_the_top_is_the_continuous_pair(small_solution: Solution) -> None:
    result = small_solution.result
    continuous = {key: result["continuous"][key] for key in ("cost", "lower_bound", "relative_gap")}
    assert result["top"] == {**continuous, "of": "continuous"}
    bound = rounded_down(continuous["lower_bound"], 6)
    assert f"costs less than {bound}, whenever it switches" in small_solution.message


def test_comparison_measures_against_the_best_bound_at_the_top(small_solution: Solution) -> None:
    numbers = small_solution.numbers
    higher = dataclasses.replace(numbers.top, lower_bound=numbers.top.lower_bound + 1e-5, cost=numbers.top.cost + 1.0)
    other = dataclasses.replace(small_solution, numbers=dataclasses.replace(numbers, top=higher))
    rows = comparison({"one": small_solution, "other": other})
    assert [row["cost"] for row in rows] == [numbers.top.cost, higher.cost]
    assert [row["lower_bound"] for row in rows] == [numbers.top.lower_bound, higher.lower_bound]
    for row in rows:
        assert row["gap_to_best_bound"] == pytest.approx((row["cost"] - higher.lower_bound) / row["cost"], rel=1e-12)


def test_a_check_that_cannot_finish_costs_no_result(
    small_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def too_many(*_):
        raise SolveFailed("the check in continuous time would need more than 1000000 panels")

    monkeypatch.setattr(assembly, "judge", too_many)
    assert run(["solve", str(small_file), "--out", str(tmp_path / "run"), "--json", "--no-figures"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["status"] == "feasible" and content["schedule"]
    assert content["top"]["of"] == "grid" and content["top"]["cost"] == content["cost"]
    assert content["top"]["lower_bound"] == content["lower_bound"] > 0
    assert content["continuous"]["cost"] is None and content["continuous"]["lower_bound"] is None
    assert "1000000 panels" in content["continuous"]["reason"]
    assert "that changes at these edges costs less than" in content["message"]
    assert "The check in continuous time is not computed" in content["message"]
    problem, again = oc.read_run(tmp_path / "run")
    assert again.status is Status.FEASIBLE and again.numbers.continuous.cost is None
    assert oc.plot(again, problem, "overview") is not None

"""Caps from the problem file and the command line: fronts, their files, what is refused and said."""

from __future__ import annotations

import itertools
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import occontrol as oc
from occontrol.cli import run
from occontrol.core.errors import InfeasibleError, UsageError
from occontrol.families.athans.discretise import discretise
from occontrol.families.athans.rules.statement import Constraints
from occontrol.scheduling.sweep import Sweep
from tests.families.athans.problem_texts import written

BASE = """\
family: athans
name: caps
horizon: {start: 0, end: 3, intervals: 9, substeps: 1}
plant: {A: [[0, 1], [-1, -0.4]], noise: {diag: [0.0, 0.5]}, initial: {covariance: {diag: [5, 5]}}}
sensors:
  - {name: radar, C: [[1, 0]], noise: [[0.1]], cost: 2.0}
  - {name: sonar, C: [[0, 1]], noise: [[0.2]], cost: 0.7}
  - idle
objective: {cost_weight: 0.1, output: [[1, 0]]}
"""
RULED = "constraints: {min_on: 0.6}\n"


def enumerated(p, cap: float, shortest: int = 1) -> float:
    """The least error within a cap by trying every schedule whose uses, but the last one, are long enough."""
    sweep, best = Sweep(discretise(replace(p, cost_weight=0.0))), np.inf
    for word in itertools.product(range(3), repeat=p.intervals):
        spent = sum(p.steps[0] * (2.0, 0.7, 0.0)[j] for j in word)
        runs = [(j, len(list(group))) for j, group in itertools.groupby(word)]
        short = [length < shortest for j, length in runs[:-1] if j != 2]
        if spent <= cap * (1 + 1e-9) and not any(short):
            best = min(best, sweep.cost(np.eye(3)[list(word)]))
    return best


@pytest.mark.parametrize(("more", "shortest"), [("", 1), (RULED, 2)])
def test_every_point_of_a_front_over_caps_is_bounded_by_enumeration(tmp_path: Path, more: str, shortest: int) -> None:
    p = written(tmp_path, BASE, ("intervals: 9", "intervals: 7"), more=more)
    front = oc.tradeoff(p, budgets=[3.0, 1.0, 1.9])
    points = front.as_dict()["points"]
    assert [point["budget"] for point in points] == [1.0, 1.9, 3.0]
    assert front.as_dict()["of"] == "grid"
    for point in points:
        best = enumerated(p, point["budget"], shortest)
        assert point["lower_bound"] <= best * (1 + 1e-9)
        assert best * (1 - 1e-9) <= point["error"] <= best * 1.02
        assert point["observation_cost"] <= point["budget"] * (1 + 1e-9)
        assert point["relative_gap"] == pytest.approx(1 - point["lower_bound"] / point["error"])
    assert all(a["error"] >= b["error"] and a["lower_bound"] >= b["lower_bound"] for a, b in itertools.pairwise(points))


def test_the_front_is_written_and_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    written(tmp_path, BASE, ("  - idle\n", ""))
    out = tmp_path / "front"
    assert run(["tradeoff", str(tmp_path / "x.yaml"), "--budget", "1.5:4:3", "-o", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "budget" in printed and "price" in printed
    assert "budget 1.5: every schedule that keeps the other rules needs 2.1 of max_observation_cost" in printed
    content = json.loads((out / "tradeoff.json").read_text())
    assert [p["budget"] for p in content["points"]] == pytest.approx([6**0.5, 4.0])
    assert content["refused"][0]["budget"] == 1.5
    assert {f.name for f in out.iterdir()} == {"tradeoff.json", "front.csv", "arrays.npz", "front.png", "schedules.png"}
    with np.load(out / "arrays.npz") as arrays:
        assert arrays["weights"].shape == (2, 9, 2) and arrays["budgets"].shape == (2,)
    assert (out / "front.csv").read_text().startswith("budget,price,observation_cost,error,lower_bound")
    assert run(["tradeoff", str(tmp_path / "x.yaml"), "--budget", "0.1:0.2:2", "-o", str(out)]) == 4
    assert run(["tradeoff", str(tmp_path / "x.yaml"), "--budget", "3:1", "-o", str(out)]) == 2


def test_caps_at_full_size_have_tight_bounds(tmp_path: Path) -> None:
    p: Any
    share = 0.5
    p = written(tmp_path, BASE, ("intervals: 9", "intervals: 300"))
    free = oc.solve(p).result["observation_cost"]
    r = oc.solve(replace(p, rules=Constraints(max_observation_cost=share * free), minimise="error")).result
    assert r["observation_cost"] <= share * free * (1 + 1e-9)
    assert 0 <= r["relative_gap"] < 6e-3
    # the price is that of the relaxation whose use is the cap: a plain solve at that cost weight
    at_price = oc.solve(replace(p, cost_weight=r["multipliers"]["max_observation_cost"])).result
    bound = at_price["relaxed_lower_bound"] - at_price["cost_weight"] * share * free
    assert r["lower_bound"] == pytest.approx(bound, rel=2e-4)
    e = at_price["prediction_error"]
    q = oc.solve(replace(p, rules=Constraints(max_error=e), minimise="observation")).result
    assert q["prediction_error"] <= e * (1 + 1e-9) and 0 <= q["relative_gap"] < 2e-2
    assert q["lower_bound"] <= at_price["observation_cost"]  # that schedule has just this error


def test_what_a_certified_schedule_is_told(tmp_path: Path) -> None:
    p = written(tmp_path, BASE, more="constraints: {max_observation_cost: 3.0, max_switches: 3}\n")
    solution = oc.solve(p)
    said = oc.certify(p, solution.schedule).message
    assert "search goes on" not in said
    assert "Whether a better one exists is for solve to find out." in said or "proven optimal" in said


def test_too_many_sets_name_the_key_and_the_rule(tmp_path: Path) -> None:
    sensors = "".join(f"  - {{name: s{j}, C: [[1, 0]], noise: [[0.1]]}}\n" for j in range(12))
    changes = (("  - idle\n", sensors), ("objective:", "select: 5\nobjective:"))
    p = written(tmp_path, BASE, *changes, more="constraints: {max_switches: 3, switch_cost: 0.1}\n")
    with pytest.raises(UsageError) as error:
        oc.solve(p)
    words = "select: 5 of 14 sensors makes more than 400 sets of sensors, too many to search with max_switches, "
    assert f"{words}switch_cost" in str(error.value)


def test_rules_that_no_cap_can_meet_are_refused(tmp_path: Path) -> None:
    p = written(tmp_path, BASE, ("  - idle\n", ""))
    with pytest.raises(InfeasibleError, match="max_observation_cost"):
        oc.tradeoff(p, budgets=[0.1])

"""Closed loops on simulated truth: linear plants against theory, batches, seeds, verdicts and refusals."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import occontrol as oc
from occontrol.cli import run as command
from occontrol.core.errors import UsageError
from occontrol.core.monitor import Monitor
from occontrol.families.athans.nonlinear.linearise import Replanning
from occontrol.families.athans.readings.filter import weights_on
from occontrol.families.athans.replanning.chain import chain_of
from occontrol.families.athans.replanning.monte_carlo import POLICIES, compare
from occontrol.families.athans.replanning.online import ReplanningLoop
from occontrol.families.athans.replanning.planner import Planner

LINEAR = """\
family: athans
name: two radars
horizon: {steps: 10}
plant:
  F: [[1, 1], [0, 0.9]]
  Q: {diag: [0.05, 0.2]}
  initial: {mean: [3, -1], covariance: {diag: [25, 4]}}
sensors:
  - {name: near, H: [[1, 0]], R: [["0.5+0.1*k"]], cost: 0.4}
  - {name: rate, H: [[0, 1]], R: [[0.3]], cost: 0.1}
  - idle
objective: {cost_weight: 1, output: [[1, 0]], running: {diag: [0.05, 0]}}
"""
BEARINGS = """\
family: athans
name: bearings
horizon: {start: 0, end: 9, samples: 10, predict_at: 11}
sensing: samples
plant:
  f: [x3, x4, 0, 0]
  noise: {diag: [0, 0, 0.02, 0.02]}
  initial: {mean: [15, 45, 2.2, -0.6], covariance: {diag: [4, 4, 0.0225, 0.0225]}}
sensors:
  - {name: west, h: ["atan2(x2, x1)"], angle: true, noise: [[0.0004]]}
  - {name: east, h: ["atan2(x2, x1-100)"], angle: true, noise: [[0.0004]], visible: "80-x1"}
objective: {output: [[1, 0, 0, 0], [0, 1, 0, 0]], running: {diag: [1, 1, 0, 0]}}
replan: {every: 3}
"""


def solved(folder: Path, text: str) -> tuple:
    """The problem of a text and its solution."""
    path = folder / "problem.yaml"
    path.write_text(text, encoding="utf-8")
    problem = oc.read_problem(path)
    return problem, oc.solve(problem)


def test_a_linear_plant_errs_as_its_plan_says_and_replanning_changes_nothing(tmp_path: Path) -> None:
    problem, solution = solved(tmp_path, LINEAR)
    found = compare(problem, solution, ["nominal"], 600, 3, Monitor(), early=False).policies
    planned = solution.result["prediction_error"] + solution.result["running_cost"]
    nominal = found["nominal"]
    assert abs(nominal["mean"] - planned) < 4 * nominal["standard_error"]
    assert nominal["cost"] == pytest.approx(nominal["mean"] + solution.result["observation_cost"], rel=1e-12)
    assert abs(nominal["nees"] - 1) < 4 * np.sqrt(2 / (600 * 10))  # of neighbouring readings it is correlated
    again = compare(problem, solution, ["nominal", "replanned"], 12, 3, Monitor()).policies["replanned"]
    assert again["difference"] == 0 and again["milliseconds"] > 0
    assert nominal["lost"] == 0 and nominal["diverged"] == 0


def test_a_wrong_filter_would_be_seen(tmp_path: Path) -> None:
    problem, solution = solved(tmp_path, LINEAR)
    from occontrol.families.athans.replanning import runs

    true, updated = runs.predicted, runs.updated
    try:
        runs.predicted = lambda P, F, Q: true(P, F, 0.2 * Q)
        found = compare(problem, solution, ["nominal"], 300, 3, Monitor()).policies["nominal"]
    finally:
        runs.predicted, runs.updated = true, updated
    assert found["nees"] > 1.3


@pytest.mark.parametrize("text", [LINEAR, BEARINGS])
def test_the_numbers_do_not_depend_on_batches(tmp_path: Path, text: str) -> None:
    problem, solution = solved(tmp_path, text)
    first = compare(problem, solution, None, 11, 5, Monitor())
    second = compare(problem, solution, None, 11, 5, Monitor(), batch=4)
    assert list(first.policies) == list(POLICIES)
    for name, row in first.policies.items():
        other = dict(second.policies[name])
        assert {**row, "milliseconds": 0} == {**other, "milliseconds": 0}
    third = compare(problem, solution, ["nominal"], 11, 6, Monitor()).policies["nominal"]
    assert third["mean"] != first.policies["nominal"]["mean"]


def test_a_plan_for_the_rest_costs_what_the_rest_of_the_problem_costs(tmp_path: Path) -> None:
    """The rest from the planned covariance: its optimum is that of the problem posed anew, by solve."""
    problem, solution = solved(tmp_path, LINEAR)
    k, chain = 4, chain_of(problem)
    weights = weights_on(problem, solution.schedule)
    mean, P = np.asarray(problem.plant.mean), problem.plant.covariance
    for i in range(k):
        _, F, Q = chain.span(i, mean[None])
        P = F[0] @ P @ F[0].T + Q[0]
        for j in np.flatnonzero(weights[i, :2]):
            seen = chain.seen(i, int(j), mean[None])
            P = np.linalg.inv(np.linalg.inv(P) + seen.slope[0].T @ np.linalg.inv(seen.noise[0]) @ seen.slope[0])
    _, F, Q = chain.span(k, mean[None])
    P = F[0] @ P @ F[0].T + Q[0]
    made = Planner(chain, gap=1e-6).plan(k, mean, P, weights)
    rest = LINEAR.replace("steps: 10", "steps: 6").replace("0.1*k", "0.1*(k+4)")
    rest = rest.replace("covariance: {diag: [25, 4]}", f"covariance: {P.tolist()}")
    _, again = solved(tmp_path, rest)
    assert made.cost == pytest.approx(again.result["relaxed_lower_bound"], rel=0.2)
    assert made.lower_bound <= again.cost * (1 + 1e-9) <= made.cost * (1 + 1e-6) * 1.02
    np.testing.assert_array_equal(made.weights, weights[k:])  # nothing was lost: the plan stays the plan


def test_a_loop_plans_anew_and_an_expired_deadline_keeps_the_old_plan(tmp_path: Path, monkeypatch) -> None:
    problem, solution = solved(tmp_path, BEARINGS)
    truth = np.array([14.0, 46.0, 2.3, -0.6])
    stations = {"west": (0.0, 0.0), "east": (100.0, 0.0)}

    def fly(loop: ReplanningLoop) -> list:
        steps = []
        for k in range(problem.readings):
            x, y = truth[:2] + k * truth[2:]
            z = {s: np.array([np.arctan2(y - stations[s][1], x - stations[s][0])]) for s in loop.next_sensors}
            steps.append(loop.step(z))
        return steps

    steps = fly(ReplanningLoop(problem, solution.schedule))
    made = [s.replan for s in steps if s.replan is not None]
    assert [m.k for m in made] == [3, 6, 9]
    assert all(m.lower_bound <= m.cost and not m.late for m in made)
    assert steps[-1].prediction == pytest.approx(truth[:2] + 11 * truth[2:], abs=3)
    first = weights_on(problem, solution.schedule)
    slow = ReplanningLoop(problem, solution.schedule, Replanning(every=3, deadline=1e-9))
    late = [s.replan for s in fly(slow) if s.replan is not None]
    assert [m.late for m in late] == [True, True, True]
    np.testing.assert_array_equal(slow.weights, first)


def test_the_horizon_of_a_plan_recedes(tmp_path: Path) -> None:
    problem, solution = solved(tmp_path, LINEAR)
    weights = weights_on(problem, solution.schedule)
    mean, P = np.zeros(2), np.diag([5.0, 1.0])
    made = Planner(chain_of(problem), horizon=3).plan(2, mean, P, weights)
    assert made.weights.shape == (8, 3)
    np.testing.assert_array_equal(np.delete(made.relaxed, [2, 3, 4], axis=0), np.delete(weights, [2, 3, 4], axis=0))
    np.testing.assert_array_equal(made.weights[3:], weights[5:])


def test_what_is_spent_of_a_budget_is_spent(tmp_path: Path) -> None:
    text = LINEAR.replace("objective:", "budget: {total: 4}\nobjective:")
    problem, solution = solved(tmp_path, text)
    weights = weights_on(problem, solution.schedule)
    made = Planner(chain_of(problem)).plan(5, np.zeros(2), np.diag([50.0, 9.0]), weights)
    assert np.sum(weights[:5, :2]) + np.sum(made.weights[:, :2]) == 4


def test_the_command_prints_a_table_a_verdict_and_json(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    Path("radars.yaml").write_text(LINEAR, encoding="utf-8")
    assert command(["montecarlo", "radars.yaml", "--runs", "20", "--seed", "2"]) == 0
    text = capsys.readouterr().out
    assert "verdict  20 runs, all intervals together at 95%." in text and "greedy-information" in text
    folder = Path("runs/radars-montecarlo")
    assert sorted(p.name for p in folder.iterdir()) == ["montecarlo.html", "montecarlo.json", "montecarlo.png"]
    words = ["montecarlo", "radars.yaml", "--runs", "20", "--seed", "2", "--policies", "nominal,greedy", "--json"]
    assert command([*words, "--no-figures"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert set(found["policies"]) == {"nominal", "greedy"} and found["runs"] == 20
    keys = {"mean", "median", "standard_error", "diverged", "nees", "nis", "cost", "lost", "milliseconds"}
    assert keys <= set(found["policies"]["greedy"])


@pytest.mark.slow
def test_several_processes_find_the_same_numbers(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    Path("b.yaml").write_text(BEARINGS, encoding="utf-8")
    found = []
    for jobs in ("1", "2"):
        words = ["montecarlo", "b.yaml", "--runs", "8", "--jobs", jobs, "--json", "--no-figures"]
        assert command([*words, "--policies", "nominal,replanned"]) == 0
        rows = json.loads(capsys.readouterr().out)["policies"]
        found.append({name: {**row, "milliseconds": 0} for name, row in rows.items()})
    assert found[0] == found[1]


def test_refusals_say_what_there_is(tmp_path: Path) -> None:
    problem, solution = solved(tmp_path, LINEAR)
    with pytest.raises(UsageError, match="did you mean 'greedy'"):
        compare(problem, solution, ["gredy"], 10, 1, Monitor())
    capped = LINEAR.replace("objective:", "constraints: {max_error: 60}\nobjective:")
    ruled, planned = solved(tmp_path, capped)
    with pytest.raises(UsageError, match="policy 'replanned' does not keep these rules and budgets"):
        compare(ruled, planned, ["replanned"], 10, 1, Monitor())
    with pytest.raises(UsageError, match="max_error is a promise made before anything is read"):
        ReplanningLoop(ruled, planned.schedule)
    ruled, planned = solved(tmp_path, LINEAR.replace("objective:", "constraints: {max_switches: 3}\nobjective:"))
    with pytest.raises(UsageError, match="a horizon that recedes does not see the rules"):
        ReplanningLoop(ruled, planned.schedule, Replanning(horizon=3))
    rate = oc.read_problem(Path(__file__).resolve().parents[4] / "problems" / "scalar_on_off.yaml")
    with pytest.raises(UsageError, match="not of continuous sensing"):
        compare(rate, solution, None, 10, 1, Monitor())

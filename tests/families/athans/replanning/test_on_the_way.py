"""Plans on the way under rules, after changes and too late: against enumeration and the problem posed anew."""

from __future__ import annotations

import itertools
import time
from pathlib import Path

import numpy as np
import pytest

import occontrol as oc
from occontrol.core.errors import InfeasibleError, ProblemError
from occontrol.core.monitor import Monitor
from occontrol.families.athans.nonlinear.linearise import Replanning
from occontrol.families.athans.readings.filter import weights_on
from occontrol.families.athans.readings.rules import frame_of
from occontrol.families.athans.replanning import planner as planning
from occontrol.families.athans.replanning.chain import chain_of
from occontrol.families.athans.replanning.monte_carlo import compare
from occontrol.families.athans.replanning.online import ReplanningLoop
from occontrol.families.athans.replanning.planner import Planner
from occontrol.scheduling.rules.check import keeps, switching_cost

TEXT = """\
family: athans
name: two radars
horizon: {steps: 9}
plant:
  F: [[1, 1], [0, 0.9]]
  Q: {diag: [0.05, 0.2]}
  initial: {mean: [3, -1], covariance: {diag: [25, 4]}}
sensors:
  - {name: near, H: [[1, 0]], R: [["0.5+0.1*k"]], cost: 0.4}
  - {name: rate, H: [[0, 1]], R: [[0.3]], cost: 0.1}
  - idle
RULES
objective: {cost_weight: 1, output: [[1, 0]], running: {diag: [0.05, 0]}}
"""
F, Q = np.array([[1, 1], [0, 0.9]]), np.diag([0.05, 0.2])
ROWS = (np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]]))
RULES = {
    "dwell": "constraints: {min_on: 3}",
    "changes": "constraints: {max_switches: 3, switch_cost: 0.3}",
    "uses and rest": "constraints: {max_uses: 4, min_off: 2}",
    "share": "constraints: {max_share: 0.4, after: enforce, min_on: 2}",
    "spending": "constraints: {max_observation_cost: 1.6}",
    "warming": "constraints: {min_on: 2}",
}


def solved(folder: Path, rules: str = "", **changes: str) -> tuple:
    """The problem with these rules and its solution."""
    text = TEXT.replace("RULES", rules)
    for old, new in changes.items():
        text = text.replace(old.replace("_", " "), new)
    path = folder / "problem.yaml"
    path.write_text(text, encoding="utf-8")
    problem = oc.read_problem(path)
    return problem, oc.solve(problem)


def rest_cost(on: np.ndarray, measuring: np.ndarray, k: int, P: np.ndarray, prices: tuple = (0.4, 0.1)) -> float:
    """What readings k .. cost from P before them, by the plain filter."""
    cost = 0.0
    for i in range(k, len(on)):
        information = np.linalg.inv(P)
        for j, (H, R) in enumerate(zip(ROWS, (0.5 + 0.1 * i, 0.3), strict=True)):
            cost += prices[j] * on[i, j]
            information = information + measuring[i, j] * H.T @ H / R
        P = np.linalg.inv(information)
        cost += 0.05 * P[0, 0]
        P = F @ P @ F.T + Q
    return cost + P[0, 0]


def best_by_enumeration(problem: oc.Problem, weights: np.ndarray, k: int, P: np.ndarray, warm: int = 0) -> float:
    """The least that a schedule which begins as `weights` does and keeps all rules costs from reading k on."""
    frame, best = frame_of(problem), np.inf
    for chosen in itertools.product(range(3), repeat=len(weights) - k):
        on = np.zeros((len(weights), 3), dtype=bool)
        on[:k] = weights[:k] > 0.5
        on[np.arange(k, len(weights)), chosen] = True
        spent = float(np.sum(frame.spend * on))
        if keeps(frame.rules, frame.edges, on) and spent <= frame.rules.max_observation:
            measuring = on.copy()
            if warm:
                fresh = on & ~np.vstack([np.zeros((1, 3), dtype=bool), on[:-1]])
                measuring[:, 0] &= ~fresh[:, 0]
            changes = switching_cost(frame.rules, on) - switching_cost(frame.rules, on[:k])
            best = min(best, rest_cost(on, measuring, k, P) + changes)
    return best


@pytest.mark.parametrize("name", list(RULES))
def test_what_was_done_counts_for_the_rules(tmp_path: Path, name: str) -> None:
    sensor = {"cost:_0.4": "cost: 0.4, warm_up: 1"} if name == "warming" else {}
    problem, solution = solved(tmp_path, RULES[name], **sensor)
    weights, P = weights_on(problem, solution.schedule), np.diag([30.0, 3.0])
    planner = Planner(chain_of(problem), gap=1e-6)
    for k in (2, 4):
        made = planner.plan(k, np.zeros(2), P, weights)
        whole = np.concatenate([weights[:k], made.weights]) > 0.5
        frame = frame_of(problem)
        assert keeps(frame.rules, frame.edges, whole)
        assert np.sum(frame.spend * whole) <= frame.rules.max_observation
        best = best_by_enumeration(problem, weights, k, P, warm=len(sensor))
        read = np.concatenate([np.zeros((k, 3)), made.measuring])
        changes = switching_cost(frame.rules, whole) - switching_cost(frame.rules, whole[:k])
        assert made.cost == pytest.approx(rest_cost(whole, read, k, P) + changes, rel=1e-9)
        assert made.lower_bound <= best * (1 + 1e-9)
        before = weights > 0.5
        kept = switching_cost(frame.rules, before) - switching_cost(frame.rules, before[:k])
        kept += rest_cost(before, planner.measuring(weights), k, P)
        assert best * (1 - 1e-9) <= made.cost <= kept * (1 + 1e-9)
        if name != "spending":  # a plan on the way is not searched to the end
            assert made.cost <= 1.1 * best
    if sensor:
        assert np.any(planner.measuring(weights) < weights)


def test_under_rules_nothing_lost_changes_nothing(tmp_path: Path) -> None:
    problem, solution = solved(tmp_path, RULES["changes"])
    found = compare(problem, solution, ["nominal", "replanned"], 6, 3, Monitor()).policies
    assert found["replanned"]["difference"] == 0 and found["replanned"]["late"] == 0
    weights = weights_on(problem, solution.schedule)
    frame = frame_of(problem)
    spent = np.sum(frame.spend * weights) + switching_cost(frame.rules, weights > 0.5)
    assert found["nominal"]["cost"] - found["nominal"]["mean"] == pytest.approx(spent, rel=1e-12)


def to(loop: ReplanningLoop, k: int) -> None:
    """Read what the loop asks for until reading k."""
    while loop.k < k:
        loop.step({name: np.array([1.0]) for name in loop.next_sensors})


@pytest.mark.parametrize("change", [{"cost:_0.4": "cost: 0.4, windows: [[0, 4]]"}, {"cost:_0.4": "cost: 40"}])
def test_windows_and_prices_may_change_on_the_way(tmp_path: Path, change: dict) -> None:
    problem, solution = solved(tmp_path, **{"R:_[[0.3]]": "R: [[30]]"})
    loop = ReplanningLoop(problem, solution.schedule, Replanning(every=100))
    to(loop, 5)
    assert np.any(loop.weights[5:, 0] > 0)
    changed, _ = solved(tmp_path, **{"R:_[[0.3]]": "R: [[30]]"}, **change)
    made = loop.change(changed)
    assert made is not None and made.k == 5
    assert not np.any(loop.weights[5:, 0] > 0)
    while not loop.finished:
        assert "near" not in loop.next_sensors
        loop.step({name: np.array([1.0]) for name in loop.next_sensors})


def test_the_plan_after_a_change_is_that_of_the_rest_posed_anew(tmp_path: Path) -> None:
    problem, solution = solved(tmp_path)
    loop = ReplanningLoop(problem, solution.schedule, Replanning(every=100, gap=1e-6))
    to(loop, 3)
    P = loop.covariance[0]
    made = loop.change(solved(tmp_path, **{"cost:_0.1": "cost: 0.6"})[0])
    rest = {"steps:_9": "steps: 6", "0.1*k": "0.1*(k+3)", "cost:_0.1": "cost: 0.6"}
    _, again = solved(tmp_path, **rest, **{"{diag:_[25,_4]}": str(P.tolist())})
    assert made.lower_bound <= again.cost * (1 + 1e-9)
    # a plan on the way is rounded and exchanged, the rest posed anew is searched
    assert again.numbers.lower_bound <= made.cost * (1 + 1e-9) <= 1.05 * again.cost


def test_what_cannot_go_on_is_said(tmp_path: Path) -> None:
    problem, solution = solved(tmp_path)
    loop = ReplanningLoop(problem, solution.schedule, Replanning(every=100))
    used = np.argmax(loop.weights, axis=1)
    k = int(np.flatnonzero(used != used[0])[0]) + 1
    to(loop, k)
    with pytest.raises(InfeasibleError, match=f"goes on from what was done before reading {k}"):
        loop.change(solved(tmp_path, "constraints: {max_switches: 0}")[0])
    with pytest.raises(ProblemError, match="other sensors, states or readings"):
        loop.change(solved(tmp_path, **{"steps:_9": "steps: 8"})[0])
    assert loop.problem is problem and not loop.due  # as if nobody had asked
    loop.step({})


def test_a_slow_plan_is_dropped_and_counted(tmp_path: Path, monkeypatch) -> None:
    text = Path(__file__).with_name("test_monte_carlo.py").read_text(encoding="utf-8")
    bearings = text.split('BEARINGS = """\\\n')[1].split('"""')[0].replace("every: 3", "every: 3, deadline: 0.1")
    (tmp_path / "b.yaml").write_text(bearings, encoding="utf-8")
    problem = oc.read_problem(tmp_path / "b.yaml")
    solution = oc.solve(problem)
    true = planning.minimise_relaxed

    def slow(*arguments):
        time.sleep(0.12)
        return true(*arguments)

    monkeypatch.setattr(planning, "minimise_relaxed", slow)
    found = compare(problem, solution, ["nominal", "replanned"], 4, 3, Monitor()).policies
    assert found["replanned"]["late"] == 1.0 and found["replanned"]["difference"] == 0.0
    assert found["nominal"]["late"] is None


@pytest.mark.parametrize("beyond", ["steps: 9", "start: 0, end: 4, samples: 9, predict_at: 6.5"])
def test_without_plans_the_loop_is_the_matched_filter(tmp_path: Path, beyond: str) -> None:
    text = TEXT.replace("RULES", "")
    if "samples" in beyond:
        text = text.replace("horizon: {steps: 9}", f"horizon: {{{beyond}}}\nsensing: samples").replace("*k", "*t")
        for old, new in (("F: [[1, 1], [0, 0.9]]", "A: [[0, 1], [0, -0.1]]"), ("Q:", "noise:"), ("H:", "C:")):
            text = text.replace(old, new)
        text = text.replace("R:", "noise:")
    text = text.replace("output: [[1, 0]]", "output: [[1, 2], [0.5, 1]]")
    (tmp_path / "p.yaml").write_text(text, encoding="utf-8")
    problem = oc.read_problem(tmp_path / "p.yaml")
    solution = oc.solve(problem)
    loop, other = ReplanningLoop(problem, solution.schedule, Replanning(every=100)), oc.online(problem, solution)
    draw = np.random.default_rng(2)
    while not loop.finished:
        assert loop.next_sensors == tuple(other.next_sensors)
        readings = {name: draw.standard_normal(1) for name in loop.next_sensors if draw.random() < 0.8}
        ours, theirs = loop.step(readings), other.step(readings)
        np.testing.assert_allclose(ours.estimate, theirs.estimate, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(ours.covariance, theirs.covariance, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(ours.prediction, theirs.prediction, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(ours.prediction_covariance, theirs.prediction_covariance, rtol=1e-9)

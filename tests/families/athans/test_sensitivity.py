"""Derivatives of the relaxed optimum against differences of costs and of problems solved again."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import occontrol as oc
from occontrol.api import sensitivity
from occontrol.cli import run
from occontrol.core.errors import UsageError
from occontrol.core.monitor import Monitor
from occontrol.core.scaled_signal import scaled
from occontrol.families.athans.integration.integrator import Integrator
from occontrol.families.athans.sensitivity import with_sensor
from occontrol.scheduling.relaxation import RelaxedOptions

PROBLEMS = Path(__file__).resolve().parents[3] / "problems"
RADARS = """\
family: athans
name: two radars
horizon: {start: 0, end: 10, intervals: 200, predict_at: 12}
plant:
  A: [[0, 1], ["-(1+0.2*sin(t))", -0.4]]
  noise: [[0, 0], [0, 0.5]]
  initial: {mean: [1, 0], covariance: {diag: [5, 5]}}
sensors:
  - {name: range, C: [[1, 0]], noise: [[0.1]], cost: 2.0, windows: [[0, 4], [9.2, 10]]}
  - {name: doppler, C: [[0, 1]], noise: [[0.4]], cost: 0.5}
  - {name: dear, C: [[1, 0], [0, 1]], noise: {diag: [0.3, 0.3]}, cost: 40}
  - idle
objective: {cost_weight: 0.01, output: [[1, 0]]}
"""


def problem_of(folder: Path, text: str = RADARS) -> oc.SchedulingProblem:
    """The problem of a text."""
    path = folder / "problem.yaml"
    path.write_text(text, encoding="utf-8")
    return oc.read_problem(path)


def optimum(problem: oc.SchedulingProblem, start: np.ndarray | None = None) -> tuple[float, np.ndarray]:
    """J* of the relaxation in the user's own states, to 1e-9, and its policy."""
    from occontrol.families.athans.integration.relaxed import relax

    found = relax(Integrator(problem, 1e-9), RelaxedOptions(1e-9, 3000), Monitor(), start).outcome
    return found.cost, found.weights


def priced(problem: oc.SchedulingProblem, j: int, added: float) -> oc.SchedulingProblem:
    """The problem with another constant price of sensor j."""
    sensor = problem.sensors[j]
    return with_sensor(problem, j, replace(sensor, cost=float(sensor.cost.at(0.0)[0, 0]) + added))


def noisier(problem: oc.SchedulingProblem, j: int, factor: float) -> oc.SchedulingProblem:
    """The problem with the noise of sensor j times a factor."""
    sensor = problem.sensors[j]
    root = np.sqrt(factor) * np.ones(sensor.rows)
    return with_sensor(problem, j, replace(sensor, noise=scaled(sensor.noise, root, root)))


def test_prices_and_noises_are_those_of_problems_solved_again(tmp_path: Path) -> None:
    problem = problem_of(tmp_path)
    found, (_, v) = sensitivity(problem), optimum(problem)
    for j, name in enumerate(["range", "doppler"]):
        ends = [optimum(priced(problem, j, e), v)[0] for e in (-0.001, 0.001)]
        assert found.sensors[name]["price"] == pytest.approx((ends[1] - ends[0]) / 0.002, rel=1e-4)
        ends = [optimum(noisier(problem, j, np.exp(e)), v)[0] for e in (-0.01, 0.01)]
        assert found.sensors[name]["noise"] == pytest.approx((ends[1] - ends[0]) / 0.02, rel=1e-4)


def test_a_sensor_enters_at_its_entry_price_and_not_above(tmp_path: Path) -> None:
    problem = problem_of(tmp_path)
    found = sensitivity(problem).sensors["dear"]
    assert found["share"] < 1e-12 and found["entry_price"] < 0
    cost, v = optimum(problem)
    for share, enters in ((0.99, False), (1.01, True)):
        again, policy = optimum(priced(problem, 2, share * found["entry_price"]), v)
        assert (np.max(policy[:, 2]) > 1e-4) == enters
        assert (again < cost * (1 - 1e-8)) == enters


def test_a_further_row_is_worth_what_its_matrix_says(tmp_path: Path) -> None:
    problem = problem_of(tmp_path)
    found, (_, v) = sensitivity(problem), optimum(problem)
    sensor, precision = problem.sensors[1], 1e-3
    for state in range(2):
        row = np.eye(2)[state : state + 1]
        C, noise = np.vstack([sensor.C.at(0.0), row]), np.diag([0.4, 1 / precision])
        more = with_sensor(problem, 1, replace(sensor, C=C, noise=noise))
        gained = Integrator(more, 1e-8).evaluate(v).cost - Integrator(problem, 1e-8).evaluate(v).cost
        assert found.sensors["doppler"]["states"][state] == pytest.approx(gained / precision, rel=2e-3)
    matrix = np.array(found.sensors["doppler"]["noise_matrix"])
    assert np.sum(matrix * 0.4) == pytest.approx(found.sensors["doppler"]["noise"], rel=1e-5)


def test_an_end_of_a_window_is_worth_what_moving_it_gives(tmp_path: Path) -> None:
    problem = problem_of(tmp_path)
    ends = {(w["t"], w["end"]): w for w in sensitivity(problem).windows}
    assert set(ends) == {(4, "end"), (9.2, "start")}
    at = ends[9.2, "start"]
    moved = 2e-3
    costs = [optimum(problem_of(tmp_path, RADARS.replace("9.2", f"{9.2 + e}")))[0] for e in (moved, -moved)]
    assert at["longer"] < 0 < at["shorter"]
    assert at["longer"] == pytest.approx((costs[1] - costs[0]) / (2 * moved), rel=5e-3)
    assert at["shorter"] == pytest.approx(-at["longer"], rel=1e-9)


def test_one_more_place_costs_no_less_than_is_said(tmp_path: Path) -> None:
    text = RADARS.replace("cost_weight: 0.01", "cost_weight: 0.001")
    problem = problem_of(tmp_path, text)
    said = sensitivity(problem).select["one_more"]
    wider, _ = optimum(problem_of(tmp_path, text.replace("objective:", "select: 2\nobjective:")))
    assert said <= wider < 0.999 * optimum(problem)[0]


def test_certified_changes_hold_the_differences(tmp_path: Path) -> None:
    problem = problem_of(tmp_path)
    found = sensitivity(problem, change=0.1)
    cost, v = optimum(problem)
    assert set(found.changes) == {"range", "doppler"}
    for j, name in enumerate(found.changes):
        for word, factor in (("-10 %", 0.9), ("+10 %", 1.1)):
            low, high = found.changes[name][f"noise {word}"]
            moved = optimum(noisier(problem, j, factor), v)[0] - cost
            assert low - 1e-9 <= moved <= high + 1e-9 and high - low < 1e-6
            linear = found.sensors[name]["noise"] * np.log(factor)
            assert moved == pytest.approx(linear, rel=0.1)


def test_other_units_of_the_states_change_nothing_but_the_states_rows(tmp_path: Path) -> None:
    first = sensitivity(problem_of(tmp_path))
    metres = RADARS.replace("[[0, 1], [", "[[0, 1000], [").replace("sin(t))", "sin(t))/1000")
    metres = metres.replace("diag: [5, 5]", "diag: [5.0e6, 5]").replace("mean: [1, 0]", "mean: [1000, 0]")
    metres = metres.replace("C: [[1, 0]], n", "C: [[0.001, 0]], n").replace("C: [[1, 0], [0", "C: [[0.001, 0], [0")
    metres = metres.replace("output: [[1, 0]]", "output: [[0.001, 0]]")
    other = sensitivity(problem_of(tmp_path, metres))
    for name, sensor in first.sensors.items():
        assert other.sensors[name]["noise"] == pytest.approx(sensor["noise"], rel=1e-4, abs=1e-12)
        scaled_rows = np.array(other.sensors[name]["states"]) / [1e6, 1]
        np.testing.assert_allclose(scaled_rows, sensor["states"], rtol=1e-3, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["attitude_telemetry", "reentry_waveforms", "scalar_on_off"])
def test_derivatives_of_shipped_problems_are_those_of_the_policy_held_fixed(name: str) -> None:
    """J* moves as J does at its policy (envelope theorem): differences at a fixed policy have no solver in them."""
    problem = oc.read_problem(PROBLEMS / f"{name}.yaml")
    found, (_, v) = sensitivity(problem), optimum(problem)
    for j, sensor in enumerate(problem.sensors):
        if sensor.rows and found.sensors[sensor.name]["share"] > 1e-3:
            ends = [Integrator(noisier(problem, j, np.exp(e)), 1e-8).evaluate(v).cost for e in (-0.002, 0.002)]
            assert found.sensors[sensor.name]["noise"] == pytest.approx((ends[1] - ends[0]) / 0.004, rel=1e-4)


def test_readings_have_prices_and_noises_too() -> None:
    problem = oc.read_problem(PROBLEMS / "radar_discrete.yaml")
    found = sensitivity(problem)
    solution = oc.solve(problem, oc.Relaxed(1e-8))
    used = {name: float(solution.schedule.weights[:, j].sum()) for j, name in enumerate(problem.sensors.names)}
    for name, sensor in found.sensors.items():
        assert sensor["time"] == pytest.approx(used[name], abs=1e-2)
    sensors = list(problem.sensors)
    j = next(j for j, s in enumerate(sensors) if s.name == "far radar")
    costs = []
    for e in (-0.01, 0.01):
        dearer = replace(sensors[j], cost=0.5 + e)
        changed = replace(problem, sensors=replace(problem.sensors, sensors=(*sensors[:j], dearer, *sensors[j + 1 :])))
        costs.append(oc.solve(changed, oc.Relaxed(1e-8)).cost)
    assert found.sensors["far radar"]["price"] == pytest.approx((costs[1] - costs[0]) / 0.02, rel=1e-3)


def test_rules_and_other_families_are_refused_with_a_reason(tmp_path: Path) -> None:
    ruled = problem_of(tmp_path, RADARS.replace("objective:", "constraints: {max_switches: 4}\nobjective:"))
    with pytest.raises(UsageError, match="sensitivities are those of a problem without rules"):
        sensitivity(ruled)
    with pytest.raises(UsageError, match="cannot say what a price, a noise or a window is worth"):
        sensitivity(oc.read_problem(PROBLEMS / "robust_oscillator.yaml"))


def test_the_command_prints_a_table_and_writes_json_and_picture(tmp_path: Path, capsys, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "two_radars.yaml").write_text(RADARS, encoding="utf-8")
    assert run(["solve", "two_radars.yaml", "--no-figures"]) == 0
    capsys.readouterr()
    assert run(["sensitivity", "runs/two_radars"]) == 0
    text = capsys.readouterr().out
    assert "per 1 % more noise" in text and "one more place  no schedule at these edges would cost less than" in text
    folder = tmp_path / "runs" / "two_radars-sensitivity"
    assert sorted(p.name for p in folder.iterdir()) == ["sensitivity.json", "sensitivity.png"]
    written = json.loads((folder / "sensitivity.json").read_text())
    assert run(["sensitivity", "runs/two_radars", "--json", "--no-figures"]) == 0
    assert json.loads(capsys.readouterr().out)["sensors"] == written["sensors"]

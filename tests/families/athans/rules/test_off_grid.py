"""Switch times off the grid: slopes and costs by an ODE solver of SciPy, rules kept, grids that end alike."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import occontrol as oc
from occontrol.core.errors import ProblemError
from occontrol.core.schedule import Schedule
from occontrol.families.athans.continuous.reintegration import switching_at_edges
from occontrol.families.athans.methods import RelaxRoundPolish
from occontrol.families.athans.rules.off_grid import _breaks, off_grid
from tests.families.athans.problem_texts import written

BASE = """\
family: athans
name: off the grid
horizon: {start: 0, end: 4, intervals: 20, substeps: 1}
plant: {A: [[0, 1], [-1, -0.4]], noise: {diag: [0.0, 0.5]}, initial: {covariance: {diag: [5, 5]}}}
sensors:
  - {name: radar, C: [[1, 0]], noise: [[0.1]], cost: 0.5}
  - {name: sonar, C: [[0, 1]], noise: [[0.2]], cost: 0.2}
objective: {cost_weight: 0.1, output: [[1, 0]]}
"""
RUNNING = ("output: [[1, 0]]}", "output: [[1, 0]], running: {diag: [0.2, 0.1]}}")


def by_an_ode_solver(p: Any, times: np.ndarray, order: list[int]) -> float:
    """J of the sensors of `order` on the pieces between `times` (K+1,), by the Riccati equation and nothing else."""
    A, Q = p.plant.A.sample([0.0])[0], p.plant.noise.sample([0.0])[0]
    R = np.zeros((2, 2)) if p.running is None else p.running.sample([0.0])[0]
    S, total = np.append(p.plant.covariance.ravel(), 0.0), 0.0
    for k, j in enumerate(order):
        sensor = p.sensors[j]
        C = sensor.C.sample([0.0])[0]
        L = C.T @ np.linalg.inv(sensor.noise.sample([0.0])[0]) @ C

        def rate(t: float, y: np.ndarray, L: np.ndarray = L) -> np.ndarray:
            P = y[:4].reshape(2, 2)
            return np.append((A @ P + P @ A.T + Q - P @ L @ P).ravel(), np.trace(R @ P))

        S = solve_ivp(rate, times[k : k + 2], S, method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
        total += p.cost_weight * float(sensor.cost.sample([0.0])[0, 0, 0]) * (times[k + 1] - times[k])
    D = p.output.sample([0.0])[0]
    return total + float(S[4]) + float(np.trace(D @ S[:4].reshape(2, 2) @ D.T))


@pytest.mark.parametrize("changes", [(), (RUNNING,)])
def test_cost_and_slope_are_those_of_an_ode_solver(tmp_path: Path, changes: tuple) -> None:
    p: Any = written(tmp_path, BASE, *changes)
    times, order = np.array([0.0, 0.913, 2.2, 3.017, 4.0]), [0, 1, 0, 1]
    cost, s = switching_at_edges(p, Schedule(times, np.eye(2)[order], ("radar", "sonar")))
    assert cost == pytest.approx(by_an_ode_solver(p, times, order), rel=1e-9)
    for i in (1, 2, 3):
        step = np.zeros(5)
        step[i] = 1e-4
        slope = (by_an_ode_solver(p, times + step, order) - by_an_ode_solver(p, times - step, order)) / 2e-4
        assert s[i, order[i - 1]] - s[i, order[i]] == pytest.approx(slope, rel=1e-5, abs=1e-8)


@pytest.mark.parametrize(
    "limits",
    [
        "{min_on: 0.7, max_switches: 2, max_observation_cost: 1.1}",
        "{max_switches: 2, switch_delay: {radar: {sonar: 0.3}, sonar: {radar: 0.3}}}",
        "{max_switches: 3, min_off: 0.55, max_share: 0.6}",
    ],
)
def test_moved_times_keep_the_rules_and_cost_less_in_the_exact_flow(tmp_path: Path, limits: str) -> None:
    p: Any = written(tmp_path, BASE, RUNNING, more=f"constraints: {limits}\n")
    on_grid = oc.solve(replace(p, method=RelaxRoundPolish(exact={"max_nodes": 10})))
    moved = off_grid(p, on_grid.schedule)
    assert moved is not None
    assert moved.after < moved.before
    assert moved.before == pytest.approx(on_grid.result["continuous"]["cost"], rel=1e-8)
    judged = oc.certify(p, moved.schedule)  # every rule is checked again, on edges that have the times
    assert judged.result["continuous"]["cost"] == pytest.approx(moved.after, rel=1e-8)
    if "delay" not in limits:
        names = p.sensors.names
        order = [names.index(seg["sensors"][0]) for seg in moved.schedule.segments()]
        assert moved.after == pytest.approx(by_an_ode_solver(p, moved.schedule.edges, order), rel=1e-8)
    # nothing near is better: a stationary point, or a rule that holds a time
    for i in range(1, len(moved.schedule.edges) - 1):
        for d in (-0.01, 0.01):
            edges = moved.schedule.edges.copy()
            edges[i] += d
            near = Schedule(edges, moved.schedule.weights, moved.schedule.names)
            assert _breaks(p, near) or switching_at_edges(p, near)[0] >= moved.after * (1 - 1e-9)


def test_coarse_and_fine_grids_end_alike(tmp_path: Path) -> None:
    costs = []
    for intervals in (30, 60):
        text = BASE.replace("intervals: 20", f"intervals: {intervals}") + "constraints: {max_switches: 2}\n"
        p: Any = written(tmp_path, text, RUNNING, more="method: {name: schedule, exact: true, off_grid: true}\n")
        solution = oc.solve(p)
        r = solution.result
        costs.append(r["continuous"]["cost"])
        assert "Switch times were moved off the grid by up to" in solution.message
        assert r["proven_optimal"] and r["continuous"]["lower_bound"] <= costs[-1]
        still = oc.solve(replace(p, method=RelaxRoundPolish(exact=True))).result["continuous"]["cost"]
        assert costs[-1] < still
        again = oc.certify(p, solution.schedule).result
        assert again["continuous"]["cost"] == pytest.approx(costs[-1], rel=1e-9)
    assert costs[0] == pytest.approx(costs[1], rel=1e-8)


def test_what_cannot_be_moved_is_said(tmp_path: Path) -> None:
    more = "constraints: {max_switches: 0}\nmethod: {name: schedule, off_grid: true}\n"
    p: Any = written(tmp_path, BASE, more=more)
    assert "Its switch times stay" in oc.solve(p).message
    text = BASE.replace("intervals: 20, substeps: 1", "sample_times: [1]")
    text = text + "sensing: samples\nmethod: {name: schedule, off_grid: true}\n"
    with pytest.raises(ProblemError, match="readings have instants of their own"):
        oc.solve(written(tmp_path, text))

"""Problems whose formulas jump: the same numbers as with held tables, and as an integration in pieces by SciPy."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import occontrol as oc

RATE = """
family: athans
horizon: {start: 0, end: 10, intervals: 16}
plant:
  A: <A>
  noise: <X>
  initial: {mean: [1, 0], covariance: {diag: [5, 5]}}
sensors:
  - {name: range, C: [[1, 0]], noise: <THETA>, cost: <COST>}
  - {name: doppler, C: <C>, noise: [[0.4]], cost: 0.5}
objective: {cost_weight: 0.1, output: [[1, 0]], running: <R>}
"""
FORMULAS = {
    "<A>": '[[0, 1], ["if_else(t < 3.3, -1, -2)", -0.4]]',
    "<X>": '[[0, 0], [0, "0.5 + step(t - 6.1)"]]',
    "<THETA>": '[["0.1*(1 + 2*(t > 7.77))"]]',
    "<COST>": '"2 - 1.5*(1.15 <= t < 4)"',
    "<C>": '[[0, "1 + (t >= 5)"]]',
    "<R>": '[["0.01*step(t - 2.5)", 0], [0, 0]]',
}
TABLES = {
    "<A>": "{times: [0, 3.3], values: [[[0, 1], [-1, -0.4]], [[0, 1], [-2, -0.4]]], interpolation: previous}",
    "<X>": "{times: [0, 6.1], values: [[[0, 0], [0, 0.5]], [[0, 0], [0, 1.5]]], interpolation: previous}",
    "<THETA>": "{times: [0, 7.77], values: [[[0.1]], [[0.3]]], interpolation: previous}",
    "<COST>": "{times: [0, 1.15, 4], values: [[[2]], [[0.5]], [[2]]], interpolation: previous}",
    "<C>": "{times: [0, 5], values: [[[0, 1]], [[0, 2]]], interpolation: previous}",
    "<R>": "{times: [0, 2.5], values: [[[0, 0], [0, 0]], [[0.01, 0], [0, 0]]], interpolation: previous}",
}


def problem(folder: Path, parts: dict[str, str], text: str = RATE) -> oc.SchedulingProblem:
    for key, value in parts.items():
        text = text.replace(key, value)
    path = folder / "p.yaml"
    path.write_text(text)
    return oc.read_problem(path)  # type: ignore[return-value]


def test_formulas_that_jump_are_held_tables(tmp_path: Path) -> None:
    formulas, tables = problem(tmp_path, FORMULAS), problem(tmp_path, TABLES)
    assert formulas.added_edges == tables.added_edges and len(formulas.added_edges) == 5
    one, other = oc.solve(formulas), oc.solve(tables)
    # the numbers are the same; sums of a library may depend on where in memory they lie
    assert one.certificate.lower_bound == pytest.approx(other.certificate.lower_bound, rel=1e-13)
    assert one.cost == pytest.approx(other.cost, rel=1e-13)
    assert one.schedule.weights == pytest.approx(other.schedule.weights, abs=1e-12)
    assert one.arrays["covariance"] == pytest.approx(other.arrays["covariance"], rel=1e-12)


def by_scipy(A, X, L, R, marks, S, rate) -> float:
    """J of continuous time: covariance, running and observation cost from mark to mark."""
    total, n = 0.0, len(S)
    for a, b in pairwise(marks):
        middle = (a + b) / 2

        def flow(t, y, middle=middle):
            P = y[:-1].reshape(n, n)
            change = A(middle) @ P + P @ A(middle).T + X(middle) - P @ L(middle) @ P
            return np.append(change.ravel(), np.trace(R(middle) @ P) + rate(middle))

        y = solve_ivp(flow, (a, b), np.append(S.ravel(), total), method="DOP853", rtol=1e-11, atol=1e-13).y[:, -1]
        S, total = y[:-1].reshape(n, n), float(y[-1])
    return total + float(S[0, 0])


def test_a_schedule_costs_what_an_integration_in_pieces_says(tmp_path: Path) -> None:
    stated = problem(tmp_path, FORMULAS)
    weights = np.zeros((stated.intervals, 2))
    early = stated.midpoints < 4.4
    weights[early, 0] = weights[~early, 1] = 1.0
    schedule = oc.Schedule(stated.edges, weights, tuple(stated.sensors.names))
    switch = float(stated.edges[1:][early][-1])

    def L(t: float) -> np.ndarray:
        return np.diag([1 / 0.1, 0]) if t < switch else np.diag([0, (2 if t > 5 else 1) ** 2 / 0.4])

    cost = by_scipy(
        lambda t: np.array([[0, 1], [-1 if t < 3.3 else -2, -0.4]]),
        lambda t: np.diag([0, 0.5 if t < 6.1 else 1.5]),
        L,
        lambda t: np.diag([0.0 if t < 2.5 else 0.01, 0]),
        sorted({0, 1.15, 2.5, 3.3, 4, switch, 5, 6.1, 7.77, 10}),
        np.diag([5.0, 5.0]),
        lambda t: 0.1 * ((0.5 if 1.15 <= t < 4 else 2.0) if t < switch else 0.5),
    )
    found = oc.certify(stated, schedule)
    assert found.result["continuous"]["cost"] == pytest.approx(cost, rel=3e-8)
    assert found.certificate.cost == pytest.approx(cost, rel=1e-5)


def test_jumps_where_a_sine_changes_its_sign(tmp_path: Path) -> None:
    """A square wave by a formula and by a table at the multiples of pi: edges, cost and bound agree."""
    wave = {**FORMULAS, "<X>": '[[0, 0], [0, "1.5 - step(sin(t))"]]'}
    values = ", ".join(f"[[0, 0], [0, {x}]]" for x in (0.5, 1.5, 0.5, 1.5))
    times = ", ".join(repr(k * np.pi) for k in range(4))
    table = {**wave, "<X>": f"{{times: [{times}], values: [{values}], interpolation: previous}}"}
    one, other = problem(tmp_path, wave), problem(tmp_path, table)
    assert [why for _, why in one.added_edges] == [why for _, why in other.added_edges]
    assert one.edges == pytest.approx(other.edges, abs=4e-15)
    found, wanted = oc.solve(one), oc.solve(other)
    assert found.result["top"]["cost"] == pytest.approx(wanted.result["top"]["cost"], rel=1e-9)
    assert found.result["top"]["lower_bound"] == pytest.approx(wanted.result["top"]["lower_bound"], rel=1e-7)


SAMPLES = """
family: athans
horizon: {start: 0, end: 4, sample_times: [0.5, 1, 1.5, 2, 2.5, 3, 3.5, 4]}
sensing: samples
plant: {A: <A>, noise: <X>, initial: {covariance: {diag: [2, 1]}}}
sensors:
  - {name: one, C: [[1, 0]], noise: [[0.1]], cost: 0.2}
  - {name: two, C: <C>, noise: [[0.3]], cost: 0.05}
  - idle
objective: {cost_weight: 1, output: [[1, 0]], running: <R>}
"""


def test_readings_and_rules_of_robust_jump_alike(tmp_path: Path) -> None:
    parts = {
        "<A>": ('[[0, 1], ["-1 - (t > 1.23)", -0.4]]', [0, 1.23], [[[0, 1], [-1, -0.4]], [[0, 1], [-2, -0.4]]]),
        "<X>": ('{diag: [0, "0.5 + step(t - 2.71)"]}', [0, 2.71], [[[0, 0], [0, 0.5]], [[0, 0], [0, 1.5]]]),
        "<C>": ('[[0, "1 + 2*(t >= 3)"]]', [0, 3], [[[0, 1]], [[0, 3]]]),
        "<R>": ('{diag: ["0.1*(t < 1.7)", 0]}', [0, 1.7], [[[0.1, 0], [0, 0]], [[0, 0], [0, 0]]]),
    }
    table = "{{times: {}, values: {}, interpolation: previous}}"
    one = problem(tmp_path, {key: part[0] for key, part in parts.items()}, SAMPLES)
    other = problem(tmp_path, {key: table.format(*part[1:]) for key, part in parts.items()}, SAMPLES)
    found, wanted = oc.solve(one), oc.solve(other)
    assert found.certificate.cost == wanted.certificate.cost
    assert found.certificate.lower_bound == wanted.certificate.lower_bound


ROBUST = """
family: robust
horizon: {end: 1.0, slots: 3}
plant:
  A: <A>
  B: [[0], [1]]
  K: [[0.1, 0]]
  initial: {center: [1, 0], weight: {identity: 2}, level: 1}
sensors:
  - {name: one, C: [[1, 0]]}
  - {name: two, C: <C>}
size: trace
"""


def test_robust_switching_sees_the_jump(tmp_path: Path) -> None:
    formulas = {"<A>": '[[0, 1], ["if_else(t < 0.4, -1, 3)", 0]]', "<C>": '[[0, "1 + step(t - 0.77)"]]'}
    tables = {
        "<A>": "{times: [0, 0.4], values: [[[0, 1], [-1, 0]], [[0, 1], [3, 0]]], interpolation: previous}",
        "<C>": "{times: [0, 0.77], values: [[[0, 1]], [[0, 2]]], interpolation: previous}",
    }
    one, other = problem(tmp_path, formulas, ROBUST), problem(tmp_path, tables, ROBUST)
    found, wanted = oc.solve(one), oc.solve(other)
    assert found.result["cost"] == pytest.approx(wanted.result["cost"], rel=1e-12)
    assert found.result["schedule"] == wanted.result["schedule"]
    still = oc.solve(problem(tmp_path, {**formulas, "<A>": "[[0, 1], [-1, 0]]"}, ROBUST))
    assert abs(still.result["cost"] - found.result["cost"]) > 1e-3

"""States in other units: the same numbers, to the last bit for powers of two; and cases with known answers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from occontrol import read_problem, solve
from occontrol.core.errors import ProblemError
from occontrol.core.plant import LinearPlant
from occontrol.core.scaled_signal import scaled
from occontrol.core.sensor import Sensor, idle_sensor
from occontrol.core.solution import Status
from occontrol.families.athans.balanced import balanced, state_units
from occontrol.families.athans.certify import certify
from occontrol.families.athans.filter.online import make_plan
from occontrol.families.athans.filter.sampled_model import exact_model
from occontrol.families.athans.integration.options import Integration
from occontrol.families.athans.methods import RelaxRoundPolish
from occontrol.families.athans.problem import SchedulingProblem, uniform_edges

CASES = Path(__file__).resolve().parents[2] / "data" / "soundness"


def random_problem(seed: int, varying: bool = False) -> SchedulingProblem:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 5))
    A = rng.normal(size=(n, n)) - 0.5 * np.eye(n)
    if varying:
        A = [[f"{x}*(1 + 0.3*sin(2*t))" if i == j else float(x) for j, x in enumerate(row)] for i, row in enumerate(A)]
    G, S = rng.normal(size=(n, n)), rng.normal(size=(n, n))
    sensors = [Sensor(f"s{j}", rng.normal(size=(1, n)), [[0.1 + rng.random()]], 0.3 * rng.random()) for j in range(2)]
    running = rng.normal(size=(n, n)) if seed % 2 else None
    return SchedulingProblem(
        "random",
        LinearPlant(A, G @ G.T, S @ S.T, B=rng.normal(size=(n, 1)), input=["sin(t)"]),
        [*sensors, idle_sensor(n)],
        uniform_edges(0.0, 2.0, 12),
        rng.normal(size=(1, n)),
        predict_at=2.5,
        running=None if running is None else running.T @ running,
    )


def in_units(problem: SchedulingProblem, e: np.ndarray) -> SchedulingProblem:
    """The same problem in the states e x, written by hand."""
    p, one = problem.plant, np.ones
    both = np.outer(e, e)
    plant = LinearPlant(
        scaled(p.A, e, 1 / e), scaled(p.noise, e, e), p.covariance * both, p.mean * e, scaled(p.B, e, one(1)), p.input
    )
    sensors = [replace(s, C=scaled(s.C, one(s.rows), 1 / e)) for s in problem.sensors]
    running = None if problem.running is None else scaled(problem.running, 1 / e, 1 / e)
    return replace(problem, plant=plant, sensors=sensors, output=scaled(problem.output, one(1), 1 / e), running=running)


@pytest.mark.parametrize("varying", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_powers_of_two_change_no_bit(seed, varying):
    problem = random_problem(seed, varying)
    e = 2.0 ** np.random.default_rng(seed).integers(-30, 31, size=problem.states)
    a, b = solve(problem), solve(in_units(problem, e))
    names = ("cost", "lower_bound", "allowance", "prediction_error", "relaxed_cost", "discretisation_error", "schedule")
    assert {k: a.result[k] for k in names} == {k: b.result[k] for k in names}
    assert a.result["continuous"] == b.result["continuous"]
    both = np.outer(e, e)
    np.testing.assert_array_equal(b.arrays["weights"], a.arrays["weights"])
    np.testing.assert_array_equal(b.arrays["switching"], a.arrays["switching"])
    np.testing.assert_array_equal(b.arrays["covariance"], a.arrays["covariance"] * both)
    np.testing.assert_array_equal(b.arrays["costate"], a.arrays["costate"] / both)
    for name in ("gain", "continuous_gain"):
        np.testing.assert_array_equal(b.arrays[name], a.arrays[name] * e[:, None])


@pytest.mark.parametrize("seed", range(4))
def test_other_factors_change_rounding_only(seed):
    problem = random_problem(seed)
    e = 10.0 ** np.random.default_rng(seed).uniform(-6, 6, size=problem.states)
    a, there = solve(problem), in_units(problem, e)
    b = certify(there, a.schedule)
    assert b.cost == pytest.approx(a.cost, rel=1e-12)
    assert b.result["continuous"]["cost"] == pytest.approx(a.result["continuous"]["cost"], rel=1e-9)
    assert solve(there).result["relaxed_lower_bound"] == pytest.approx(a.result["relaxed_lower_bound"], rel=2e-4)
    covariance = a.arrays["covariance"] * np.outer(e, e)
    np.testing.assert_allclose(b.arrays["covariance"], covariance, rtol=1e-9, atol=0)


@pytest.mark.parametrize("seed", range(3))
def test_costs_times_a_constant_and_order_of_states(seed):
    problem = random_problem(seed)
    a = solve(problem)
    dearer = [replace(s, cost=float(s.cost.at(0.0)[0, 0]) * 1e7) for s in problem.sensors]
    running = None if problem.running is None else problem.running.at(0.0) * 1e7
    scaled_costs = replace(problem, sensors=dearer, output=problem.output.at(0.0) * np.sqrt(1e7), running=running)
    b = certify(scaled_costs, a.schedule)
    assert b.cost == pytest.approx(1e7 * a.cost, rel=1e-12)
    order = np.random.default_rng(seed).permutation(problem.states)
    p = problem.plant
    turned = replace(
        problem,
        plant=LinearPlant(
            p.A.at(0.0)[np.ix_(order, order)], p.noise.at(0.0)[np.ix_(order, order)], p.covariance[np.ix_(order, order)]
        ),
        sensors=[replace(s, C=s.C.at(0.0)[:, order]) for s in problem.sensors],
        output=problem.output.at(0.0)[:, order],
        running=None if problem.running is None else problem.running.at(0.0)[np.ix_(order, order)],
    )
    assert certify(turned, a.schedule).cost == pytest.approx(a.cost, rel=1e-12)


def test_an_irrelevant_state_does_not_change_the_units_of_the_others():
    problem = random_problem(2)
    n, p = problem.states, problem.plant

    def wider(matrix, corner=0.0):
        full = np.zeros((n + 1, n + 1))
        full[:n, :n], full[n, n] = matrix, corner
        return full

    def longer(rows):
        return np.column_stack([rows, np.zeros(len(rows))])

    wide = replace(
        problem,
        plant=LinearPlant(wider(p.A.at(0.0)), wider(p.noise.at(0.0), 1e30), wider(p.covariance)),
        sensors=[replace(s, C=longer(s.C.at(0.0))) for s in problem.sensors],
        output=longer(problem.output.at(0.0)),
        running=None if problem.running is None else wider(problem.running.at(0.0)),
    )
    np.testing.assert_array_equal(state_units(wide).factors[:n], state_units(problem).factors)
    assert certify(wide, solve(problem).schedule).cost == pytest.approx(solve(problem).cost, rel=1e-12)


def test_the_exact_filter_keeps_its_digits_in_badly_scaled_states():
    problem = random_problem(3)
    schedule = solve(problem).schedule
    e = 10.0 ** np.array([9.0, -9.0, 4.0, -2.0])[: problem.states]
    a, b = (make_plan(exact_model(p, schedule)) for p in (problem, in_units(problem, e)))
    np.testing.assert_allclose(b.covariance / np.outer(e, e), a.covariance, rtol=1e-9)


def two_units() -> SchedulingProblem:
    A = [[-0.8, 6.984919309616089e-11], [7730941132.8, 0.9]]
    plant = LinearPlant(A, np.diag([1.3969838619232177e-10, 2576980377.6]), np.diag([2.3283064365386963e-10, 2.0**32]))
    sensors = [Sensor("a", [[65536.0, 0.0]], [[1.0]]), idle_sensor(2)]
    return SchedulingProblem("units", plant, sensors, [0.0, 2.0], [[65536.0, 1.52587890625e-05]], cost_weight=0.0)


def resonator(rate: float) -> SchedulingProblem:
    """An LC circuit in SI units: charge and current, 24 intervals over 12 radians."""
    plant = LinearPlant(
        [[0, 1], [-(rate**2), -0.05 * rate]],
        [[0, 0], [0, 1e-3 * rate]],
        np.diag([1e-24, 1e-24 * (rate / 1e11) ** 2 * 1e22]),
    )
    sensors = [
        Sensor("charge", [[1e12, 0]], [[0.1 / rate]], 0.3 * rate),
        Sensor("current", [[0, 1e12 / rate]], [[0.3 / rate]], 0.05 * rate),
        idle_sensor(2),
    ]
    method = RelaxRoundPolish(relative_gap=1e-7)
    edges = uniform_edges(0.0, 12 / rate, 24)
    return SchedulingProblem("resonator", plant, sensors, edges, [[1e12, 0]], cost_weight=0.1, method=method)


def on_the_grid(problem: SchedulingProblem) -> SchedulingProblem:
    """One step an interval: the recursion that the known optima were found for."""
    return replace(problem, integration=Integration(substeps=1, windows="cover"))


def test_two_states_of_different_units():
    found = solve(on_the_grid(two_units()))
    assert found.cost == pytest.approx(126.0805400, rel=1e-9)
    assert found.result["lower_bound"] <= found.cost
    assert found.result["continuous"]["cost"] == pytest.approx(81.464235, rel=1e-8)
    top = solve(two_units())
    assert top.cost == pytest.approx(81.464235, rel=1e-7)
    assert top.result["continuous"]["cost"] == pytest.approx(81.464235, rel=1e-8)
    assert top.result["lower_bound"] <= 81.464235 * (1 + 1e-8)


def test_a_resonator_in_si_units():
    found = solve(on_the_grid(resonator(1e11)))
    assert found.cost == pytest.approx(0.1313610106, rel=1e-9)
    assert found.result["lower_bound"] == pytest.approx(0.1313610106, rel=1e-6)
    top = solve(resonator(1e11))
    assert top.status is Status.CERTIFIED and top.result["relative_gap"] <= 1e-5
    assert abs(top.cost - top.result["continuous"]["cost"]) <= 1e-6 * top.cost


def test_no_bound_above_a_known_policy_in_states_that_differ_by_1e15():
    problem = read_problem(CASES / "scale_50_8.json")
    assert np.ptp(np.log10(np.diag(problem.plant.covariance)) / 2) > 12
    grid, top = solve(on_the_grid(problem)), solve(problem)
    assert grid.result["lower_bound"] <= 4.7139 and grid.result["relaxed_cost"] == pytest.approx(4.7139, rel=2e-5)
    continuous = top.result["continuous"]
    assert continuous["lower_bound"] <= top.cost <= grid.result["continuous"]["cost"]
    assert abs(top.cost - continuous["cost"]) <= 1e-5 * top.cost and top.result["lower_bound"] <= continuous["cost"]


def test_a_running_weight_slightly_below_zero_is_named_as_that():
    plant = LinearPlant(np.zeros((2, 2)), 1e-4 * np.eye(2), np.diag([1e-3, 1e14]))
    sensors = [Sensor("a", [[0.0, 1e-7]], [[1.0]], 1.0), idle_sensor(2)]
    edges = uniform_edges(0.0, 1.0, 4)
    running = np.diag([1.0, -9e-11])
    problem = SchedulingProblem("below", plant, sensors, edges, [[1.0, 0.0]], running=running)
    found = solve(problem)
    assert found.cost == pytest.approx(-8999.99785, rel=1e-9)
    assert found.status is Status.CERTIFIED
    assert found.result["lower_bound"] <= found.cost
    assert found.result["lower_bound"] == pytest.approx(found.cost, rel=1e-9)
    assert "The running weight is slightly below zero, within its tolerance" in found.message
    assert "rounding" not in found.message


def test_the_solution_belongs_to_the_user_s_problem():
    problem = resonator(1e11)
    found = solve(on_the_grid(problem))
    assert np.max(np.abs(np.log2(balanced(problem)[1].factors))) > 3
    np.testing.assert_allclose(found.arrays["covariance"][0], problem.plant.covariance)
    top = solve(problem)
    assert top.problem.plant is problem.plant and top.problem.output is problem.output
    assert [t for t, _ in top.problem.added_edges] == sorted(set(top.problem.edges) - set(problem.edges))
    np.testing.assert_array_equal(top.problem.edges, top.arrays["edges"])
    np.testing.assert_allclose(top.arrays["covariance"][0], problem.plant.covariance)
    again = certify(top.problem, top.schedule)
    assert again.cost == pytest.approx(top.cost, rel=1e-12)
    assert again.result["continuous"]["cost"] == pytest.approx(top.result["continuous"]["cost"], rel=1e-12)


def test_edges_of_windows_are_named_whatever_the_units():
    problem = random_problem(1)
    sensor = replace(problem.sensors[0], windows=[(0.0, 1.05)])
    problem = replace(problem, sensors=[sensor, *list(problem.sensors)[1:]])
    assert balanced(problem)[0].added_edges == problem.added_edges == ((1.05, "window of s0 ends"),)
    assert solve(problem).result["added_edges"][0] == {"t": 1.05, "why": "window of s0 ends"}


def test_a_sensor_whose_rows_have_units_far_apart_is_definite():
    """1 m and 1e-10 rad: the smallest eigenvalue is 1e-20 of the largest, and nothing is singular."""
    Sensor("good", np.eye(2), np.diag([1.0, 1e-20]))
    problem = random_problem(0)
    n = problem.states
    C = np.eye(2, n)
    plain, apart = (
        replace(problem, sensors=[Sensor("s", np.diag(e) @ C, np.diag(e) @ [[1.0, 0.3], [0.3, 0.5]] @ np.diag(e))])
        for e in (np.ones(2), np.array([1.0, 2.0**-33]))
    )
    assert solve(apart).cost == pytest.approx(solve(plain).cost, rel=1e-12)
    nearly = np.array([[1.0, 1e-10], [1e-10, 1e-20]])
    with pytest.raises(ProblemError, match="noise of sensor 's' is not positive definite: its smallest eigenvalue is"):
        replace(problem, sensors=[Sensor("s", C, nearly)])

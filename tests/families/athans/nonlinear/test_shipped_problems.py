"""The shipped nonlinear problems: as expected, their costs by a plain filter, and the one that warns."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from occontrol.api import read_problem, run_filter, simulate, solve
from occontrol.cli import run
from occontrol.core.expression import parse_expression
from occontrol.families.athans.nonlinear.linearise import linearisation_of
from occontrol.numerics.consistency import judge_run

ROOT = Path(__file__).resolve().parents[4]
NAMES = ("bearings_only", "range_stations", "bioreactor", "orbit_stations")


@pytest.fixture(scope="module")
def solved():
    known = {}

    def of(name):
        if name not in known:
            known[name] = solve(read_problem(ROOT / "problems" / f"{name}.yaml"))
        return known[name]

    return of


def numbers(formulas, plant):
    """Formulas as one Python function of state and time, evaluated by Python itself."""
    names = {
        **{name: getattr(np, name) for name in ("sin", "cos", "tanh", "exp", "sqrt", "hypot", "pi")},
        "atan2": np.arctan2,
        "abs": abs,
        "__builtins__": {},
    }
    for formula in formulas:
        if isinstance(formula, str):
            parse_expression(formula, (*plant.names, "t"))  # nothing but a formula goes to eval
    codes = [compile(str(formula).strip(), "formula", "eval") for formula in formulas]

    def value(x, t):
        return np.array(
            [float(eval(code, names, {**dict(zip(plant.names, x, strict=True)), "t": t})) for code in codes]
        )

    return value


def slope(function, x, t):
    """Central differences in the size of every state."""
    columns = []
    for i in range(len(x)):
        h = 1e-6 * max(abs(x[i]), 1.0)
        step = h * np.eye(len(x))[i]
        columns.append((function(x + step, t) - function(x - step, t)) / (2 * h))
    return np.column_stack(columns)


def plain_cost(problem, weights):
    """J of a schedule: path and variations by an adaptive solver, derivatives by differences, a plain filter."""
    origin = linearisation_of(problem)
    plant, n = origin.plant, len(origin.plant.names)
    m = len(plant.mean)
    f = numbers([*plant.formulas, *[0.0] * (n - m)], plant)
    noise = numbers([e for row in plant.noise for e in row], plant)

    def right(t, y):
        x, F, Q = y[:n], y[n : n + n * n].reshape(n, n), y[n + n * n :].reshape(n, n)
        A, Xi = slope(f, x, t), np.zeros((n, n))
        Xi[:m, :m] = noise(x, t).reshape(m, m)
        return np.concatenate([f(x, t), (A @ F).ravel(), (A @ Q + Q @ A.T + Xi).ravel()])

    x, S, now, total = plant.whole_mean, plant.whole_covariance, problem.clock.start, 0.0
    running = problem.running
    stops = [*problem.clock.times, problem.clock.end, problem.predict_at]
    for k, stop in enumerate(map(float, stops)):
        if stop > now:
            start = np.concatenate([x, np.eye(n).ravel(), np.zeros(n * n)])
            end = solve_ivp(right, (now, stop), start, "DOP853", rtol=1e-10, atol=1e-13).y[:, -1]
            F, x = end[n : n + n * n].reshape(n, n), end[:n]
            noisy = end[n + n * n :].reshape(n, n) if k <= len(weights) else 0.0
            S, now = F @ S @ F.T + noisy, stop
        for j in np.flatnonzero(weights[k] > 0) if k < len(weights) else ():
            sensor = origin.sensors.get(problem.sensors[j].name)
            total += problem.cost_weight * problem.sensors[j].cost.at(stop)[0, 0]
            if sensor is not None:
                H = slope(numbers(sensor.h, plant), x, stop)
                R = numbers([e for row in sensor.noise for e in row], plant)(x, stop).reshape(len(H), len(H))
                K = S @ H.T @ np.linalg.inv(H @ S @ H.T + R)
                S = (np.eye(n) - K @ H) @ S @ (np.eye(n) - K @ H).T + K @ R @ K.T
        if running is not None and k < len(weights):
            total += np.sum(running.at(stop) * S)
    D = problem.output.at(float(problem.predict_at))
    return total + np.trace(D @ S @ D.T)


@pytest.mark.slow
@pytest.mark.parametrize("name", [*NAMES[:-1], pytest.param(NAMES[-1], marks=pytest.mark.slow)])
def test_a_shipped_problem_meets_what_it_expects_and_a_plain_filter(name, solved):
    solution = solved(name)
    problem, result = solution.problem, solution.result
    expect = problem.expect
    assert result["cost"] == pytest.approx(expect["cost"], rel=expect["tolerance"])
    assert result["certificate_of"] == "linearised" and max(result["nonlinearity"].values()) < 1
    assert result["lower_bound"] <= result["cost"]
    assert result["cost"] == pytest.approx(plain_cost(problem, solution.arrays["weights"]), rel=2e-6)
    for seed in range(2):
        measurements, truth = simulate(problem, solution, seed)
        estimate = run_filter(problem, solution, measurements)
        error = truth.values[-1] - estimate.mean[-1]
        moved = np.diag(estimate.covariance[-1]) > 0
        P = estimate.covariance[-1][np.ix_(moved, moved)]
        assert error[moved] @ np.linalg.solve(P, error[moved]) < 5 * moved.sum()


@pytest.mark.slow
def test_the_plan_that_waits_is_warned_of(solved):
    """Right for the linearised problem, useless for the plant: the index says so, and simulated filters do, too."""
    solution = solved("orbit_idle_then_measure")
    problem, result = solution.problem, solution.result
    assert result["cost"] == pytest.approx(problem.expect["cost"], rel=problem.expect["tolerance"])
    assert result["relative_gap"] < 0.01
    assert result["nonlinearity"]["predictions"] > 10
    assert "a filter along it may diverge" in solution.message
    assert any("a filter along it may diverge" in warning for warning in result["warnings"])
    nees = []
    for seed in (1, 2, 3):
        measurements, truth = simulate(problem, solution, seed)
        estimate = run_filter(problem, solution, measurements)
        nees.append(float(np.mean(judge_run(estimate, truth).nees)) / 6)  # over the horizon, as `filter` prints it
    assert np.median(nees) > 5


def test_the_pendulum_of_the_page_is_25_lines_and_solves(tmp_path, capsys):
    page = (ROOT / "docs" / "nonlinear.md").read_text(encoding="utf-8")
    text = re.search(r"```yaml\n(.*?)```", page, re.DOTALL)[1]
    assert len(text.splitlines()) <= 25
    file = tmp_path / "pendulum.yaml"
    file.write_text(text)
    assert run(["check", str(file)]) == 0
    said = capsys.readouterr().out
    assert "32 substeps of a span" in said and "readings 0.0892, predictions 0.152" in said
    assert run(["solve", str(file), "--out", str(tmp_path / "run"), "--no-figures"]) == 0

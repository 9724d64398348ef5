"""Paths, derivatives and noise of nonlinear plants, by independent routes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad_vec, solve_ivp
from scipy.linalg import expm

from occontrol.core.signal import as_signal
from occontrol.families.athans.nonlinear.nominal import IntegratorOptions, make_nominal
from occontrol.families.athans.nonlinear.path import along, evaluate, times_above_zero
from occontrol.families.athans.nonlinear.plant import FormulaPlant
from occontrol.families.athans.nonlinear.sensor import FormulaSensor

PIECES = ["sin({})", "exp(-0.3*({}))", "tanh({})", "({})**2", "1/(2 + cos({}))", "sqrt(1 + ({})**2)", "atan({})"]


def random_formula(random: np.random.Generator, names: list[str], depth: int = 2) -> str:
    if depth == 0:
        return f"{random.uniform(-1, 1):.3f}*{random.choice(names)} + {random.uniform(-1, 1):.3f}"
    left = random.choice(PIECES).format(random_formula(random, names, depth - 1))
    right = random_formula(random, names, depth - 1)
    return f"({left}) {random.choice(['+', '-', '*'])} ({right})"


def plant_of(f, n, noise=None, mean=None, **more) -> FormulaPlant:
    zero = [[0.0] * n] * n
    return FormulaPlant(
        noise=noise or zero, covariance=np.eye(n), mean=mean if mean is not None else np.zeros(n), f=f, **more
    )


def test_derivatives_of_two_hundred_random_formulas_are_difference_quotients():
    random = np.random.default_rng(5)
    names, count = ["a", "b", "c"], 0
    for _ in range(50):
        formulas = [random_formula(random, [*names, "t"]) for _ in range(4)]
        count += 4
        plant = plant_of(formulas[:3], 3, states=names)
        sensor = FormulaSensor("one", [formulas[3]], [[1.0]], plant)
        x, t, h = random.normal(size=3), random.uniform(0, 2, size=1), 1e-5
        for function, slope in ((plant.right, plant.flow.slope), (sensor.values(), sensor.slope())):
            exact = evaluate(slope, x[None], t)[0]
            shifted = np.concatenate([x + h * np.eye(3), x - h * np.eye(3)])
            values = evaluate(function, shifted, np.repeat(t, 6))[:, :, 0]
            assert (values[:3] - values[3:]).T / (2 * h) == pytest.approx(
                exact, rel=1e-6, abs=1e-6 * (1 + np.abs(exact).max())
            )
        # the derivative of the whole map, too
        _, F, _ = plant.flow.across(x, float(t[0]), 0.3, 4)
        ends = [plant.flow.across(each, float(t[0]), 0.3, 4)[0] for each in shifted]
        assert (np.array(ends[:3]) - ends[3:]).T / (2 * h) == pytest.approx(F, rel=1e-6, abs=1e-6 * np.abs(F).max())
    assert count == 200


def test_the_path_is_that_of_an_adaptive_solver():
    plant = plant_of(["v", "(1 - x**2)*v - x + 0.3*cos(2*t)"], 2, mean=[1, 0], states=["x", "v"])
    since = np.array([0, 0.3, 0.3, 1.7, 4.0])
    nominal = make_nominal(plant, 2.0, since, IntegratorOptions())

    def right(t, y):
        return [y[1], (1 - y[0] ** 2) * y[1] - y[0] + 0.3 * np.cos(2 * t)]

    found = solve_ivp(right, (2, 6), [1, 0], "DOP853", rtol=1e-13, atol=1e-13, dense_output=True)
    assert nominal.spans.ends == pytest.approx(found.sol(2 + since[1:]).T, rel=1e-8, abs=1e-8)
    times = np.linspace(2, 6, 301)
    assert nominal.path.at(times) == pytest.approx(found.sol(times).T, rel=1e-6, abs=1e-6)


def test_maps_of_a_linear_plant_are_exponentials():
    A = np.array([[0, 1, 0], [0, 0, 1], [-1.0, -0.5, -0.2]])
    f = [" + ".join(f"({a})*x{j + 1}" for j, a in enumerate(row)) for row in A]
    plant = plant_of(f, 3, noise=[[0, 0, 0], [0, 0, 0], [0, 0, 0.7]])
    nominal = make_nominal(plant, 0.0, np.array([0, 0.5, 1.5]), IntegratorOptions(accuracy=1e-13))
    Xi = np.diag([0, 0, 0.7])
    for h, F, Q in zip((0.5, 1.0), nominal.spans.transition, nominal.spans.noise, strict=True):
        assert expm(A * h) == pytest.approx(F, abs=1e-12)
        exact, _ = quad_vec(lambda s: expm(A * s) @ Xi @ expm(A * s).T, 0, h, epsabs=1e-14)
        assert exact == pytest.approx(Q, abs=1e-10)
        assert np.linalg.eigvalsh(Q)[0] > 0


def test_the_noise_is_a_covariance_however_coarse_the_steps():
    """Five integrators in a row: the exact covariance of a short span is nearly singular."""
    plant = plant_of(["x2", "x3", "x4", "x5", 0], 5, noise=np.diag([0, 0, 0, 0, 1.0]).tolist())
    nominal = make_nominal(plant, 0.0, np.array([0, 3.0]), IntegratorOptions(substeps=1))
    assert np.linalg.eigvalsh(nominal.spans.noise[0])[0] >= -1e-12


def test_charges_of_the_running_integral():
    plant = plant_of(["x2", "-sin(x1)"], 2, noise=[[0, 0], [0, "0.1 + x1**2"]], mean=[1, 0])
    nominal = make_nominal(plant, 0.0, np.array([0, 0.8, 2.0]), IntegratorOptions())
    R = as_signal([["1 + 0.5*t", 0.2], [0.2, 0.3]])
    M, c = nominal.charges(R)
    S0 = np.array([[0.5, 0.1], [0.1, 0.4]])

    def right(t, y):
        x, S = y[:2], y[2:6].reshape(2, 2)
        A = np.array([[0, 1], [-np.cos(x[0]), 0]])
        Xi = np.diag([0, 0.1 + x[0] ** 2])
        return [x[1], -np.sin(x[0]), *(A @ S + S @ A.T + Xi).ravel(), np.sum(R.at(t) * S)]

    for k, (a, b) in enumerate(((0, 0.8), (0.8, 2.0))):
        start = np.append(nominal.path.at(np.array([float(a)]))[0], [*S0.ravel(), 0])
        end = solve_ivp(right, (a, b), start, "DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
        assert np.sum(M[k] * S0) + c[k] == pytest.approx(end[-1], rel=1e-8)
        F, Q = nominal.spans.transition[k], nominal.spans.noise[k]
        assert F @ S0 @ F.T + Q == pytest.approx(end[2:6].reshape(2, 2), rel=1e-7)


def test_a_stated_path_is_followed_instead_of_the_plant_s_own():
    column = as_signal([["cos(t)"], ["-sin(t)"]])
    plant = plant_of(["x2", "-x1**3"], 2, nominal=column, mean=[5, 5])
    nominal = make_nominal(plant, 0.0, np.array([0, 1.0, 2.0]), IntegratorOptions())
    times = np.array([0.3, 1.4])
    A = along(plant.flow.slope, nominal.path, 2).sample(times)
    assert A[:, 1, 0] == pytest.approx(-3 * np.cos(times) ** 2)

    def right(t, y):
        return (np.array([[0, 1], [-3 * np.cos(t) ** 2, 0]]) @ y.reshape(2, 2)).ravel()

    F = solve_ivp(right, (0, 1), np.eye(2).ravel(), rtol=1e-11, atol=1e-12).y[:, -1].reshape(2, 2)
    assert pytest.approx(F, rel=1e-4) == nominal.spans.transition[0]


def test_stretches_above_zero_are_found_to_the_resolution():
    plant = plant_of(["1"], 1)
    sensor = FormulaSensor("one", ["x1"], [[1.0]], plant, visible="cos(x1) - 0.2")
    nominal = make_nominal(plant, 0.0, np.array([0, 10.0]), IntegratorOptions())
    seen = sensor.seen()
    assert seen is not None
    found = times_above_zero(seen, nominal.path, np.linspace(0, 10, 60), 1e-9)
    edge = np.arccos(0.2)
    assert np.array(found) == pytest.approx(np.array([(0, edge), (2 * np.pi - edge, 2 * np.pi + edge)]), abs=1e-8)

"""Nonlinear plants: Lorenz-96 against NumPy, formulas, Jacobians against differences, refusals."""

import pickle

import numpy as np
import pytest

from occontrol.core.errors import ProblemError
from occontrol.families.precision.measurement import NonlinearMeasurement
from occontrol.families.precision.plant import NonlinearPlant


def lorenz(x, forcing=8.0):
    return (np.roll(x, -1, 0) - np.roll(x, 2, 0)) * np.roll(x, 1, 0) - x + forcing


def runge_kutta(x, h, count, right):
    for _ in range(count):
        a = right(x)
        b = right(x + h / 2 * a)
        c = right(x + h / 2 * b)
        x = x + h / 6 * (a + 2 * b + 2 * c + right(x + h * c))
    return x


def test_lorenz96_against_numpy():
    plant = NonlinearPlant(np.eye(20), model="lorenz96", step=0.05, substeps=20, parameters={"forcing": 7.0})
    states = np.random.default_rng(0).uniform(0, 8, (20, 41))
    expected = runge_kutta(states, 0.05, 20, lambda x: lorenz(x, 7.0))
    assert np.max(np.abs(plant.advance(states, 0.0) - expected)) < 1e-10
    assert plant.interval == 1.0


def test_formulas_with_a_step_are_a_rate_and_without_the_next_state():
    rate = NonlinearPlant(np.eye(2), f=["x2", "-x1 + 0*t"], step=0.01, substeps=100)
    assert np.allclose(rate.advance(np.array([[1.0], [0.0]]), 0.0)[:, 0], [np.cos(1), -np.sin(1)], atol=1e-9)
    following = NonlinearPlant(np.eye(2), f=["x2", "t"])
    assert np.allclose(following.advance(np.array([[1.0], [3.0]]), 7.0)[:, 0], [3.0, 7.0])


def test_time_runs_inside_the_step():
    plant = NonlinearPlant(np.eye(1), f=["2*t"], step=0.5, substeps=4)
    assert np.allclose(plant.advance(np.zeros((1, 1)), 3.0), 5.0**2 - 3.0**2)


def test_jacobians_against_differences():
    plant = NonlinearPlant(np.eye(3), f=["x2*x3", "sin(x1)", "x1 - x3*t"], step=0.1, substeps=3)
    measurement = NonlinearMeasurement(3, h=["hypot(x1, x2)", "atan2(x2, x3)"])
    x, e = np.array([0.4, -0.2, 1.3]), 1e-6
    for what, matrix in ((plant.advance, plant.jacobian(x, 1.0)), (measurement.values, measurement.jacobian(x, 1.0))):
        moved = [(x + e * d)[:, None] for d in np.eye(3)], [(x - e * d)[:, None] for d in np.eye(3)]
        columns = [(what(a, 1.0) - what(b, 1.0))[:, 0] / (2 * e) for a, b in zip(*moved, strict=True)]
        assert np.allclose(matrix, np.array(columns).T, atol=1e-8)


def test_pickles_after_use():
    plant = NonlinearPlant(np.eye(4), model="lorenz96", step=0.1)
    before = plant.advance(np.ones((4, 2)), 0.0)
    assert np.array_equal(pickle.loads(pickle.dumps(plant)).advance(np.ones((4, 2)), 0.0), before)
    sigmoid = NonlinearMeasurement(4, model="sigmoid")
    assert np.allclose(sigmoid.values(np.zeros((4, 2)), 0.0), 0.5)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"f": ["x1"]}, "f has 1 entries, the plant has 2 states"),
        ({"f": ["x1", "x3"]}, "unknown name 'x3'"),
        ({"f": ["x1", "x2"], "step": 0.0}, "step > 0"),
        ({"f": ["x1", "x2"], "substeps": 0}, "substeps is 0"),
        ({"model": "lorenz"}, "did you mean 'lorenz96'"),
        ({"model": "lorenz96", "step": 0.1}, "needs at least 4"),
        ({"model": "lorenz96"}, "needs a step"),
        ({"f": ["x1", "x2"], "mean": [1.0]}, "mean has 1 entries"),
        ({"f": ["x1", "x2"], "noise": -np.eye(2)}, "noise is not positive semidefinite"),
        ({}, "either f or model"),
    ],
)
def test_plant_refusals(options, words):
    with pytest.raises(ProblemError, match=words):
        NonlinearPlant(np.eye(2), **options)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"h": []}, "there is no sensor"),
        ({"h": ["x9"]}, "unknown name 'x9'"),
        ({"model": "sigmoide"}, "did you mean 'sigmoid'"),
        ({"h": ["x1", "x2"], "names": ["a", "a"]}, "used twice"),
        ({"h": ["x1"], "names": ["a", "b"]}, "2 names for 1 sensors"),
    ],
)
def test_measurement_refusals(options, words):
    with pytest.raises(ProblemError, match=words):
        NonlinearMeasurement(2, **options)

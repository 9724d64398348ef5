"""The discrete-time models against textbook formulas and brute force."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import occontrol
from occontrol.core.plant import LinearPlant
from occontrol.core.schedule import Schedule, constant_schedule
from occontrol.core.sensor import Sensor
from occontrol.families.athans.discretise import discretise, half_predicts
from occontrol.families.athans.filter.online import make_plan
from occontrol.families.athans.filter.predictor import make_predictor
from occontrol.families.athans.filter.sampled_model import exact_model, split_model
from occontrol.families.athans.filter.simulate import draw, simulate
from occontrol.families.athans.integration.options import Integration
from occontrol.families.athans.node_path import node_path
from occontrol.families.athans.problem import SchedulingProblem
from tests.families.athans.scheduling_cases import cycling, moving


def test_exact_model_of_the_integrator_is_known_in_closed_form():
    """dx = xi, z = average of x: cov(x+, z) and var z of a Wiener process are h/2 and h/3."""
    problem = SchedulingProblem("walk", LinearPlant(0, 3.0, 1.0, [2.0]), [Sensor("meter", 2.0, 0.7)], [0.0, 0.5], 1)
    model = exact_model(problem, Schedule(problem.edges, [[1.0]], ("meter",)))
    assert model.observe[0] == pytest.approx(2.0)
    assert model.noise[0] == pytest.approx(1.5)
    assert model.cross[0] == pytest.approx(2 * 3 * 0.5 / 2)
    assert model.reading_noise[0] == pytest.approx(4 * 3 * 0.5 / 3 + 0.7 / 0.5)


def test_exact_model_agrees_with_an_integration_of_the_moment_equations():
    """x, its running average and all their covariances, integrated as one linear system."""
    problem = moving(5)
    schedule = cycling(problem, shift=2)
    model = exact_model(problem, schedule)
    plant = problem.plant
    for k in (0, 3):
        a, b = problem.edges[k], problem.edges[k + 1]
        used = [problem.sensors[j] for j in model.active[k]]
        assert used
        m = sum(s.rows for s in used)

        def rate(t, flat, used=used, m=m, h=b - a):
            mean, P = flat[: 2 + m], flat[2 + m :].reshape(2 + m, 2 + m)
            A = np.zeros((2 + m, 2 + m))
            A[:2, :2] = plant.A.at(t)
            A[2:, :2] = np.vstack([s.C.at(t) for s in used]) / h
            push = np.concatenate([(plant.B.at(t) @ plant.input.at(t)).ravel(), np.zeros(m)])
            Q = np.zeros_like(P)
            Q[:2, :2] = plant.noise.at(t)
            return np.concatenate([A @ mean + push, (A @ P + P @ A.T + Q).ravel()])

        start = np.array([0.3, -0.8])
        flat = np.concatenate([start, np.zeros(m), np.zeros((2 + m) ** 2)])
        end = solve_ivp(rate, (a, b), flat, rtol=1e-11, atol=1e-13).y[:, -1]
        mean, P = end[: 2 + m], end[2 + m :].reshape(2 + m, 2 + m)
        tm = (a + b) / 2
        theta = [s.noise.at(tm) / (b - a) for s in used]
        R = np.zeros((m, m))
        at = 0
        for block in theta:
            R[at : at + len(block), at : at + len(block)] = block
            at += len(block)
        np.testing.assert_allclose(model.transition[k] @ start + model.input[k], mean[:2], atol=1e-9)
        np.testing.assert_allclose(model.observe[k] @ start + model.offset[k], mean[2:], atol=1e-9)
        np.testing.assert_allclose(model.noise[k], P[:2, :2], atol=1e-9)
        np.testing.assert_allclose(model.cross[k], P[:2, 2:], atol=1e-9)
        np.testing.assert_allclose(model.reading_noise[k], P[2:, 2:] + R, atol=1e-9)


@pytest.mark.parametrize("select", [1, 2])
def test_the_split_filters_covariance_is_the_schedules(select):
    problem = moving(60, select)
    schedule = cycling(problem)
    halves = half_predicts(problem)
    path = node_path(discretise(problem, halves), halves, schedule.weights)
    np.testing.assert_allclose(make_plan(split_model(problem, schedule)).covariance, path.covariance, rtol=1e-10)


def test_fractional_weights_read_every_sensor_with_more_noise():
    problem = moving(20)
    shares = np.tile([0.5, 0.3, 0.2, 0.0], (20, 1))
    schedule = Schedule(problem.edges, shares, tuple(problem.sensors.names))
    halves = half_predicts(problem)
    path = node_path(discretise(problem, halves), halves, shares)
    model = split_model(problem, schedule)
    assert model.dimension.tolist() == [4] * 20
    np.testing.assert_allclose(make_plan(model).covariance, path.covariance, rtol=1e-10)


def test_both_models_agree_in_the_limit_of_short_intervals():
    """Differences of the Riccati covariances at the end fall as h^2."""
    gaps = []
    for intervals in (20, 40, 80):
        problem = moving(intervals)
        problem = replace(problem, edges=np.linspace(0, 4, intervals + 1))
        weights = np.tile([1.0, 0, 0, 0], (intervals, 1))
        schedule = Schedule(problem.edges, weights, tuple(problem.sensors.names))
        ends = [make_plan(make(problem, schedule)).covariance[-1] for make in (split_model, exact_model)]
        gaps.append(np.max(np.abs(ends[0] - ends[1])))
    assert gaps[0] / gaps[1] == pytest.approx(4, rel=0.15) and gaps[1] / gaps[2] == pytest.approx(4, rel=0.1)


def test_simulation_has_the_moments_of_the_continuous_plant():
    """Sample mean and covariance of 4000 runs at the end against the integrated moment equations."""
    problem = moving(8)
    model = exact_model(problem, cycling(problem))
    states, _ = draw(model, range(4000))
    plant = problem.plant

    def rate(t, flat):
        P = flat[2:].reshape(2, 2)
        A = plant.A.at(t)
        return np.concatenate(
            [A @ flat[:2] + (plant.B.at(t) @ plant.input.at(t)).ravel(), (A @ P + P @ A.T + plant.noise.at(t)).ravel()]
        )

    end = solve_ivp(rate, (0, 4), np.concatenate([plant.mean, plant.covariance.ravel()]), rtol=1e-10).y[:, -1]
    P = end[2:].reshape(2, 2)
    error = states[:, -1] - end[:2]
    white = np.linalg.solve(np.linalg.cholesky(P), error.T)
    assert np.max(np.abs(np.mean(white, axis=1))) < 4 / np.sqrt(4000)
    np.testing.assert_allclose(np.cov(white), np.eye(2), atol=5 * np.sqrt(2 / 4000))


def test_the_same_seed_gives_the_same_data_and_another_does_not():
    problem = moving(12)
    first, again, other = (simulate(problem, cycling(problem), seed)[0] for seed in (5, 5, 6))
    assert all(np.array_equal(a.values, b.values) for a, b in zip(first, again, strict=True))
    assert not np.array_equal(first[0].values, other[0].values)
    assert [m.sensor for m in first[:3]] == ["place", "speed", "both"]
    assert first[0].time == problem.edges[1]


def test_predictor_against_brute_force_propagation():
    """D x(Tp) by integrating mean and covariance from each node to Tp, input and noise included."""
    problem = moving(10)
    model = split_model(problem, cycling(problem))
    predictor = make_predictor(problem, model)
    plant, D = problem.plant, problem.output.at(5.5)
    mean, P = np.array([0.4, -1.1]), np.array([[0.5, 0.2], [0.2, 0.3]])

    def rate(t, flat):
        A, C = plant.A.at(t), flat[2:].reshape(2, 2)
        push = (plant.B.at(t) @ plant.input.at(t)).ravel()
        return np.concatenate([A @ flat[:2] + push, (A @ C + C @ A.T + plant.noise.at(t)).ravel()])

    for k in (0, 4, 10):
        span = (problem.edges[k], 5.5)
        end = solve_ivp(rate, span, np.concatenate([mean, P.ravel()]), rtol=1e-11, atol=1e-13).y[:, -1]
        w, spread = predictor.predict(k, mean, P)
        np.testing.assert_allclose(w, D @ end[:2], atol=1e-8)
        np.testing.assert_allclose(spread, D @ end[2:].reshape(2, 2) @ D.T, atol=1e-8)


def test_constant_plant_uses_the_matrix_exponential():
    problem = replace(moving(4), edges=np.linspace(0, 4, 5))
    plant = replace(problem.plant, A=[[0, 1], [-1, -0.4]], noise=[[0, 0], [0, 0.3]], B=None, input=None)
    model = exact_model(replace(problem, plant=plant), cycling(problem))
    np.testing.assert_allclose(model.transition[2], expm(np.array([[0, 1], [-1, -0.4]])), atol=1e-13)
    assert not np.any(model.input)


def test_the_run_folders_gains_are_the_filters(small_solution):
    """gain_k of arrays.npz, carried over the second half of the interval, is the filter's node-to-node gain."""
    planned = make_plan(exact_model(small_solution.problem, small_solution.schedule))
    for stored, gain in zip(small_solution.arrays["gain"], planned.gain, strict=True):
        np.testing.assert_allclose(stored[:, : gain.shape[1]], gain, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(small_solution.arrays["filter_covariance"], planned.covariance, rtol=1e-10)
    # with one step of integration an interval the split filter is the matched one
    one = Integration(substeps=1, windows="cover")
    solution = occontrol.solve(replace(small_solution.problem, integration=one))
    problem, schedule = solution.problem, solution.schedule
    model = split_model(problem, schedule)
    plan, halves = make_plan(model), half_predicts(problem)
    stored, checked = solution.arrays["gain"], 0
    for k in range(problem.intervals):
        m = len(model.offset[k])
        wanted = halves.transition[halves.index[2 * k + 1]] @ stored[k, :, :m]
        np.testing.assert_allclose(plan.gain[k], wanted, rtol=1e-10, atol=1e-12)
        checked += m
    assert checked > 5


@pytest.mark.parametrize("model_of", [exact_model, split_model])
def test_unix_time_stamps_lose_no_digit_of_the_lengths(model_of):
    """Hundredths of a second at 1.7e9 are off by 2e-5 of themselves, and the sampled models must not see that."""
    origin, steps = 1.7e9, 100
    plant = LinearPlant([[0, 1], [-4, -0.2]], [[0, 0], [0, 0.4]], np.eye(2), B=[[0], [1]], input=[[2.0]])
    sensors = [Sensor("near", [[1, 0]], 0.3, 1.0), Sensor("far", [[0, 1]], 0.2, 0.4)]
    found = []
    for start in (0.0, origin):
        edges = start + np.linspace(0.0, 1.0, steps + 1)
        problem = SchedulingProblem("clock", plant, sensors, edges, [[1, 0]], predict_at=start + 1.5)
        weights = np.eye(2)[np.arange(steps) % 2]
        found.append((problem, model_of(problem, Schedule(problem.edges, weights, ("near", "far")))))
    (first, here), (second, there) = found
    for name in ("transition", "input", "noise", "observe", "offset", "reading_noise", "cross"):
        a, b = (np.array(getattr(model, name)) for model in (here, there))
        np.testing.assert_allclose(b, a, rtol=1e-12, atol=1e-14 * np.max(np.abs(a)))
    np.testing.assert_allclose(make_predictor(second, there).noise, make_predictor(first, here).noise, rtol=1e-12)


def test_a_known_input_moves_means_only():
    problem = SchedulingProblem(
        "driven",
        LinearPlant(A=[[0, 1], [-1, "-0.4*cos(t)"]], noise=[[0, 0], [0, 0.5]], covariance=np.eye(2), B=[[0], [1]],
                    input=["sin(t)"]),
        [Sensor("a", [[1, 0]], [[0.1]])],
        np.linspace(0, 2, 5),
        output=np.eye(2),
    )  # fmt: skip
    schedule = constant_schedule(problem.edges, ("a",), [1.0])
    driven, free = exact_model(problem, schedule), exact_model(problem, schedule, driven=False)
    assert np.max(np.abs(driven.input)) > 0.01 and not np.any(free.input)
    for name in ("transition", "noise", "observe", "reading_noise", "cross"):
        np.testing.assert_allclose(getattr(free, name), getattr(driven, name), rtol=1e-10, atol=1e-14)

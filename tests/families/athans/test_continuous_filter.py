"""The Kalman-Bucy filter in continuous time, and the sampled filter's way to it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad

from occontrol.core.measurement import Measurement
from occontrol.core.plant import LinearPlant
from occontrol.core.schedule import Schedule
from occontrol.core.sensor import Sensor
from occontrol.families.athans.filter.kalman_bucy import continuous_filter, continuous_gain, run_filter
from occontrol.families.athans.problem import SchedulingProblem
from tests.families.athans.scheduling_cases import moving


def signal(t, name):
    """What the sensors say, smooth in time; its averages are what a sampled filter gets."""
    return {"place": [np.sin(t)], "speed": [np.cos(1.3 * t)], "both": [np.sin(t) + 0.2, np.cos(t)]}[name]


def following(intervals):
    """Three sensors in turn, four times each over the horizon, whatever the grid."""
    problem = replace(moving(2), edges=np.linspace(0, 4, intervals + 1))
    block = (np.arange(intervals) * 8) // intervals
    return problem, Schedule(problem.edges, np.eye(4)[block % 3], tuple(problem.sensors.names))


def averages(problem, schedule):
    found = []
    for k, (a, b) in enumerate(zip(problem.edges[:-1], problem.edges[1:], strict=True)):
        name = schedule.names[int(np.argmax(schedule.weights[k]))]
        size = len(signal(0, name))
        values = [quad(lambda t, i=i, name=name: signal(t, name)[i], a, b)[0] / (b - a) for i in range(size)]
        found.append(Measurement(b, name, np.array(values)))
    return found


@pytest.mark.parametrize("model", ["split", "exact"])
def test_the_sampled_filter_converges_to_the_continuous_one_as_h_squared(model):
    problem, schedule = following(8)
    limit = continuous_filter(problem, schedule, signal)
    _, sigma = continuous_gain(problem, schedule)
    mean_errors, covariance_errors = [], []
    for intervals in (32, 64, 128):
        fine, finer = following(intervals)
        estimate = run_filter(fine, finer, averages(fine, finer), model)
        mean_errors.append(np.max(np.abs(estimate.mean[:: intervals // 8] - limit.values)))
        covariance_errors.append(np.max(np.abs(estimate.covariance[:: intervals // 8] - sigma)))
    for errors in (mean_errors, covariance_errors):
        assert errors[-1] > 1e-7  # still far above the integrator's own error
        assert errors[0] / errors[1] == pytest.approx(4, rel=0.3)
        assert errors[1] / errors[2] == pytest.approx(4, rel=0.2)


def test_the_gain_of_a_scalar_plant_is_known():
    """dx = xi, Xi = L = 1, Sigma(0) = 3: Sigma = coth(t + arcoth 3), G = Sigma."""
    problem = SchedulingProblem("walk", LinearPlant(0, 1, 3.0), [Sensor("meter", 1, 1)], [0, 0.5, 2], 1)
    covariance, edges = continuous_gain(problem, Schedule(problem.edges, [[1.0], [1.0]], ("meter",)))
    for t in (0.0, 0.3, 0.5, 1.7):
        assert covariance(t)[0, 0] == pytest.approx(1 / np.tanh(t + np.arctanh(1 / 3)), rel=1e-8)
    assert edges[2, 0, 0] == pytest.approx(1 / np.tanh(2 + np.arctanh(1 / 3)), rel=1e-8)


def test_the_precomputed_gain_of_the_run_folder_is_athans_g(small_solution):
    """continuous_gain in arrays.npz against Sigma C' Theta^-1 of the independent integration, within O(h^2)."""
    problem, schedule = small_solution.problem, small_solution.schedule
    covariance, _ = continuous_gain(problem, schedule)
    stored = small_solution.arrays["continuous_gain"]
    checked = 0
    for k in range(0, problem.intervals, 3):
        j = int(np.argmax(schedule.weights[k]))
        sensor, t = problem.sensors[j], problem.edges[k]
        if sensor.rows:
            wanted = covariance(t) @ sensor.C.at(t).T @ np.linalg.inv(sensor.noise.at(t))
            np.testing.assert_allclose(stored[k, :, : sensor.rows], wanted, atol=0.02 * np.max(np.abs(wanted)))
            checked += 1
    assert checked > 3


def test_no_noise_in_the_data_and_a_known_start_leave_the_truth_untouched():
    """With z = C x exactly and the right initial mean the innovation vanishes: the filter is the plant."""
    from scipy.integrate import solve_ivp

    problem, schedule = following(8)
    plant = problem.plant

    def rate(t, x):
        return plant.A.at(t) @ x + (plant.B.at(t) @ plant.input.at(t)).ravel()

    path = solve_ivp(rate, (0, 4), plant.mean, rtol=1e-11, atol=1e-12, dense_output=True)

    def exact(t, name):
        return problem.sensors[problem.sensors.index(name)].C.at(t) @ path.sol(t)

    found = continuous_filter(problem, schedule, exact)
    np.testing.assert_allclose(found.values, path.sol(problem.edges).T, atol=1e-6)

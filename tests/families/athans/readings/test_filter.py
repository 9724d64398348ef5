"""The filter of readings against a textbook one, its simulation, missing and foreign readings, on-line use."""

import numpy as np
import pytest

from occontrol.api import online, run_filter, simulate, solve
from occontrol.core.errors import ProblemError, UsageError
from occontrol.core.measurement import Measurement
from occontrol.families.athans.readings.filter import reading_model
from tests.families.athans.readings.test_check_values import discrete, sampled

MAKERS = {"steps": discrete, "samples": sampled}


def textbook(problem, solution, measurements):
    """Estimates after every reading by the plain Kalman filter, and the prediction of the output."""
    from scipy.linalg import expm

    plant, n = problem.plant, problem.states
    x, P = np.zeros(n), plant.covariance
    times, found = problem.clock.times, []
    stops = [problem.clock.start, *times, problem.clock.end]

    def move(x, P, k):
        a, b = stops[k], stops[k + 1]
        if problem.discrete:
            if k == 0:
                return x, P
            F, Q = plant.F.at(float(k - 1)), plant.Q.at(float(k - 1))
        else:
            A, h = plant.A.at(0.0), b - a
            block = expm(np.block([[-A, plant.noise.at(0.0)], [np.zeros((n, n)), A.T]]) * h)
            F = block[n:, n:].T
            Q = F @ block[:n, n:]
        return F @ x, F @ P @ F.T + Q

    for k, t in enumerate(times):
        x, P = move(x, P, k)
        for m in measurements:
            if m.time == t:
                s = problem.sensors[problem.sensors.names.index(m.sensor)]
                H, R = s.C.at(t), s.noise.at(t)
                K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
                x, P = x + K @ (m.values - H @ x), P - K @ H @ P
        found.append((x, P))
    x, P = move(x, P, len(times))
    D = problem.output.at(problem.output_at)
    return found, D @ x, D @ P @ D.T


@pytest.mark.parametrize("name", MAKERS)
def test_the_filter_is_the_textbooks(name):
    problem = MAKERS[name]()
    solution = solve(problem)
    measurements, truth = simulate(problem, solution, seed=3)
    estimate = run_filter(problem, solution, measurements)
    steps, w, spread = textbook(problem, solution, measurements)
    for k, (x, P) in enumerate(steps):
        np.testing.assert_allclose(estimate.mean[k + 1], x, rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(estimate.covariance[k + 1], P, rtol=1e-10, atol=1e-13)
        np.testing.assert_allclose(solution.arrays["covariance"][k], P, rtol=1e-10, atol=1e-13)
    np.testing.assert_allclose(estimate.predicted[-1], w, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(estimate.predicted_deviation[-1] ** 2, np.diag(spread), rtol=1e-10)
    assert truth.values.shape == (problem.readings + 1, problem.states)
    # the planned prediction error is the cost's
    error = solution.result["prediction_error"]
    assert float(np.trace(spread)) == pytest.approx(error, rel=1e-9)


@pytest.mark.parametrize("name", MAKERS)
def test_gains_are_those_of_the_filter(name):
    problem = MAKERS[name]()
    solution = solve(problem)
    filter_ = online(problem, solution)
    for k in range(problem.readings):
        own = filter_.plan.gain[k]
        np.testing.assert_allclose(solution.arrays["gain"][k][:, : own.shape[1]], own, rtol=1e-9, atol=1e-13)


def test_many_runs_have_the_errors_that_the_filter_states():
    problem = sampled()
    solution = solve(problem)
    model = reading_model(problem, solution.schedule)
    total = []
    for seed in range(400):
        measurements, truth = simulate(problem, solution, seed=seed)
        estimate = run_filter(problem, solution, measurements)
        error = truth.values[-1] - estimate.mean[-1]
        total.append(float(error @ np.linalg.solve(estimate.covariance[-1], error)))
    # chi square of two degrees: mean 2, standard error of the mean 0.1
    assert np.mean(total) == pytest.approx(2.0, abs=0.4)
    assert model.intervals == problem.readings


def test_a_missing_reading_is_announced_and_computed_without():
    problem = sampled()
    solution = solve(problem)
    measurements, _ = simulate(problem, solution, seed=1)
    estimate = run_filter(problem, solution, measurements[:2] + measurements[3:])
    assert any("1 of 6 planned values are missing, the first at 0.5:" in note for note in estimate.notes)
    steps, w, _ = textbook(problem, solution, measurements[:2] + measurements[3:])
    np.testing.assert_allclose(estimate.mean[-1], steps[-1][0], rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(estimate.predicted[-1], w, rtol=1e-10, atol=1e-12)


def test_a_reading_at_no_instant_is_refused():
    problem = sampled()
    solution = solve(problem)
    with pytest.raises(ProblemError, match=r"the sample of sensor 'range' at t = 0\.7 is not at a step"):
        run_filter(problem, solution, [Measurement(0.7, "range", np.array([1.0]))])
    with pytest.raises(ProblemError, match="sensor 'doppler' is not in use at t = 0"):
        run_filter(problem, solution, [Measurement(0.0, "doppler", np.array([1.0]))])


def test_there_is_one_filter_only():
    problem = sampled()
    solution = solve(problem)
    with pytest.raises(UsageError, match="readings have one filter, which is exact; there is no model 'split'"):
        run_filter(problem, solution, [], model="split")

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


@pytest.mark.parametrize("method", ["schedule", "relaxed"])
@pytest.mark.parametrize("name", MAKERS)
def test_gains_are_those_of_the_filter(name, method):
    problem = MAKERS[name]()
    solution = solve(problem, method)
    assert solution.schedule.is_integer is (method == "schedule")  # a share v of a reading has the noise R/v
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


@pytest.mark.parametrize("name", MAKERS)
def test_the_tables_make_the_filter_without_this_package(name):
    """The equations of filter/tables.py with the exported arrays alone, also with a reading lost."""
    from occontrol.api import family_of

    problem = MAKERS[name]()
    solution = solve(problem)
    t = family_of(problem).filter_tables(problem, solution)
    measurements, _ = simulate(problem, solution, seed=5)
    del measurements[2]
    estimate = run_filter(problem, solution, measurements)
    given = {(m.time, m.sensor): m.values for m in measurements}
    x, P = t["mean"], t["covariance"][0]
    for k in range(problem.readings):
        time, used = t["edges"][k + 1], [j for j in t["sensor"][k] if j >= 0]
        names = [problem.sensors.names[j] for j in dict.fromkeys(used)]
        lost = [np.full(used.count(problem.sensors.names.index(each)), np.nan) for each in names]
        z = np.concatenate([given.get((time, each), none) for each, none in zip(names, lost, strict=True)])
        kept = np.flatnonzero(np.isfinite(z))
        H, d = t["observe"][k][kept], t["offset"][k][kept]
        R, S = t["reading_noise"][k][np.ix_(kept, kept)], t["cross"][k][:, kept]
        F, Y = t["transition"][k], H @ P @ H.T + R
        K = (F @ P @ H.T + S) @ np.linalg.inv(Y)
        x, P = F @ x + t["input"][k] + K @ (z[kept] - H @ x - d), (
            (F - K @ H) @ P @ (F - K @ H).T + t["noise"][k] - K @ S.T - S @ K.T + K @ R @ K.T
        )
        np.testing.assert_allclose(estimate.mean[k + 1], x, rtol=1e-9, atol=1e-11)
        np.testing.assert_allclose(estimate.covariance[k + 1], P, rtol=1e-9, atol=1e-12)
    w = t["predict_matrix"][-1] @ x + t["predict_offset"][-1]
    np.testing.assert_allclose(estimate.predicted[-1], w, rtol=1e-9, atol=1e-11)


def test_a_known_input_moves_estimate_and_prediction():
    """With every reading lost the mean follows dx/dt = A x + B u, and so does each prediction for predict_at."""
    from scipy.integrate import solve_ivp

    from occontrol.core.plant import LinearPlant
    from occontrol.core.sensor import Sensor
    from occontrol.families.athans.readings.clock import SampleTimes
    from occontrol.families.athans.readings.problem import ReadingsProblem

    A, B = np.array([[0.0, 1], [-1, -0.4]]), np.array([[0.0], [1.0]])
    plant = LinearPlant(A=A, noise=np.diag([0, 0.5]), covariance=np.eye(2), mean=[1, 0.5], B=B, input=["sin(2*t)+1"])
    clock = SampleTimes([0.5, 1.0, 2.2], 0.0, 3.0)
    problem = ReadingsProblem("driven", plant, [Sensor("one", [[1, 0]], [[0.1]])], clock, [[1, 0]], predict_at=4.0)
    solution = solve(problem)
    estimate = run_filter(problem, solution, [])
    path = solve_ivp(
        lambda t, x: A @ x + B[:, 0] * (np.sin(2 * t) + 1), (0, 4), [1, 0.5], "DOP853", rtol=1e-12, atol=1e-13,
        dense_output=True,
    ).sol  # fmt: skip
    for t, x in zip(estimate.times, estimate.mean, strict=True):
        np.testing.assert_allclose(x, path(t), rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(estimate.predicted[:, 0], path(4.0)[0], rtol=1e-8)
    # and the spread of the prediction is the prior's, carried on with all noise, however early it is made
    np.testing.assert_allclose(estimate.predicted_deviation[:, 0], estimate.predicted_deviation[0, 0], rtol=1e-8)

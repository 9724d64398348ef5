"""EKF and UKF against plain filters, filterpy and the linear filter of the house."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from occontrol.api import online, read_problem, run_filter, simulate, solve
from occontrol.core.errors import SolveFailed
from occontrol.families.athans.nonlinear.estimators import Extended, Unscented, triangle
from occontrol.families.athans.nonlinear.online import NonlinearFilter
from occontrol.families.athans.nonlinear.plant import FormulaPlant
from occontrol.families.athans.nonlinear.readout import Readout
from occontrol.families.athans.nonlinear.sensor import FormulaSensor
from occontrol.families.athans.nonlinear.wrap import wrapped
from tests.families.athans.nonlinear.cases import PENDULUM, SENSED, STEPPED, read

Q = np.array([[0.02, 0.005], [0.005, 0.03]])
R = np.array([[0.1, 0.02], [0.02, 0.2]])
S0 = np.array([[0.5, 0.1], [0.1, 0.4]])
MEAN = np.array([0.8, -0.2])
NEXT = ["x1 + 0.1*x2", "0.95*x2 - 0.2*sin(x1) + 0.02*k"]
READ = ["x1**2 + x2", "atan(x1 - x2)"]


def parts():
    plant = FormulaPlant(noise=Q.tolist(), covariance=S0, mean=MEAN, next=NEXT)
    return plant, Readout(plant, [FormulaSensor("one", READ, R.tolist(), plant)], [1.0])


def move(x, k):
    return np.array([x[0] + 0.1 * x[1], 0.95 * x[1] - 0.2 * np.sin(x[0]) + 0.02 * k])


def see(x):
    return np.array([x[0] ** 2 + x[1], np.arctan(x[0] - x[1])])


def slope_of(x):
    b = 1 / (1 + (x[0] - x[1]) ** 2)
    return np.array([[2 * x[0], 1], [b, -b]])


def run_house(estimator, readings):
    plant, readout = parts()
    mean, root, found = plant.whole_mean, triangle(np.linalg.cholesky(S0)), []
    for k, z in enumerate(readings):
        joint = estimator.reading(readout, mean, root, float(k))
        mean, root, nis = estimator.after(readout, joint, z, np.arange(2), root, float(k))
        found.append((mean, root @ root.T, nis))
        mean, root = estimator.predicted(plant.flow, mean, root, (float(k), 1.0, 1))
    return found


READINGS = np.random.default_rng(1).normal(size=(40, 2)) * 0.4 + [0.5, 0.4]


def test_the_extended_filter_is_the_plain_one():
    x, P = MEAN, S0
    for k, (mean, covariance, nis) in enumerate(run_house(Extended(), READINGS)):
        H = slope_of(x)
        Y = H @ P @ H.T + R
        K, error = P @ H.T @ np.linalg.inv(Y), READINGS[k] - see(x)
        x, P = x + K @ error, P - K @ Y @ K.T
        assert mean == pytest.approx(x, abs=1e-10) and covariance == pytest.approx(P, abs=1e-10)
        assert nis == pytest.approx(error @ np.linalg.solve(Y, error), rel=1e-9)
        F = np.array([[1, 0.1], [-0.2 * np.cos(x[0]), 0.95]])
        x, P = move(x, k), F @ P @ F.T + Q


def test_the_iterated_update_is_the_most_probable_state():
    """It minimises the sum of squared errors of prior and reading: by a general minimiser."""
    from scipy.optimize import least_squares

    _, readout = parts()
    root, z = np.linalg.cholesky(S0), np.array([1.6, 0.2])
    joint = Extended(True).reading(readout, MEAN, root, 0.0)
    mean, after, _ = Extended(True).after(readout, joint, z, np.arange(2), root, 0.0)
    W, V = np.linalg.inv(np.linalg.cholesky(S0)), np.linalg.inv(np.linalg.cholesky(R))
    best = least_squares(
        lambda x: np.append(W @ (x - MEAN), V @ (z - see(x))), MEAN, xtol=1e-15, ftol=1e-15, gtol=1e-15
    )
    assert mean == pytest.approx(best.x, abs=1e-7)
    H = slope_of(mean)
    assert after @ after.T == pytest.approx(np.linalg.inv(np.linalg.inv(S0) + H.T @ np.linalg.solve(R, H)), abs=1e-9)


def test_the_unscented_filter_is_filterpy_s():
    from filterpy.kalman import JulierSigmaPoints, UnscentedKalmanFilter

    judge = UnscentedKalmanFilter(2, 2, 1.0, see, lambda x, dt: x, JulierSigmaPoints(2, kappa=0.0))
    judge.x, judge.P, judge.Q, judge.R = MEAN.copy(), S0.copy(), Q, R
    judge.compute_process_sigmas(1.0, lambda x, dt: x)
    judge.sigmas_f = judge.points_fn.sigma_points(judge.x, judge.P)
    for k, (mean, covariance, _) in enumerate(run_house(Unscented(), READINGS)):
        judge.update(READINGS[k])
        assert mean == pytest.approx(judge.x, abs=1e-10) and covariance == pytest.approx(judge.P, abs=1e-10)
        judge.predict(fx=lambda x, dt, k=k: move(x, k))


LINEAR = """family: athans
name: linear
horizon: {start: 0, end: 3, samples: 12, predict_at: 4}
sensing: samples
plant:
  A: [[0, 1], [-1, -0.4]]
  noise: {diag: [0, 0.5]}
  initial: {mean: [1, 0], covariance: {diag: [5, 5]}}
sensors:
  - {name: range, C: [[1, 0]], noise: [[0.1]], cost: 0.2}
  - {name: both, C: [[0, 1], [1, 1]], noise: {diag: [0.4, 0.3]}, cost: 0.05, windows: [[0.4, 2]]}
select: 0..2
objective: {output: [[1, 0]]}
"""
FORMULAS = (
    LINEAR.replace("A: [[0, 1], [-1, -0.4]]", 'f: [x2, "-x1 - 0.4*x2"]')
    .replace("C: [[1, 0]]", "h: [x1]")
    .replace("C: [[0, 1], [1, 1]]", 'h: [x2, "x1 + x2"]')
)


@pytest.mark.parametrize("clock", ["samples", "rate"])
def test_on_a_linear_plant_everything_is_what_the_linear_half_does(clock, tmp_path):
    texts = [LINEAR, FORMULAS]
    if clock == "rate":
        texts = [t.replace("samples: 12", "intervals: 12").replace("sensing: samples\n", "") for t in texts]
    linear, formulas = (read(text, tmp_path, f"p{i}") for i, text in enumerate(texts))
    one, other = solve(linear, "greedy"), solve(formulas, "greedy")
    assert other.cost == pytest.approx(one.cost, rel=1e-7)
    assert other.result["nonlinearity"]["predictions"] < 1e-9
    measurements, _ = simulate(one.problem, one, 4)
    how = {"model": "exact"} if clock == "rate" else {}
    wanted = run_filter(one.problem, one, measurements, **how)
    for model in ("ekf", "iterated", "ukf"):
        found = run_filter(formulas, one, measurements, model=model)
        assert found.mean == pytest.approx(wanted.mean, abs=1e-7)
        assert found.covariance == pytest.approx(wanted.covariance, abs=1e-7)
        assert found.predicted == pytest.approx(wanted.predicted, abs=1e-7)
        assert found.predicted_deviation == pytest.approx(wanted.predicted_deviation, abs=1e-7)
        assert found.nis == pytest.approx(wanted.nis, abs=1e-6, nan_ok=True)


@pytest.mark.parametrize("text", [PENDULUM, SENSED, STEPPED])
def test_filters_agree_with_simulated_truth(text, tmp_path):
    """Over many runs the errors have the size that the filters say."""
    problem = read(text + ("integrator: {accuracy: 1.0e-5}\n" if text != STEPPED else ""), tmp_path)
    solution = solve(problem, "round-robin")
    for model in ("ekf",) if text == SENSED else ("ekf", "ukf"):
        total = []
        for seed in range(12):
            measurements, truth = simulate(problem, solution, seed)
            estimate = run_filter(problem, solution, measurements, model=model)
            error = truth.values[-1] - estimate.mean[-1]
            total.append(error @ np.linalg.solve(estimate.covariance[-1], error) / len(error))
        assert 0.5 < np.mean(total) < 1.7


def test_missing_readings_and_single_values_are_left_out(tmp_path):
    problem = read(PENDULUM, tmp_path)
    solution = solve(problem, "best-single")
    whole, some = online(problem, solution), online(problem, solution)
    assert isinstance(some, NonlinearFilter)
    for k in range(6):
        measured = {name: np.full(2 if name == "camera" else 1, 0.3) for name in whole.next_sensors}
        one = whole.step(measured)
        other = some.step(None if k == 3 else measured)
    assert np.trace(other.covariance) > np.trace(one.covariance)
    some.restart()
    assert some.k == 0 and some.state().estimate == pytest.approx([1.05, 0])


def test_a_lost_track_is_called_so(tmp_path):
    problem = read(PENDULUM, tmp_path)
    solution = solve(problem, "best-single")
    measurements, _ = simulate(problem, solution, 1)
    assert "lost the track" not in " ".join(run_filter(problem, solution, measurements).notes)
    for m in measurements[5:]:
        m.values[:] += 1.5
    assert "lost the track" in " ".join(run_filter(problem, solution, measurements).notes)
    gated = run_filter(problem, solution, measurements, gate=0.999)
    assert "left out" in " ".join(gated.notes)


def test_angles_are_differences_between_minus_pi_and_pi():
    found = wrapped(np.array([3.5, -3.5, 7.0, 3.5]), [True, True, True, False])
    assert found == pytest.approx([3.5 - 2 * np.pi, 2 * np.pi - 3.5, 7 - 2 * np.pi, 3.5])


ROUND = """family: athans
name: going round
horizon: {start: 0, end: 8, samples: 40}
sensing: samples
plant:
  states: [x, y]
  f: ["-y", x]
  noise: {identity: 2, scale: 1.0e-4}
  initial: {mean: [1, 0], covariance: {diag: [0.01, 0.01]}}
sensors:
  - {name: compass, h: ["atan2(y, x)"], angle: true, noise: [[0.001]]}
objective: {running: {identity: 2}}
"""


@pytest.mark.parametrize("model", ["ekf", "iterated", "ukf"])
def test_a_bearing_that_goes_round_keeps_its_filter(model, tmp_path):
    problem = read(ROUND, tmp_path)
    solution = solve(problem, "best-single")
    measurements, truth = simulate(problem, solution, 2)
    values = np.array([m.values[0] for m in measurements])
    assert np.ptp(values) > 6  # it crosses pi
    estimate = run_filter(problem, solution, measurements, model=model)
    assert np.max(np.abs(estimate.mean - truth.values)) < 0.6
    assert np.nanmax(estimate.nis) < 15


def test_lost_readings_of_the_truth_are_not_simulated(tmp_path):
    """The plan sees the nominal path; a truth that starts elsewhere is not always seen."""
    text = PENDULUM.replace("diag: [0.04, 0.04]", "diag: [0.2, 0.2]").replace("noise: [[0.01]]", "noise: [[100]]")
    problem = read(text.replace("cost_weight: 0.001", "cost_weight: 0"), tmp_path)
    solution = solve(problem, "greedy")
    planned = int(sum("camera" in entry["sensors"] for entry in solution.result["schedule"]))
    counts = [sum(m.sensor == "camera" for m in simulate(problem, solution, seed)[0]) for seed in range(8)]
    assert planned > 0 and min(counts) < planned


def test_a_truth_that_leaves_the_numbers_is_said_with_its_time() -> None:
    file = Path(__file__).resolve().parents[4] / "problems" / "compartment_ode.yaml"
    solution = solve(read_problem(file))  # an almost flat prior: some rates are about -1000
    with pytest.raises(SolveFailed, match="leaves the range of the numbers before t = "):
        simulate(solution.problem, solution, 0)

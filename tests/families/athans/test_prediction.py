"""The prediction of w(Tp) on shipped problems: its covariance, and its errors over many runs continued to Tp."""

from __future__ import annotations

import numpy as np
import pytest

from occontrol.families.athans.continuous.reintegration import reintegrate
from occontrol.families.athans.discretise import discretise, half_predicts, prediction_weight
from occontrol.families.athans.filter.online import make_plan
from occontrol.families.athans.filter.predictor import make_predictor
from occontrol.families.athans.filter.sampled_model import driven_transitions, exact_model, split_model
from occontrol.families.athans.filter.simulate import draw
from occontrol.families.athans.node_path import node_path
from occontrol.numerics.consistency import average_band
from tests.families.athans.scheduling_cases import cycling, moving

NAMES = ["attitude_telemetry", "reentry_waveforms", "survey_panel", "large_structure", "tracking_network"]


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_the_filters_last_prediction_has_the_solutions_mean_square_error(name, solved):
    solution = solved(name)
    problem, schedule = solution.problem, solution.schedule
    assert problem.predict_at > problem.edges[-1]
    model = split_model(problem, schedule)
    covariance = make_plan(model).covariance
    _, spread = make_predictor(problem, model).predict(problem.intervals, model.mean, covariance[-1])
    # the split filter belongs to the recursion with one step an interval
    W, later = prediction_weight(problem)
    path = node_path(discretise(problem), half_predicts(problem), solution.arrays["weights"])
    error = np.trace(W @ path.covariance[-1])
    assert np.trace(spread) == pytest.approx(error + later, rel=1e-8)
    assert np.trace(spread) > error  # Athans' (3.12) left the noise after T out
    # and what the solution states belongs to continuous time
    result, check = solution.result, reintegrate(problem, schedule)
    allowed = 5 * result["integration_error"] + 1e-6 * result["cost"]
    assert abs(result["predicted_mean_square_error"] - check.predicted_mean_square_error) <= allowed
    assert result["predicted_mean_square_error"] > result["prediction_error"]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["attitude_telemetry", "tracking_network", "moving"])
def test_predictions_err_as_much_as_they_say(name, solved):
    """200 truths continued to Tp: the normalised squared error of w, half way and at the end, in its 99 % band."""
    if name == "moving":
        problem = moving(80)
        schedule = cycling(problem)
    else:
        problem, schedule = solved(name).problem, solved(name).schedule
    truth, own = exact_model(problem, schedule), split_model(problem, schedule)
    plan, predictor = make_plan(own), make_predictor(problem, own)
    states, readings = draw(truth, range(2000, 2200))
    end, at = problem.edges[-1:], np.array([problem.predict_at])
    phi, push, Q = (part[0] for part in driven_transitions(problem.plant, end, at))
    values, vectors = np.linalg.eigh(Q)
    luck = np.random.default_rng(7).standard_normal((200, len(Q)))
    later = states[:, -1] @ phi.T + push + luck @ (vectors * np.sqrt(np.maximum(values, 0))).T
    w = later @ problem.output.at(problem.predict_at).T
    x = np.tile(own.mean, (200, 1))
    low, high = average_band(200 * w.shape[1])
    for k in range(problem.intervals):
        error = readings[k] - x @ own.observe[k].T - own.offset[k]
        x = x @ own.transition[k].T + own.input[k] + error @ plan.gain[k].T
        if k + 1 in (problem.intervals // 2, problem.intervals):
            miss = w - np.array([predictor.predict(k + 1, each, plan.covariance[k + 1])[0] for each in x])
            spread = predictor.predict(k + 1, own.mean, plan.covariance[k + 1])[1]
            average = np.sum(miss * np.linalg.solve(spread, miss.T).T) / miss.size
            assert low <= average <= high, (k, average, low, high)

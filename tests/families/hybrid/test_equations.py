"""Steps 1 to 6 of the jumping-mode estimator against values that independent implementations reached."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from occontrol.families.hybrid.bhattacharyya import error_bound
from occontrol.families.hybrid.equations import (
    correct,
    form_covariances,
    match_moments,
    predict,
    predict_measurement,
    predict_modes,
    weigh_modes,
)

MEANS = np.array([[0, 24, 1, 3], [1, 25, -1, 2], [-0.5, 26, 0.5, -1]], dtype=float)
COVARIANCES = np.array([np.diag([4, 1, 9, 2.0]), np.diag([2, 2, 5, 1.0]), np.diag([3, 1.5, 6, 1.5])])
ALPHA = np.array([0.5, 0.2, 0.3])
SENSORS = np.array([[[1, 0, 0, 0.1], [0, 1, 0.1, 0]], [[0.1, 0, 0, 1], [0, 0.1, 1, 0]]])
F = np.array([[0.5, 0], [1, 0], [0, 0.5], [0, 1]])
NOISE_ROOTS = np.array([F] * 3)
ROOTS = np.linalg.cholesky(COVARIANCES)
PAPER = np.array([[0.6, 0.2, 0.2], [0.2, 0.6, 0.2], [0.2, 0.2, 0.6]])
SKEWED = np.array([[0.7, 0.2, 0.1], [0.1, 0.8, 0.1], [0.3, 0.3, 0.4]])


def turn(rate: float) -> np.ndarray:
    s, c = np.sin(rate), np.cos(rate)
    return np.array([[1, s / rate, 0, -(1 - c) / rate], [0, c, 0, -s], [0, (1 - c) / rate, 1, s / rate], [0, s, 0, c]])


MODES = np.array([turn(np.pi / 18), turn(-np.pi / 18), [[1, 1, 0, 0], [0, 1, 0, 0], [0, 0, 1, 1], [0, 0, 0, 1]]])


def prediction(transition):
    log_predicted, mixing = predict_modes(np.log(ALPHA), transition)
    mixed, _ = match_moments(mixing, MEANS, COVARIANCES)
    return log_predicted, mixed, *predict(mixing, MEANS, ROOTS, MODES, NOISE_ROOTS, np.zeros((3, 4)))


def bounds(transition):
    log_predicted, _, means, roots = prediction(transition)
    for C in SENSORS:
        expected, spread, _ = predict_measurement(means, form_covariances(roots), C, np.eye(2))
        yield error_bound(log_predicted, expected, spread)


def test_predicted_mode_probabilities_and_initial_condition_of_the_paper():
    log_predicted, mixed, _, _ = prediction(PAPER)
    assert np.exp(log_predicted) == pytest.approx([0.4, 0.28, 0.32], abs=1e-9)
    assert mixed[0] == pytest.approx([0.025, 24.4, 0.725, 2.3], abs=1e-9)


def test_rows_of_the_transition_matrix_are_from():
    assert np.exp(prediction(SKEWED)[0]) == pytest.approx([0.46, 0.35, 0.19], abs=1e-9)


@pytest.mark.parametrize(
    ("transition", "expected", "digits"),
    [(PAPER, [0.9664556341009942, 0.4734700494530902], 1e-9), (SKEWED, [0.93127654893, 0.42233853605], 1e-9)],
)
def test_bounds_of_both_sensors(transition, expected, digits):
    assert list(bounds(transition)) == pytest.approx(expected, abs=digits)


def test_update_with_sensor_two():
    log_predicted, _, means, roots = prediction(PAPER)
    updated, after, likelihoods = correct(means, roots, SENSORS[1], np.eye(2), np.array([6.5, 4.0]))
    alpha = np.exp(weigh_modes(log_predicted, likelihoods))
    mean, covariance = match_moments(alpha[None], updated, form_covariances(after))
    assert alpha == pytest.approx([0.658080293047, 0.014555828054, 0.3273638789], abs=1e-9)
    assert mean[0] == pytest.approx([24.598349373407, 24.36742946446, 1.751976430588, 4.018464097009], abs=1e-9)
    assert np.trace(covariance[0]) == pytest.approx(10.635890605996, abs=1e-9)


def test_prediction_by_roots_equals_moments_and_propagation():
    _, mixing = predict_modes(np.log(ALPHA), SKEWED)
    drift = np.arange(12.0).reshape(3, 4)
    means, roots = predict(mixing, MEANS, ROOTS, MODES, NOISE_ROOTS, drift)
    mixed, spread = match_moments(mixing, MEANS, COVARIANCES)
    for j, (A, S) in enumerate(zip(MODES, roots, strict=True)):
        assert means[j] == pytest.approx(A @ mixed[j] + drift[j], rel=1e-13)
        assert np.allclose(S @ S.T, A @ spread[j] @ A.T + F @ F.T, rtol=1e-12, atol=1e-12)
        assert np.array_equal(S, np.tril(S))


def test_update_equals_the_information_form_also_where_readings_are_correlated():
    _, _, means, roots = prediction(PAPER)
    R_root, values = np.array([[1.0, 0.3], [0.5, 0.7]]), np.array([1.0, 2.0])
    inverse = np.linalg.inv(R_root @ R_root.T)
    updated, after, likelihoods = correct(means, roots, SENSORS[0], R_root, values)
    for j, (before, root) in enumerate(zip(form_covariances(roots), after, strict=True)):
        expected = np.linalg.inv(np.linalg.inv(before) + SENSORS[0].T @ inverse @ SENSORS[0])
        assert np.allclose(root @ root.T, expected, rtol=1e-10, atol=1e-12)
        innovation = values - SENSORS[0] @ means[j]
        assert updated[j] == pytest.approx(means[j] + expected @ SENSORS[0].T @ inverse @ innovation, rel=1e-10)
        S = SENSORS[0] @ before @ SENSORS[0].T + R_root @ R_root.T
        assert likelihoods[j] == pytest.approx(multivariate_normal.logpdf(innovation, cov=S), rel=1e-11)


def test_far_off_modes_do_not_underflow():
    log_predicted = np.log(np.array([0.25, 0.75]))
    log_probabilities = weigh_modes(log_predicted, np.array([-5000.0, -9000.0]))
    assert log_probabilities[0] == 0.0
    assert log_probabilities[1] == pytest.approx(-4000 + np.log(3))
    # the far mode still has a usable mixture: it is fed by the near one
    _, mixing = predict_modes(log_probabilities, np.array([[0.9, 0.1], [0.1, 0.9]]))
    assert mixing.sum(axis=1) == pytest.approx([1, 1])
    assert np.all(np.isfinite(mixing))


def test_a_mode_that_cannot_follow_has_no_probability_and_no_nan():
    log_predicted, mixing = predict_modes(np.array([0.0, -np.inf]), np.eye(2))
    assert log_predicted[0] == 0.0
    assert log_predicted[1] == -np.inf
    assert np.array_equal(mixing, [[1, 0], [1, 0]])


def test_moments_of_a_mixture_agree_with_samples_free_arithmetic():
    rng = np.random.default_rng(5)
    weights = rng.dirichlet(np.ones(3), size=2)
    mean, covariance = match_moments(weights, MEANS, COVARIANCES)
    for j in range(2):
        second = sum(w * (P + np.outer(m, m)) for w, m, P in zip(weights[j], MEANS, COVARIANCES, strict=True))
        assert mean[j] == pytest.approx(weights[j] @ MEANS)
        assert covariance[j] == pytest.approx(second - np.outer(mean[j], mean[j]), abs=1e-10)

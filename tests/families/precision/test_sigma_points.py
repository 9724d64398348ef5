"""Sigma points: the corrected covariance in both forms, exactness for linear maps, and the printed form's failure."""

import numpy as np
import pytest

from occontrol.families.precision.sigma_points import (
    mean_and_anomalies,
    moments,
    noise_root,
    sigma_points,
    square_root,
    weights,
)

RNG = np.random.default_rng(2)
MEAN = RNG.standard_normal(3)
ROOT = RNG.standard_normal((3, 3))
COVARIANCE = ROOT @ ROOT.T


@pytest.mark.parametrize(("alpha", "beta", "kappa"), [(1, 2, 0), (0.5, 2, 1), (1e-3, 2, 0), (1.0, 1.0, 2.0)])
def test_exact_for_linear_maps(alpha, beta, kappa):
    matrix = RNG.standard_normal((4, 3))
    points = matrix @ sigma_points(MEAN, COVARIANCE, alpha, kappa) + 1.0
    mean, anomalies = mean_and_anomalies(points, alpha, beta, kappa)
    assert np.allclose(mean, matrix @ MEAN + 1.0, atol=1e-9)
    assert np.allclose(anomalies @ anomalies.T, matrix @ COVARIANCE @ matrix.T, rtol=1e-9, atol=1e-9)


def test_the_two_forms_of_the_covariance_agree_on_a_nonlinear_map():
    for alpha, beta, kappa in ((1.0, 2.0, 0.0), (0.7, 0.6, 1.0)):
        points = np.sin(sigma_points(MEAN, COVARIANCE, alpha, kappa)) ** 2
        mean, anomalies = mean_and_anomalies(points, alpha, beta, kappa)
        other_mean, other = moments(points, alpha, beta, kappa)
        assert np.allclose(mean, other_mean, atol=1e-13) and np.allclose(anomalies @ anomalies.T, other, atol=1e-13)


def test_filterpy_says_the_same():
    sigma = pytest.importorskip("filterpy.kalman.sigma_points")
    unscented = pytest.importorskip("filterpy.kalman.unscented_transform")
    judge = sigma.MerweScaledSigmaPoints(3, alpha=0.8, beta=2.0, kappa=0.5)
    points = judge.sigma_points(MEAN, COVARIANCE)
    assert np.allclose(np.sort(points.T, axis=1), np.sort(sigma_points(MEAN, COVARIANCE, 0.8, 0.5), axis=1), atol=1e-12)
    by_mean, by_covariance = weights(3, 0.8, 2.0, 0.5)
    assert np.allclose(by_mean, judge.Wm) and np.allclose(by_covariance, judge.Wc)
    mean, covariance = unscented.unscented_transform(np.tanh(points), judge.Wm, judge.Wc)
    ours, anomalies = mean_and_anomalies(np.tanh(points).T, 0.8, 2.0, 0.5)
    assert np.allclose(ours, mean, atol=1e-12) and np.allclose(anomalies @ anomalies.T, covariance, atol=1e-12)


def test_the_printed_covariance_is_wrong_even_for_the_identity():
    points = sigma_points(MEAN, COVARIANCE, 1.0, 0.0)
    _, by_covariance = weights(3, 1.0, 2.0, 0.0)
    left = np.diag(by_covariance) - np.outer(by_covariance, np.ones(7))
    printed = points @ left @ left.T @ points.T
    assert not np.allclose(printed, COVARIANCE, rtol=0.1)


def test_tiny_alpha_keeps_the_curvature():
    points = sigma_points(np.zeros(1), np.eye(1), 1e-3, 0.0)
    mean, _ = mean_and_anomalies(points**2, 1e-3, 2.0, 0.0)
    assert abs(mean[0] - 1.0) < 1e-9  # E x^2 = 1


def test_roots_do_not_mind_units():
    units = np.array([1e6, 1.0, 1e-7])
    for matrix in (COVARIANCE, np.outer(MEAN, MEAN), np.outer(MEAN, MEAN) + np.diag([1.0, 0, 0])):
        scaled = units[:, None] * matrix * units
        for root in (square_root(scaled), noise_root(scaled)):
            assert np.allclose((root @ root.T) / units / units[:, None], matrix, rtol=1e-12, atol=1e-12)
    assert noise_root(np.outer(units, units)).shape == (3, 1) and noise_root(np.zeros((3, 3))).shape == (3, 0)


def test_singular_covariances_have_points_too():
    flat = np.diag([1.0, 0.0, 2.0])
    mean, anomalies = mean_and_anomalies(sigma_points(MEAN, flat, 1.0, 0.0), 1.0, 2.0, 0.0)
    assert np.allclose(anomalies @ anomalies.T, flat, atol=1e-14) and np.allclose(mean, MEAN)

"""Posterior covariance, gain and square root: against the textbook formulas with an explicit noise covariance."""

import numpy as np
import pytest

from occontrol.families.precision.moments import (
    Moments,
    gain,
    moments_of_anomalies,
    posterior_covariance,
    printed_blocks,
    square_root_transform,
)

RNG = np.random.default_rng(11)
A, B = RNG.standard_normal((3, 7)), RNG.standard_normal((5, 7))
MOMENTS = moments_of_anomalies(A, B)
PRECISIONS = np.array([0.5, 2.0, 0.1, 3.0, 1.0])


def test_posterior_and_gain_are_those_of_equation_11():
    inverse = np.linalg.inv(MOMENTS.measurement + np.diag(1 / PRECISIONS))
    assert np.allclose(gain(MOMENTS.cross, MOMENTS.measurement, PRECISIONS), MOMENTS.cross @ inverse, atol=1e-13)
    expected = MOMENTS.state - MOMENTS.cross @ inverse @ MOMENTS.cross.T
    assert np.allclose(posterior_covariance(MOMENTS, PRECISIONS), expected, atol=1e-13)


def test_zero_precision_is_no_measurement():
    some = np.array([0.5, 0.0, 0.1, 0.0, 1.0])
    used = MOMENTS.only([0, 2, 4])
    assert np.allclose(posterior_covariance(MOMENTS, some), posterior_covariance(used, some[[0, 2, 4]]), atol=1e-13)
    columns = gain(MOMENTS.cross, MOMENTS.measurement, some)
    assert np.all(columns[:, [1, 3]] == 0)
    assert np.allclose(posterior_covariance(MOMENTS, 0 * some), MOMENTS.state)


def test_measuring_in_two_portions_is_measuring_at_once():
    first, second = np.array([0.5, 2.0, 0, 0, 0]), np.array([0, 0, 0.1, 3.0, 1.0])
    both = posterior_covariance(MOMENTS, first + second)
    assert np.allclose(posterior_covariance(MOMENTS.given(first), second), both, atol=1e-12)
    plain = Moments(MOMENTS.state, MOMENTS.cross, MOMENTS.measurement)
    assert np.allclose(posterior_covariance(plain.given(first), second), both, atol=1e-12)


def test_square_root_keeps_covariance_and_mean():
    centred_a, centred_b = A - A.mean(axis=1, keepdims=True), B - B.mean(axis=1, keepdims=True)
    moments = moments_of_anomalies(centred_a, centred_b)
    transform = square_root_transform(centred_b, PRECISIONS)
    after = centred_a @ transform
    assert np.allclose(after @ after.T, posterior_covariance(moments, PRECISIONS), atol=1e-13)
    assert np.allclose(transform @ np.ones(7), 1) and np.allclose(after.sum(axis=1), 0, atol=1e-13)


def test_the_printed_inequality_says_the_same_where_it_exists():
    constant, factors = printed_blocks(MOMENTS, 0.5 * MOMENTS.state)
    for scale in (0.05, 1.0, 30.0):
        matrix = constant + factors.T @ (scale * PRECISIONS[:, None] * factors)
        margin = np.linalg.eigvalsh(0.5 * MOMENTS.state - posterior_covariance(MOMENTS, scale * PRECISIONS))[0]
        assert (np.linalg.eigvalsh(matrix)[0] >= 0) == (margin >= 0)


@pytest.mark.parametrize("members", [3, 4])
def test_singular_measurement_moments_are_no_obstacle(members):
    few = moments_of_anomalies(A[:, :members], B[:, :members])
    assert np.linalg.matrix_rank(few.measurement) == members
    posterior = posterior_covariance(few, PRECISIONS)
    expected = A[:, :members] @ np.linalg.inv(np.eye(members) + B[:, :members].T @ np.diag(PRECISIONS) @ B[:, :members])
    assert np.allclose(posterior, expected @ A[:, :members].T, atol=1e-12)

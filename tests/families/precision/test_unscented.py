"""The unscented filter is the Kalman filter on linear systems, in batches too."""

import numpy as np
import pytest

from occontrol.core.errors import ProblemError
from occontrol.families.precision.measurement import NonlinearMeasurement
from occontrol.families.precision.plant import NonlinearPlant
from occontrol.families.precision.unscented import Unscented, UnscentedFilter
from tests.families.precision.linear_judge import COVARIANCE, MEAN, kalman, linear, run


@pytest.mark.parametrize("batch", [1, 2, 3, 6])
@pytest.mark.parametrize(("alpha", "beta", "kappa"), [(1.0, 2.0, 0.0), (0.5, 2.0, 1.0), (1e-3, 2.0, 0.0)])
def test_kalman_filter_on_a_linear_plant(batch, alpha, beta, kappa):
    mean, covariance = run(Unscented(*linear(), UnscentedFilter(alpha, beta, kappa)), batch)
    exact_mean, exact = kalman()
    assert np.max(np.abs(mean - exact_mean)) < 1e-10
    assert np.max(np.abs(covariance - exact)) < 1e-10


def test_without_noise_in_the_plant():
    none = np.zeros((3, 3))
    mean, covariance = run(Unscented(*linear(none), UnscentedFilter()), 3)
    exact_mean, exact = kalman(none)
    assert np.allclose(mean, exact_mean, atol=1e-12) and np.allclose(covariance, exact, atol=1e-12)


def test_missing_values_of_unused_sensors_do_not_matter():
    filter_ = Unscented(*linear(), UnscentedFilter())
    forecast = filter_.forecast(1)
    filter_.update(forecast, np.array([0.0, 2.0]), np.array([np.nan, 0.3]))
    assert np.all(np.isfinite(filter_.mean))


def test_second_order_mean_of_a_quadratic():
    plant = NonlinearPlant(COVARIANCE, MEAN, f=["x1**2", "x2", "x3"])
    forecast = Unscented(plant, NonlinearMeasurement(3, model="identity"), UnscentedFilter()).forecast(1)
    assert abs(forecast.mean[0] - (MEAN[0] ** 2 + COVARIANCE[0, 0])) < 1e-12


@pytest.mark.parametrize(
    ("options", "words"),
    [({"alpha": 0.0}, "alpha is 0"), ({"alpha": 2.0}, "beta >= alpha"), ({"beta": float("nan")}, "beta is nan")],
)
def test_refusals(options, words):
    with pytest.raises(ProblemError, match=words):
        UnscentedFilter(**options)


def test_kappa_that_leaves_no_spread_is_refused():
    with pytest.raises(ProblemError, match="kappa > -3"):
        Unscented(*linear(np.zeros((3, 3))), UnscentedFilter(kappa=-3.0)).forecast(1)

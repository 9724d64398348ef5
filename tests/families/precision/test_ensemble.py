"""The ensemble filter: Monte Carlo rate to the Kalman filter, the promised covariance, seeds, inflation, centring."""

import numpy as np
import pytest

from occontrol.core.errors import ProblemError, SolveFailed
from occontrol.families.precision.ensemble import Ensemble, EnsembleFilter
from occontrol.families.precision.forecast import draw, split_seed
from occontrol.families.precision.measurement import NonlinearMeasurement
from occontrol.families.precision.plant import NonlinearPlant
from occontrol.families.precision.program import Program, relative_margin, solve_program
from tests.families.precision.linear_judge import kalman, linear, run


@pytest.mark.parametrize("update", ["perturbed", "square-root"])
def test_monte_carlo_rate_towards_the_kalman_filter(update):
    exact_mean, exact = kalman()
    counts, errors = [100, 400, 1600], []
    seeds = 24 if update == "perturbed" else 12
    for count in counts:
        if update == "square-root" and count > 400:
            break  # its transform is count x count
        squares = []
        for seed in range(seeds):
            filter_ = Ensemble(*linear(), EnsembleFilter(members=count, update=update, seed=seed))
            mean, _ = run(filter_, 3)
            squares.append(np.sum((mean - exact_mean) ** 2) + np.sum((filter_.covariance - exact) ** 2))
        errors.append(np.sqrt(np.mean(squares)))
    slope = np.polyfit(np.log(counts[: len(errors)]), np.log(errors), 1)[0]
    assert -0.75 < slope < -0.25, errors
    assert errors[0] < 4 / np.sqrt(counts[0])


def test_square_root_has_exactly_the_promised_covariance():
    filter_ = Ensemble(*linear(), EnsembleFilter(members=30))
    for _ in range(3):
        forecast = filter_.forecast(2)
        promised = filter_.update(forecast, np.array([1.0, 0.0, 2.0, 0.5]), np.array([0.1, np.nan, 0.2, 0.3]))
        assert np.allclose(filter_.covariance, promised, atol=1e-13)


def test_perturbed_observations_break_a_bound_that_the_square_root_keeps():
    plant = NonlinearPlant(np.eye(4), f=["x1", "x2", "x3", "x4"])
    measurement = NonlinearMeasurement(4, model="identity")
    broken = 0
    for seed in range(20):
        for update in ("square-root", "perturbed"):
            filter_ = Ensemble(plant, measurement, EnsembleFilter(members=20, update=update, seed=seed))
            forecast = filter_.forecast(1)
            found = solve_program(Program(forecast.moments, 0.5 * forecast.moments.state))
            filter_.update(forecast, found.precisions, np.zeros(4))
            margin = relative_margin(filter_.covariance, 0.5 * forecast.moments.state)
            if update == "square-root":
                assert margin >= -1e-8
            else:
                broken += margin < -1e-8
    assert broken >= 15


def test_inflation_multiplies_the_forecast_covariance():
    plain = Ensemble(*linear(), EnsembleFilter(members=30)).forecast(1)
    more = Ensemble(*linear(), EnsembleFilter(members=30, inflation=1.5)).forecast(1)
    assert np.allclose(more.moments.state, 1.5 * plain.moments.state)
    assert np.allclose(more.moments.cross, 1.5 * plain.moments.cross)
    assert np.allclose(more.mean, plain.mean)


def test_printed_centring_is_conservative():
    plant = NonlinearPlant(np.eye(2), f=["x1", "x2"])
    measurement = NonlinearMeasurement(2, h=["x1**2", "x2 + x1**3"])
    options = {"members": 50}
    by_mean = Ensemble(plant, measurement, EnsembleFilter(**options)).forecast(1)
    by_model = Ensemble(plant, measurement, EnsembleFilter(**options, centring="model")).forecast(1)
    difference = by_model.moments.measurement - by_mean.moments.measurement
    assert np.linalg.eigvalsh(difference)[0] > -1e-12 and np.trace(difference) > 0.1
    assert np.allclose(by_model.moments.cross, by_mean.moments.cross)  # the state's anomalies are centred anyhow


def test_seeds_decide_everything():
    first, again = (Ensemble(*linear(), EnsembleFilter(members=9, seed=5)).forecast(2) for _ in range(2))
    other = Ensemble(*linear(), EnsembleFilter(members=9, seed=6)).forecast(2)
    assert np.array_equal(first.members, again.members) and not np.allclose(first.members, other.members)


def test_draws_have_their_covariance():
    covariance = np.array([[2.0, 1.0, 0.0], [1.0, 0.5, 0.0], [0.0, 0.0, 0.0]])  # singular
    sample = draw(split_seed(3, 0), covariance, 200_000)
    assert np.allclose(np.cov(sample), covariance, atol=0.03)


def test_members_that_run_away_are_named():
    plant = NonlinearPlant(np.eye(1), [5.0], f=["exp(x1**2)"])
    with pytest.raises(SolveFailed, match=r"x1 of member \d+ is not finite at t = "):
        filter_ = Ensemble(plant, NonlinearMeasurement(1, model="identity"), EnsembleFilter(members=5))
        filter_.forecast(3)


@pytest.mark.parametrize(
    ("options", "words"),
    [({"members": 1}, "at least 2"), ({"inflation": 0.0}, "inflation > 0"), ({"update": "best"}, "square-root")],
)
def test_refusals(options, words):
    with pytest.raises(ProblemError, match=words):
        EnsembleFilter(**options)

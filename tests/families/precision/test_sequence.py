"""Batches against a simulated truth: the chosen precisions are used, the bound is kept, the errors fit the promise."""

import numpy as np
import pytest

from occontrol.families.precision.ensemble import EnsembleFilter
from occontrol.families.precision.linearised import linearise_batch, undetectable_modes
from occontrol.families.precision.program import Program, relative_margin, solve_program
from occontrol.families.precision.sequence import innovation_squared, observe, run_sequence, simulate_truth
from occontrol.families.precision.unscented import UnscentedFilter
from tests.families.precision.linear_judge import linear

BOUND = 0.25 * np.eye(3)


def choose(forecast, k):
    return solve_program(Program(forecast.moments, BOUND))


@pytest.mark.parametrize("options", [UnscentedFilter(), EnsembleFilter(members=40)])
def test_every_batch_keeps_the_bound(options):
    outcomes = run_sequence(*linear(), options, 2, 4, choose, seed=1)
    assert len(outcomes) == 4
    for outcome in outcomes:
        assert relative_margin(outcome.covariance, BOUND) >= -1e-8
        assert relative_margin(outcome.filter_covariance, BOUND) >= -1e-8
        measured = np.isfinite(outcome.observed)
        assert np.array_equal(measured, outcome.chosen.precisions > 0)


def test_the_innovation_is_measured_by_its_own_covariance():
    """nu' (Y + R)^-1 nu with R the inverse of the precisions, of what is in use only."""
    forecast = UnscentedFilter().start(*linear()).forecast(2)
    off = np.array([0.5, -1.0, 2.0, 0.3])
    observed = forecast.measurement_mean + off
    for precisions in (np.array([2.0, 0.0, 0.5, 4.0]), np.array([0.0, 0.0, 3.0, 0.0]), np.array([1.0, 1e3, 1.0, 1e-3])):
        used = precisions > 0
        spread = forecast.moments.measurement[np.ix_(used, used)] + np.diag(1 / precisions[used])
        expected = off[used] @ np.linalg.inv(spread) @ off[used]
        assert innovation_squared(forecast, precisions, observed) == pytest.approx(expected, rel=1e-10)
    assert np.isnan(innovation_squared(forecast, np.zeros(4), observed))


@pytest.mark.slow
def test_errors_and_innovations_have_the_promised_size():
    errors, innovations, expected, degrees = [], [], [], 0
    for seed in range(60):
        for outcome in run_sequence(*linear(), UnscentedFilter(), 2, 2, choose, seed=seed):
            inverse = np.linalg.inv(outcome.covariance)
            error = outcome.mean - outcome.truth
            errors.append(error @ inverse @ error)
            expected.append(3)
            if np.isfinite(outcome.nis):
                innovations.append(outcome.nis)
                degrees += int(np.sum(outcome.chosen.precisions > 0))
    assert abs(np.sum(errors) / np.sum(expected) - 1) < 4 * np.sqrt(2 / np.sum(expected))
    assert abs(np.sum(innovations) / degrees - 1) < 4 * np.sqrt(2 / degrees)


def test_truth_and_noise_follow_the_seed():
    first, again, other = (simulate_truth(*linear(), 5, seed) for seed in (1, 1, 2))
    assert np.array_equal(first.states, again.states) and not np.allclose(first.states, other.states)
    values = np.zeros(100_000)
    seen = observe(values, np.full(100_000, 4.0), np.random.default_rng(0))
    assert abs(np.std(seen) - 0.5) < 0.01


class Refused:
    precisions = None


def test_a_refusal_ends_the_sequence():
    outcomes = run_sequence(
        *linear(), UnscentedFilter(), 1, 5, lambda f, k: choose(f, k) if k < 2 else Refused(), seed=0
    )
    assert len(outcomes) == 3 and np.all(np.isnan(outcomes[-1].observed))


def test_undetectable_modes():
    transition = np.diag([2.0, 0.5, -1.0])
    assert len(undetectable_modes(transition, np.eye(3))) == 0
    assert np.allclose(undetectable_modes(transition, np.array([[0.0, 1.0, 1.0]])), [2.0])
    assert np.allclose(sorted(undetectable_modes(transition, np.zeros((1, 3)))), [-1.0, 2.0])
    assert len(undetectable_modes(transition, np.array([[1e-7, 0.0, 3.0]]))) == 0


def test_linearised_batch_is_exact_for_a_linear_plant():
    from tests.families.precision.linear_judge import F, H

    transition, rows = linearise_batch(*linear(), 2)
    assert np.allclose(transition, F @ F) and np.allclose(rows, np.vstack([H @ F, H @ F @ F]))

"""The bound on a wrong mode against the true Bayes risk."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from occontrol.families.hybrid.bhattacharyya import error_bound


def random_case(rng, modes: int, rows: int):
    priors = rng.dirichlet(np.ones(modes))
    means = rng.normal(scale=rng.uniform(0.2, 3), size=(modes, rows))
    roots = rng.normal(size=(modes, rows, rows)) * np.exp(rng.normal(scale=0.7, size=(modes, 1, 1)))
    return priors, means, roots @ roots.transpose(0, 2, 1) + 0.05 * np.eye(rows)


def bayes_risk(rng, priors, means, covariances, samples: int = 20_000):
    """Risk of the Bayes decision 1 - E max posterior, and its standard error, by sampling."""
    modes = rng.choice(len(priors), size=samples, p=priors)
    roots = np.linalg.cholesky(covariances)
    z = means[modes] + np.einsum("kij,kj->ki", roots[modes], rng.normal(size=(samples, means.shape[1])))
    joint = [p * multivariate_normal.pdf(z, m, S) for p, m, S in zip(priors, means, covariances, strict=True)]
    joint = np.array(joint).reshape(len(priors), samples)
    risk = 1 - joint.max(axis=0) / joint.sum(axis=0)
    return risk.mean(), risk.std() / np.sqrt(samples)


@pytest.mark.parametrize("seed", range(40))
def test_bound_is_not_below_the_bayes_risk(seed):
    rng = np.random.default_rng(seed)
    priors, means, covariances = random_case(rng, modes=2 + seed % 4, rows=1 + seed % 3)
    risk, error = bayes_risk(rng, priors, means, covariances)
    assert error_bound(np.log(priors), means, covariances) >= risk - 4 * error


def test_the_printed_exponent_would_be_no_bound():
    # |S_i + S_j|/2 for p = 4 multiplies the bound by sqrt(1/8): below the risk of coinciding hypotheses, 1/2
    means, covariances = np.zeros((2, 4)), np.array([np.eye(4)] * 2)
    bound = error_bound(np.log([0.5, 0.5]), means, covariances)
    assert bound == pytest.approx(0.5)
    assert bound * np.exp(-0.5 * np.log(2.0**3)) < 0.5


def test_bound_and_risk_at_distance_two():
    bound = error_bound(np.log([0.5, 0.5]), np.array([[0.0], [2.0]]), np.ones((2, 1, 1)))
    assert bound == pytest.approx(0.303265329856, abs=1e-12)
    risk, error = bayes_risk(
        np.random.default_rng(0), np.array([0.5, 0.5]), np.array([[0.0], [2.0]]), np.ones((2, 1, 1))
    )
    assert risk == pytest.approx(0.158655253931, abs=4 * error)


@pytest.mark.parametrize("rows", [1, 2, 5])
def test_identical_hypotheses_reach_half(rows):
    root = np.random.default_rng(rows).normal(size=(rows, rows))
    S = root @ root.T + np.eye(rows)
    assert error_bound(np.log([0.5, 0.5]), np.ones((2, rows)), np.array([S, S])) == pytest.approx(0.5)


def test_separated_hypotheses_reach_zero():
    S = np.array([np.eye(2), 3 * np.eye(2)])
    distances = [0, 1, 3, 10, 60, 1e4]
    found = [error_bound(np.log([0.3, 0.7]), np.array([[0.0, 0], [d, d]]), S) for d in distances]
    assert all(a > b for a, b in pairwise(found[:5]))
    assert found[-1] == 0.0


def test_an_impossible_hypothesis_adds_nothing():
    rng = np.random.default_rng(3)
    _, means, covariances = random_case(rng, 3, 2)
    with np.errstate(divide="ignore"):
        three = error_bound(np.log(np.array([0.4, 0.6, 0.0])), means, covariances)
    assert three == pytest.approx(error_bound(np.log(np.array([0.4, 0.6])), means[:2], covariances[:2]))


def test_the_unit_of_the_measurement_does_not_matter():
    rng = np.random.default_rng(4)
    priors, means, covariances = random_case(rng, 4, 3)
    T = rng.normal(size=(3, 3)) + 2 * np.eye(3)
    changed = error_bound(np.log(priors), means @ T.T, np.array([T @ S @ T.T for S in covariances]))
    assert changed == pytest.approx(error_bound(np.log(priors), means, covariances), rel=1e-10)

"""Probabilities of guards against SciPy's quadrature and closed forms."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.special import ndtr, ndtri
from scipy.stats import multivariate_normal, norm

from occontrol.families.hybrid.guard_probability import guard_probability, guard_transitions
from occontrol.families.hybrid.normal_orthant import normal_cdf, normal_quantile, orthant_probability

NOTHING, NO_SPREAD = np.zeros(0), np.zeros((0, 0))


def by_quadrature(mean, covariance) -> float:
    """Pr{y1 <= 0, y2 <= 0} by conditioning on y1, broken where the inner distribution steps."""
    s1, s2 = np.sqrt(np.diag(covariance))
    r = covariance[0, 1] / (s1 * s2)
    h, k, w = -mean[0] / s1, -mean[1] / s2, np.sqrt(1 - r * r)
    steps = [k / r + m * w / abs(r) for m in (-8, -2, 0, 2, 8)] if abs(r) > 1e-12 else []
    breaks = np.unique(np.clip([-12, -4, 0, 4, h, *steps], -12, max(h, -12)))

    def inside(x):
        return np.exp(-0.5 * x * x) / np.sqrt(2 * np.pi) * ndtr((k - r * x) / w)

    return sum(quad(inside, a, b, epsabs=1e-13, epsrel=1e-12)[0] for a, b in pairwise(breaks))


def test_check_values():
    value, error = guard_probability(
        np.array([[1.0]]), np.zeros(1), np.array([-0.5]), np.array([[5.0]]), NOTHING, NO_SPREAD, 1e-6
    )
    assert value == pytest.approx(0.5884683631209, abs=1e-12)
    assert error == 0.0
    value, _ = orthant_probability(np.array([0.7, -0.4]), np.array([[1.5, 0.6], [0.6, 0.8]]), 1e-6)
    assert value == pytest.approx(0.254012230811, abs=1e-11)


@given(st.floats(-3, 3), st.floats(-3, 3), st.floats(-3.5, 3.5), st.floats(-2, 2), st.floats(-2, 2))
@settings(max_examples=60, deadline=None)
def test_two_rows_to_1e_8(m1, m2, fisher, log1, log2):
    r, s1, s2 = np.tanh(fisher), np.exp(log1), np.exp(log2)
    mean, covariance = np.array([m1 * s1, m2 * s2]), np.array([[s1 * s1, r * s1 * s2], [r * s1 * s2, s2 * s2]])
    value, _ = orthant_probability(mean, covariance, 1e-6)
    assert value == pytest.approx(by_quadrature(mean, covariance), abs=1e-8)


@pytest.mark.parametrize("gap", [1e-6, 1e-10, 1e-14, 0.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_nearly_and_fully_singular_pairs(gap, sign):
    r, h = sign * (1 - gap), 0.3
    value, _ = orthant_probability(np.array([-h, -h]), np.array([[1, r], [r, 1.0]]), 1e-6)
    # Pr{z <= h, r z + s e <= h} is Phi(h) - E over e of what the strip of width s cuts off; known limits at s = 0
    limit = norm.cdf(h) if sign > 0 else 2 * norm.cdf(h) - 1
    width = np.sqrt(max(1 - r * r, 0))
    assert value == pytest.approx(limit, abs=1e-8 + 0.5 * width)
    if gap:
        assert value == pytest.approx(by_quadrature(np.array([-h, -h]), np.array([[1, r], [r, 1.0]])), abs=1e-8)


def test_rows_without_variance_decide_plainly():
    S = np.diag([1.0, 0.0])
    assert orthant_probability(np.array([0.0, -1.0]), S, 1e-6)[0] == pytest.approx(0.5)
    assert orthant_probability(np.array([0.0, 0.0]), S, 1e-6)[0] == pytest.approx(0.5)
    assert orthant_probability(np.array([0.0, 1e-9]), S, 1e-6)[0] == 0.0
    assert orthant_probability(np.array([-1.0]), np.zeros((1, 1)), 1e-6)[0] == 1.0


@pytest.mark.parametrize("rows", [3, 4, 6])
def test_more_rows_within_their_reported_error(rows):
    rng = np.random.default_rng(rows)
    for _ in range(3):
        root = rng.normal(size=(rows, rows))
        mean, S = rng.normal(size=rows) - 0.7, root @ root.T + 0.2 * np.eye(rows)
        value, error = orthant_probability(mean, S, 1e-4)
        judge = multivariate_normal.cdf(np.zeros(rows), mean, S, abseps=1e-6, releps=1e-6, maxpts=400_000)
        assert 0 < error < 1e-3
        assert abs(value - judge) < 2 * error + 1e-5


def test_the_reported_error_is_rarely_exceeded():
    """Three rows have a route of their own: the first coordinate by quadrature, the other two by the rank-two rule."""
    rng = np.random.default_rng(11)
    nodes, weights = np.polynomial.legendre.leggauss(80)
    ratios = []
    for _ in range(150):
        root = rng.normal(size=(3, 3))
        mean, S = rng.normal(size=3) * 0.7, root @ root.T + 0.1 * np.eye(3)
        spread = np.sqrt(S[0, 0])
        top = -mean[0] / spread
        judge, lowest = 0.0, min(-9.0, top - 1.0)
        for u, w in zip(lowest + (top - lowest) * (nodes + 1) / 2, weights * (top - lowest) / 2, strict=True):
            rest = mean[1:] + S[1:, 0] / spread * u
            conditional = S[1:, 1:] - np.outer(S[1:, 0], S[0, 1:]) / S[0, 0]
            judge += w * norm.pdf(u) * orthant_probability(rest, conditional, 1e-6)[0]
        value, error = orthant_probability(mean, S, 5e-4)
        assert error < 5e-4 * 5 / 3
        ratios.append(abs(value - judge) / error)
    # among 3000 such cases two exceeded it, the worst by 4 %
    assert sum(ratio > 1 for ratio in ratios) <= 1
    assert max(ratios) < 1.2


def test_a_box_has_four_rows_of_rank_two_and_is_exact():
    S, mean = np.array([[1, 0.5], [0.5, 2.0]]), np.array([0.2, -0.3])
    L, b = np.array([[1, 0], [-1, 0], [0, 1], [0, -1.0]]), np.array([-1, -0.7, -0.5, -1.0])
    value, error = guard_probability(L, b, mean, S, NOTHING, NO_SPREAD, 1e-6)
    corners = [((1, 0.5), 1), ((-0.7, 0.5), -1), ((1, -1), -1), ((-0.7, -1), 1)]
    exact = sum(sign * by_quadrature(mean - np.array(corner), S) for corner, sign in corners)
    assert value == pytest.approx(exact, abs=1e-8)
    assert error < 1e-7


def test_a_threshold_adds_its_mean_and_its_spread():
    L = np.array([[1.0, 0.0, -1.0]])
    value, _ = guard_probability(
        L, np.array([0.5]), np.array([2.0, 9.0]), np.diag([3.0, 1.0]), np.array([1.0]), np.array([[4.0]]), 1e-6
    )
    assert value == pytest.approx(norm.cdf(-(2.0 - 1.0 + 0.5) / np.sqrt(7.0)), abs=1e-12)


def test_quantile_inverts_the_distribution_function():
    for p in [1e-280, 1e-30, 1e-6, 0.02, 0.3, 0.5, 0.9, 1 - 1e-9]:
        assert normal_quantile(p) == pytest.approx(ndtri(p), rel=1e-7, abs=1e-12)
        assert normal_cdf(normal_quantile(p)) == pytest.approx(p, rel=1e-9)


def transitions(source, target, b):
    L = np.ones((len(source), 1, 1))
    arrays = [np.array(a, dtype=np.int64) for a in (source, target, [1] * len(source))]
    means, covariances = np.zeros((2, 1)), np.ones((2, 1, 1))
    return guard_transitions(
        means, covariances, *arrays, L, np.array(b, dtype=float)[:, None], NOTHING, NO_SPREAD, 1e-6
    )


def test_what_the_guards_leave_is_the_probability_to_stay():
    matrix, excess, _ = transitions([0, 1], [1, 0], [0.0, 1.0])
    assert matrix == pytest.approx(np.array([[0.5, 0.5], [norm.cdf(-1), norm.cdf(1)]]))
    assert excess == 0.0


def test_overlapping_guards_are_divided_by_their_sum_and_reported():
    matrix, excess, _ = transitions([0, 0, 1], [1, 0, 0], [-1.0, -1.0, 0.0])
    assert matrix[0] == pytest.approx([0.5, 0.5])
    assert excess == pytest.approx(2 * norm.cdf(1) - 1)


def test_guards_that_leave_a_gap_are_divided_by_their_sum_and_reported():
    matrix, excess, _ = transitions([0, 0, 1], [1, 0, 0], [2.0, 1.0, 0.0])
    assert matrix[0].sum() == pytest.approx(1)
    assert excess == pytest.approx(1 - norm.cdf(-1) - norm.cdf(-2))

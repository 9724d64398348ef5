"""Sizes of ellipsoids: against geometry, their own gradients, and the convexity that the bounds rest on."""

import numpy as np
import pytest

from occontrol.families.robust.ellipsoid_size import Size

ALL = ["trace", "volume", "longest-axis", {"volume": 1, "longest-axis": 10}, {"trace": 2, "volume": 0.5}]


def random_shape(rng, n=3):
    root = rng.normal(size=(n, n))
    return root @ root.T + 0.1 * np.eye(n)


def test_sizes_of_a_ball_and_of_a_box_aligned_ellipsoid():
    semi = np.array([2.0, 1.0, 0.5])
    P, d = np.diag(semi**2) / 4.0, 4.0
    assert Size.of("trace").value(P, d) == pytest.approx(np.sum(semi**2))
    assert Size.of("volume").value(P, d) == pytest.approx(4 / 3 * np.pi * np.prod(semi))
    assert Size.of("longest-axis").value(P, d) == pytest.approx(2.0)
    assert Size.of({"volume": 2, "longest-axis": 10}).value(P, d) == pytest.approx(8 / 3 * np.pi + 20.0)


@pytest.mark.parametrize("terms", ALL)
def test_the_gradient_is_the_derivative(terms):
    rng, size, step = np.random.default_rng(0), Size.of(terms), 1e-6
    P, d = random_shape(rng), 1.7
    change = rng.normal(size=(3, 3))
    change = change + change.T
    difference = (size.value(P + step * change, d) - size.value(P - step * change, d)) / (2 * step)
    value, gradient = size.support(P, d)
    assert value == pytest.approx(float(size.value(P, d)))
    assert np.sum(gradient * change) == pytest.approx(difference, rel=1e-6)
    f = [size.smooth(P + s * step * change, d, 8.0)[0] for s in (-1, 1)]
    assert np.sum(size.smooth(P, d, 8.0)[1] * change) == pytest.approx((f[1] - f[0]) / (2 * step), rel=1e-6)


@pytest.mark.parametrize("terms", ALL)
@pytest.mark.parametrize("power", [np.inf, 16.0])
def test_the_support_is_a_plane_below_the_size_in_the_inverse(terms, power):
    """size(Q) >= value + <gradient, -P (Y_Q - Y_P) P> for every Q: convexity in the inverse."""
    rng, size = np.random.default_rng(5), Size.of(terms)
    P = random_shape(rng)
    value, gradient = size.support(P, 2.0, power)
    for _ in range(300):
        Q = random_shape(rng) * np.exp(rng.normal())
        plane = value - np.sum(P @ gradient @ P * (np.linalg.inv(Q) - np.linalg.inv(P)))
        assert plane <= float(size.value(Q, 2.0)) * (1 + 1e-12)


def test_degree_and_homogeneity():
    P = random_shape(np.random.default_rng(2))
    for terms in ALL:
        size = Size.of(terms)
        grown = float(size.value(3.0 * P, 1.0))
        assert grown <= 3.0 ** size.degree(3) * float(size.value(P, 1.0)) * (1 + 1e-12)
        assert size.homogeneous(3) is isinstance(terms, str)
    assert Size.of({"trace": 1, "volume": 1}).homogeneous(2)

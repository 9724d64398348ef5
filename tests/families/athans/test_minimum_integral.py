"""The integral of a minimum: safe from below and accurate, with kinks anywhere."""

import itertools

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from occontrol.families.athans.continuous.minimum_integral import cheapest_vertices, minimum_integral
from occontrol.numerics.gauss import bernstein_matrix, gauss_nodes, halving_matrices, integration_matrix, tail


def test_gauss_tables_are_exact_for_polynomials():
    c, w = gauss_nodes()
    for k in range(8):
        np.testing.assert_allclose(integration_matrix() @ c**k, c ** (k + 1) / (k + 1), atol=1e-15)
        assert np.isclose(w @ c**k, 1 / (k + 1), rtol=1e-14)
    b = bernstein_matrix() @ (c**3)
    left, right = halving_matrices()
    np.testing.assert_allclose(left @ b, bernstein_matrix() @ (c / 2) ** 3, atol=1e-12)
    np.testing.assert_allclose(right @ b, bernstein_matrix() @ (0.5 + c / 2) ** 3, atol=1e-12)


def test_tail_bounds_the_interpolation_error_of_smooth_functions():
    c, _ = gauss_nodes()
    dense = np.linspace(0, 1, 200)
    powers = np.vander(c, increasing=True)
    for scale in (0.1, 0.5, 1.0):
        for f in (np.exp, np.cos, lambda x: 1 / (2 + x)):
            exact, values = f(scale * dense), f(scale * c)
            error = np.abs(np.vander(dense, 8, increasing=True) @ np.linalg.solve(powers, values) - exact).max()
            assert error <= 3 * tail(values[None])[0] + 3e-13


def test_cheapest_vertices_fill_the_cheapest_first():
    w = cheapest_vertices(np.array([[3.0, 1.0, 2.0]]), np.array([[1.0, 1.0, 1.0]]), 2)
    np.testing.assert_array_equal(w, [[0, 1, 1]])
    w = cheapest_vertices(np.array([[3.0, 1.0, 2.0]]), np.array([[1.0, 0.0, 3.0]]), 2)
    np.testing.assert_array_equal(w, [[0, 0, 2]])


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6), select=st.integers(1, 2))
def test_bound_is_below_and_close(seed, select):
    rng = np.random.default_rng(seed)
    c, _ = gauss_nodes()
    coefficients = rng.normal(size=(4, 3, 6))  # panels, sensors, cubic and higher terms
    lengths = rng.uniform(0.2, 2, size=4)
    values = np.einsum("pmk,ik->pim", coefficients, np.vander(c, 6, increasing=True))
    bound, excess = minimum_integral(lengths, values, np.ones((4, 3)), select, 1e-9)

    exact = 0.0
    for h, poly in zip(lengths, coefficients, strict=True):
        roots = [np.roots((poly[i] - poly[j])[::-1]) for i in range(3) for j in range(i)]
        cuts = [float(r.real) for r in np.concatenate(roots) if abs(r.imag) < 1e-6 and 0 < r.real < 1]
        cuts = np.unique([0.0, *cuts, 1.0])
        least = lambda x, poly=poly: np.sort(poly @ x ** np.arange(6))[:select].sum()  # noqa: E731
        exact += h * sum(quad(least, a, b, epsabs=1e-13)[0] for a, b in itertools.pairwise(cuts))
    assert excess <= 1e-9
    assert bound <= exact + 1e-11
    assert exact <= bound + excess + 1e-11


def test_equal_functions_need_no_halving():
    values = np.ones((5000, 8, 2))
    bound, excess = minimum_integral(np.full(5000, 0.1), values, np.ones((5000, 2)), 1, 1e-9)
    assert np.isclose(bound, 500) and excess <= 1e-9

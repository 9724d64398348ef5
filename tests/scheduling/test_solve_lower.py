"""Triangular solves by BLAS itself."""

import numpy as np
import pytest

from occontrol.numerics.linalg import solve_lower


@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (6, 6), (7, 2), (0, 3), (3, 0), (0, 0)])
@pytest.mark.parametrize("order", ["C", "F"])
def test_it_solves(rows, columns, order):
    rng = np.random.default_rng(rows)
    lower = np.array(np.tril(rng.normal(size=(rows, rows))) + 3 * np.eye(rows), order=order)
    right = np.array(rng.normal(size=(rows, columns)), order=order)
    kept = lower.copy(), right.copy()
    found = solve_lower(lower, right)
    assert found.shape == (rows, columns)
    np.testing.assert_allclose(lower @ found, right, atol=1e-12)
    np.testing.assert_array_equal(lower, kept[0])
    np.testing.assert_array_equal(right, kept[1])

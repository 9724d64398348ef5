"""Clarabel called directly: packing, optimality conditions, and the size limit."""

import numpy as np
import pytest

from occontrol.numerics.sdp import LARGEST, pack, solve_lmi, unpack


def test_packing_keeps_inner_products():
    rng = np.random.default_rng(0)
    a, b = (m + m.T for m in rng.standard_normal((2, 5, 5)))
    assert np.isclose(pack(a) @ pack(b), np.sum(a * b)) and np.allclose(unpack(pack(a), 5), a)


@pytest.mark.parametrize("capped", [False, True])
def test_optimality_conditions(capped):
    rng = np.random.default_rng(1)
    factors, costs = rng.standard_normal((6, 4)), rng.uniform(0.5, 2, 6)
    upper = np.array([0.2, np.inf, np.inf, 0.3, np.inf, np.inf]) if capped else np.full(6, np.inf)
    constant = -np.eye(4)
    found = solve_lmi(constant, factors, costs, upper)
    matrix = constant + factors.T @ (found.values[:, None] * factors)
    assert np.linalg.eigvalsh(matrix)[0] > -1e-8 and np.linalg.eigvalsh(found.dual)[0] > -1e-8
    assert abs(np.sum(matrix * found.dual)) < 1e-8
    pull = costs - np.einsum("ir,rs,is->i", factors, found.dual, factors)  # multiplier of >= 0 minus that of the cap
    free = np.isinf(upper)
    assert np.all(pull[free] > -1e-8) and np.all(np.abs(pull * found.values)[free] < 1e-7)
    assert np.all(found.values <= upper + 1e-9)


def test_too_many_rows_are_refused():
    with pytest.raises(ValueError, match="too large"):
        solve_lmi(np.eye(LARGEST + 1), np.ones((1, LARGEST + 1)), np.ones(1), np.ones(1))

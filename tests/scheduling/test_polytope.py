"""Vertices, projections and equal shares of the set of one interval's weights."""

import numpy as np
import pytest
from scipy.optimize import linprog, minimize

from occontrol.scheduling.cuts import Cuts
from occontrol.scheduling.feasible_set import IntervalPolytopes
from occontrol.scheduling.polytope import excess, project, uniform, vertex


def random_set(rng, N, M, select):
    upper = (rng.random((N, M)) < 0.7).astype(float)
    upper[:, -1] = select
    return upper


@pytest.mark.parametrize("select", [1, 2, 3])
def test_vertex_is_the_linear_program(select):
    rng = np.random.default_rng(select)
    upper, g = random_set(rng, 20, 5, select), rng.normal(size=(20, 5))
    w = vertex(g, upper, select)
    for k in range(20):
        lp = linprog(g[k], A_eq=np.ones((1, 5)), b_eq=[select], bounds=[(0, u) for u in upper[k]])
        assert g[k] @ w[k] == pytest.approx(lp.fun, abs=1e-9)
    v = uniform(upper, select)
    np.testing.assert_allclose(v.sum(axis=1), select)
    assert np.all(v >= 0) and np.all(v <= upper + 1e-12)
    np.testing.assert_allclose(excess(v, g, upper, select), np.sum(g * (v - w), axis=1), atol=1e-12)


@pytest.mark.parametrize("select", [1, 2, 3])
def test_projection_is_the_nearest_point(select):
    rng = np.random.default_rng(10 + select)
    upper, y = random_set(rng, 12, 5, select), 2 * rng.normal(size=(12, 5))
    w = project(y, upper, select)
    np.testing.assert_allclose(w.sum(axis=1), select, atol=1e-12)
    assert np.all(w >= 0) and np.all(w <= upper)
    for k in range(12):
        best = minimize(
            lambda x, k=k: np.sum((x - y[k]) ** 2),
            uniform(upper[k : k + 1], select)[0],
            bounds=[(0, u) for u in upper[k]],
            constraints={"type": "eq", "fun": lambda x: np.sum(x) - select},
            tol=1e-12,
        )
        assert np.sum((w[k] - y[k]) ** 2) <= best.fun + 1e-8
    np.testing.assert_allclose(project(w, upper, select), w, atol=1e-12)


def test_mixed_cuts_prove_more_than_the_best_alone():
    # f(w) = |w1 - w2| on the simplex: each cut alone proves little, half of each proves the optimum
    cuts = Cuts(IntervalPolytopes(np.ones((1, 2)), 1))
    for w, g in (([1.0, 0.0], [1.0, -1.0]), ([0.0, 1.0], [-1.0, 1.0])):
        cuts.add(1.0, np.array([g]), np.array([w]))
    assert cuts.bound(200) == pytest.approx(0.0, abs=0.02)
    assert cuts.bound(200) <= 0.0

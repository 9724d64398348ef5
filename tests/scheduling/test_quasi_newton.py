"""The direction on a face against BFGS matrices that are really formed, updated one pair after the other."""

import numpy as np
import pytest
from scipy.linalg import block_diag, null_space

from occontrol.scheduling.feasible_set import IntervalPolytopes
from occontrol.scheduling.quasi_newton import FaceBFGS


def dense_bfgs(gamma, pairs):
    B = gamma * np.eye(len(pairs[0][0]))
    for s, y in pairs:
        Bs = B @ s
        B = B - np.outer(Bs, Bs) / (s @ Bs) + np.outer(y, y) / (s @ y)
    return B


@pytest.mark.parametrize("given", [1, 3, 6, 11])
@pytest.mark.parametrize("seed", range(3))
def test_the_direction_is_that_of_the_whole_matrix_on_the_face(given, seed):
    rng = np.random.default_rng(seed)
    N, M, memory = 7, 4, 6
    root = rng.normal(size=(N * M, N * M))
    hessian = root @ root.T + np.eye(N * M)
    allowed = IntervalPolytopes(np.ones((N, M)), 1)
    bfgs = FaceBFGS(N * M, memory)
    pairs = []
    for _ in range(given):
        s = rng.normal(size=(N, M))
        s -= s.mean(axis=1, keepdims=True)
        y = (hessian @ s.ravel()).reshape(N, M)
        bfgs.update(s, y)
        pairs.append((s.ravel(), y.ravel()))
    pairs = pairs[-memory:]  # more than fit: the oldest are forgotten
    # one interval at a vertex, one with a single weight at zero, the others inside
    weights = rng.dirichlet(np.full(M, 5.0), size=N)
    weights[0] = np.eye(M)[1]
    weights[1, 2] = 0.0
    weights[1] /= weights[1].sum()
    gradient = rng.normal(size=(N, M))
    gradient[0, 1] = gradient[0].min() - 1.0  # stays at its vertex
    gradient[1, 2] = gradient[1].max() + 1.0  # stays at zero
    free = np.ones((N, M), dtype=bool)
    free[0], free[1, 2] = False, False
    sums = block_diag(*[row[None, :] for row in free.astype(float)])
    plane = null_space(np.vstack([sums[1:], np.eye(N * M)[~free.ravel()]]))
    s, y = (plane.T @ x for x in pairs[-1])
    B = dense_bfgs((y @ y) / (s @ y), pairs)
    expected = -plane @ np.linalg.solve(plane.T @ B @ plane, plane.T @ gradient.ravel())
    found = bfgs.direction(weights, gradient, allowed)
    np.testing.assert_allclose(found.ravel(), expected, rtol=1e-8, atol=1e-10 * np.max(np.abs(expected)))
    assert np.all(found[~free] == 0.0)


def test_a_sliver_pushed_to_its_bound_gives_its_weight_to_the_anchor():
    bfgs = FaceBFGS(3)
    weights = np.array([[0.7, 0.3 - 1e-7, 1e-7]])
    found = bfgs.direction(weights, np.array([[0.0, 0.0, 1.0]]), IntervalPolytopes(np.ones((1, 3)), 1))
    assert found[0, 2] == -1e-7 and abs(found.sum()) < 1e-20

"""The AD equations against the formulas of the paper, and the factor 2 of packed triangles."""

import numpy as np
import pytest

from occontrol.families.athans.hamiltonian import canonical_equations, information_rates
from occontrol.numerics.linalg import square_root, triangle_weights, unvech, vech


def symmetric(rng, n):
    root = rng.normal(size=(n, n))
    return root @ root.T


def sample(seed, n, sizes):
    rng = np.random.default_rng(seed)
    C = [rng.normal(size=(m, n)) for m in sizes]
    theta = [symmetric(rng, m) + 0.1 * np.eye(m) for m in sizes]
    data = {
        "covariance": symmetric(rng, n),
        "costate": symmetric(rng, n),
        "weights": rng.random(len(sizes)),
        "A": rng.normal(size=(n, n)),
        "noise": symmetric(rng, n),
        "costs": rng.random(len(sizes)),
        "cost_weight": 0.7,
        "running": symmetric(rng, n),
    }
    return data, C, theta


def evaluate(data, C, theta):
    rates = [information_rates(c, t) for c, t in zip(C, theta, strict=True)]
    answer = canonical_equations(len(data["A"]), len(C))(**data, rates=np.hstack(rates))
    return {name: np.array(value) for name, value in answer.items()}


@pytest.mark.parametrize("seed", range(20))
def test_canonical_equations_are_the_papers(seed):
    n = 1 + seed % 6
    data, C, theta = sample(seed, n, [0, 1, 2, min(3, n)])
    found = evaluate(data, C, theta)
    S, P, A, v, q = (data[k] for k in ("covariance", "costate", "A", "weights", "costs"))
    rates = [c.T @ np.linalg.inv(t) @ c for c, t in zip(C, theta, strict=True)]
    L = sum(w * r for w, r in zip(v, rates, strict=True))
    terms = [A @ S, S @ A.T, data["noise"], S @ L @ S]
    expected = terms[0] + terms[1] + terms[2] - terms[3]
    scale = max(np.abs(t).max() for t in terms)
    assert np.abs(found["covariance_rate"] - expected).max() <= 1e-14 * scale  # (5.3)
    terms = [P @ A, A.T @ P, P @ S @ L, L @ S @ P, data["running"]]
    expected = -terms[0] - terms[1] + terms[2] + terms[3] - terms[4]
    scale = max(np.abs(t).max() for t in terms)
    assert np.abs(found["costate_rate"] - expected).max() <= 1e-14 * scale  # (5.4) with the running term
    for j, rate in enumerate(rates):
        gain = np.trace(rate @ S @ P @ S)
        switching = 0.7 * q[j] - gain  # (5.12)
        assert abs(found["switching"][j, 0] - switching) <= 1e-14 * n * max(
            1.0, np.abs(rate).sum() * np.abs(S @ P @ S).max()
        )


def test_hamiltonian_is_constant_along_a_trajectory_of_constant_data():
    from scipy.integrate import solve_ivp

    data, C, theta = sample(3, 3, [1, 2])
    for name in ("A", "noise", "covariance"):
        data[name] = data[name] * 0.3
    size = 9

    def field(t, y):
        point = {**data, "covariance": y[:size].reshape(3, 3), "costate": y[size:].reshape(3, 3)}
        found = evaluate(point, C, theta)
        return np.concatenate([found["covariance_rate"].ravel(), found["costate_rate"].ravel()])

    start = np.concatenate([data["covariance"].ravel(), data["costate"].ravel()])
    ends = solve_ivp(field, (0, 0.3), start, rtol=1e-11, atol=1e-12).y
    values = [
        evaluate({**data, "covariance": y[:size].reshape(3, 3), "costate": y[size:].reshape(3, 3)}, C, theta)[
            "hamiltonian"
        ][0, 0]
        for y in ends.T
    ]
    assert np.ptp(ends[0]) > 1e-2
    assert np.ptp(values) <= 1e-8 * abs(values[0])


@pytest.mark.parametrize("n", [1, 2, 5])
def test_packed_derivative_is_the_full_one_times_the_triangle_weights(n):
    casadi = pytest.importorskip("casadi")
    rng = np.random.default_rng(n)
    x, Y = symmetric(rng, n), symmetric(rng, n)
    packed = casadi.SX.sym("x", n * (n + 1) // 2)
    X = unvech(packed)
    value = casadi.trace(X @ casadi.DM(Y) @ X)
    gradient = casadi.Function("g", [packed], [casadi.gradient(value, packed)])(vech(x))
    full = x @ Y + Y @ x
    np.testing.assert_allclose(np.array(gradient).ravel(), triangle_weights(n) * vech(full), rtol=1e-13)
    assert np.isclose(np.trace(x @ Y), np.sum(triangle_weights(n) * vech(x) * vech(Y)))
    np.testing.assert_array_equal(unvech(vech(x)), (x + x.T) / 2)


def test_square_root_of_a_singular_matrix():
    rng = np.random.default_rng(0)
    thin = rng.normal(size=(7, 4, 2)) * np.array([1e3, 1.0, 1e-4, 1.0])[:, None]
    matrices = thin @ np.swapaxes(thin, 1, 2)
    root = square_root(matrices)
    np.testing.assert_allclose(root @ np.swapaxes(root, 1, 2), matrices, rtol=1e-9, atol=1e-11)

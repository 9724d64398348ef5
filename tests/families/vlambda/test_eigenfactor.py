"""V-Lambda updates against a Joseph-form Kalman filter and against exact rational arithmetic."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from occontrol.families.vlambda.eigenfactor import (
    Eigenfactors,
    eigenfactors_of,
    measurement_update,
    thin_svd,
    time_update,
)
from occontrol.families.vlambda.eigenfactor_covariance import measurement_update_covariance, time_update_covariance
from occontrol.numerics.linalg import whiten


def covariance(generator, n):
    root = generator.standard_normal((n, n))
    return root @ root.T + 0.1 * np.eye(n)


def joseph(P, x, H, R, y):
    S = H @ P @ H.T + R
    K = np.linalg.solve(S, H @ P).T
    A = np.eye(len(P)) - K @ H
    innovation = y - H @ x
    return A @ P @ A.T + K @ R @ K.T, x + K @ innovation, innovation @ np.linalg.solve(S, innovation)


def relative(a, b):
    return np.max(np.abs(a - b)) / np.max(np.abs(b))


# n states, m values, p noise inputs: a single state, more values than states, fewer noises than states
SIZES = [(1, 1, 1), (1, 3, 1), (2, 5, 1), (3, 2, 3), (4, 1, 2), (6, 2, 1), (5, 7, 5), (10, 3, 4)]


@pytest.mark.parametrize(("n", "m", "p"), SIZES)
@pytest.mark.parametrize("seed", range(4))
def test_equals_a_joseph_form_kalman_filter_on_random_time_varying_systems(n, m, p, seed):
    g = np.random.default_rng([n, m, p, seed])
    P, x = covariance(g, n) * 10 ** g.uniform(-2, 3), g.standard_normal(n)
    factors, mean = eigenfactors_of(P), x
    for _ in range(40):
        H, R, y = g.standard_normal((m, n)), covariance(g, m), 3 * g.standard_normal(m)
        rows, values = whiten(R, H, y)
        factors, mean, innovation = measurement_update(factors, mean, rows, values)
        P, x, expected = joseph(P, x, H, R, y)
        assert relative(factors.covariance, P) < 1e-10
        assert relative(mean, x) < 1e-10
        assert innovation == pytest.approx(expected, rel=1e-9)
        F = g.standard_normal((n, n)) + 0.5 * np.eye(n)
        G, Q = g.standard_normal((n, p)), covariance(g, p)
        result = time_update(factors, F, G @ np.linalg.cholesky(Q))
        if result.factors is None or result.loss > 1e-12:  # F happens to be nearly singular
            result = time_update_covariance(factors, F, G @ np.linalg.cholesky(Q))
        factors, mean = result.factors, F @ mean
        P, x = F @ P @ F.T + G @ Q @ G.T, F @ x
        assert relative(factors.covariance, P) < 1e-10
        # sorted, orthonormal, positive
        assert np.all(np.diff(factors.deviations) <= 0)
        assert factors.deviations[-1] > 0
        assert np.allclose(factors.vectors.T @ factors.vectors, np.eye(n), atol=1e-13)


def exact(matrix):
    return [[Fraction(float(e)) for e in row] for row in np.atleast_2d(matrix)]


def times(a, b):
    return [
        [sum((x * y for x, y in zip(row, column, strict=True)), Fraction(0)) for column in zip(*b, strict=True)]
        for row in a
    ]


def plus(a, b):
    return [[x + y for x, y in zip(r, s, strict=True)] for r, s in zip(a, b, strict=True)]


def transpose(a):
    return [list(row) for row in zip(*a, strict=True)]


def inverse(a):
    n = len(a)
    work = [list(row) + [Fraction(int(i == j)) for j in range(n)] for i, row in enumerate(a)]
    for i in range(n):
        pivot = max(range(i, n), key=lambda r: abs(work[r][i]))
        work[i], work[pivot] = work[pivot], work[i]
        work[i] = [x / work[i][i] for x in work[i]]
        for r in range(n):
            if r != i and work[r][i]:
                factor = work[r][i]
                work[r] = [x - factor * y for x, y in zip(work[r], work[i], strict=True)]
    return [row[n:] for row in work]


def huge_prior(steps=6):
    """n = 4 with P0 = 1e16 I and one value at a time; covariances in exact arithmetic."""
    g = np.random.default_rng(5)
    n = 4
    F, G = g.standard_normal((n, n)) / 2 + np.eye(n), 0.1 * g.standard_normal((n, 2))
    rows = [g.standard_normal((1, n)) for _ in range(steps)]
    P, posterior = exact(1e16 * np.eye(n)), []
    for C in rows:
        information = plus(inverse(P), times(transpose(exact(C)), exact(C)))
        posterior.append(inverse(information))
        P = plus(times(times(exact(F), posterior[-1]), transpose(exact(F))), times(exact(G), transpose(exact(G))))
    along = [float(times(times(exact(C), P), transpose(exact(C)))[0][0]) for C, P in zip(rows, posterior, strict=True)]
    return F, G, rows, [np.array([[float(e) for e in row] for row in P]) for P in posterior], along


def test_a_prior_of_1e16_keeps_relative_accuracy_in_every_direction():
    F, G, rows, expected, along = huge_prior()
    factors = eigenfactors_of(1e16 * np.eye(4))
    for k, C in enumerate(rows):
        factors, _, _ = measurement_update(factors, np.zeros(4), C)
        assert relative(factors.covariance, expected[k]) < 1e-12, k
        # the direction that has just been measured too, which the sum of huge entries would hide
        assert np.sum((C @ factors.root) ** 2) == pytest.approx(along[k], rel=1e-6)
        assert np.all(factors.eigenvalues > 0)
        factors = time_update(factors, F, G).factors


def test_a_short_form_kalman_filter_fails_where_the_eigenfactors_do_not():
    F, G, rows, expected, _ = huge_prior()
    P, worst, indefinite = 1e16 * np.eye(4), 0.0, False
    for k, C in enumerate(rows):
        K = P @ C.T / (C @ P @ C.T + 1.0)
        P = P - K @ C @ P
        indefinite |= bool(np.linalg.eigvalsh((P + P.T) / 2)[0] < 0)
        worst = relative(P, expected[k])
        P = F @ P @ F.T + G @ G.T
    assert indefinite
    assert worst > 1e-3  # after the state has become observable the eigenfactors are right to 1e-12


def test_small_singular_values_of_a_graded_matrix_are_right_to_the_last_digits():
    g = np.random.default_rng(0)
    V = np.linalg.qr(g.standard_normal((4, 4)))[0]
    matrix = np.vstack([1e-8 * V.T, 10 * g.standard_normal((2, 4))])
    gram = times(transpose(exact(matrix)), exact(matrix))
    largest = np.linalg.eigvalsh(np.array([[float(e) for e in row] for row in inverse(gram)]))[::-1][:2]
    left, values, right = thin_svd(matrix)
    assert 1 / values[::-1][:2] ** 2 == pytest.approx(largest, rel=1e-13)
    assert np.allclose(left * values @ right.T, matrix, atol=1e-14)


@pytest.mark.parametrize("scale", [1e-3, 1e-6, 1e-9, 1e-12])
def test_the_loss_of_a_contracting_transition_is_foreseen(scale):
    g = np.random.default_rng(1)
    F, G, P = scale * (g.standard_normal((3, 3)) + np.eye(3)), np.eye(3), covariance(g, 3)
    result = time_update(eigenfactors_of(P), F, G)
    expected = F @ P @ F.T + G @ G.T
    error = relative(result.factors.covariance, expected)
    assert error < 100 * result.loss, "the estimate must not be too rosy"
    assert result.loss < 1e4 * max(error, 1e-16), "nor cry wolf"
    assert relative(time_update_covariance(eigenfactors_of(P), F, G).factors.covariance, expected) < 1e-14


def test_a_singular_transition_is_refused_by_the_information_form_and_done_by_the_other():
    P = np.diag([3.0, 2.0, 1.0])
    for F in (np.zeros((3, 3)), np.diag([1.0, 1.0, 0.0]), np.outer([1.0, 2, 3], [1.0, 1, 1])):
        assert time_update(eigenfactors_of(P), F, np.eye(3)).factors is None
        other = time_update_covariance(eigenfactors_of(P), F, np.eye(3)).factors
        assert np.allclose(other.covariance, F @ P @ F.T + np.eye(3), atol=1e-13)


@pytest.mark.parametrize("m", [1, 2, 5])
def test_a_singular_covariance_is_measured_in_covariance_form(m):
    g = np.random.default_rng(m)
    root = g.standard_normal((4, 2))
    P, x = root @ root.T, g.standard_normal(4)
    H, R, y = g.standard_normal((m, 4)), covariance(g, m), g.standard_normal(m)
    factors, mean, innovation = measurement_update_covariance(eigenfactors_of(P), x, *whiten(R, H, y))
    expected, x_expected, nis = joseph(P, x, H, R, y)
    assert np.allclose(factors.covariance, expected, atol=1e-13)
    assert np.allclose(mean, x_expected, atol=1e-12)
    assert innovation == pytest.approx(nis, rel=1e-10)
    assert np.linalg.matrix_rank(factors.covariance, tol=1e-10) == 2


def test_both_forms_agree_where_both_apply():
    g = np.random.default_rng(3)
    P, x = covariance(g, 5), g.standard_normal(5)
    rows, values = g.standard_normal((3, 5)), g.standard_normal(3)
    one = measurement_update(eigenfactors_of(P), x, rows, values)
    other = measurement_update_covariance(eigenfactors_of(P), x, rows, values)
    assert relative(one[0].covariance, other[0].covariance) < 1e-13
    assert relative(one[1], other[1]) < 1e-12
    assert one[2] == pytest.approx(other[2])


def test_information_along_the_worst_eigenspace_adds_up():
    """Remark 4, equation (22): P+^-1 E = E/lambda + J E, and its trace."""
    g = np.random.default_rng(8)
    V = np.linalg.qr(g.standard_normal((5, 5)))[0]
    factors = Eigenfactors(V, np.sqrt(np.array([4.0, 4.0, 2.0, 1.0, 0.5])))
    rows = g.standard_normal((2, 5))
    after = measurement_update(factors, np.zeros(5), rows)[0]
    E = V[:, :2] @ V[:, :2].T
    J = rows.T @ rows
    left = np.linalg.inv(after.covariance) @ E
    assert np.allclose(left, E / 4 + J @ E, atol=1e-12)
    assert np.trace(left) == pytest.approx(2 / 4 + np.trace(J @ E))


def test_a_measurement_without_values_updates_the_covariance_alone():
    g = np.random.default_rng(9)
    P, x, rows = covariance(g, 3), g.standard_normal(3), g.standard_normal((2, 3))
    factors, mean, innovation = measurement_update(eigenfactors_of(P), x, rows)
    assert np.array_equal(mean, x)
    assert np.isnan(innovation)
    assert np.allclose(np.linalg.inv(factors.covariance), np.linalg.inv(P) + rows.T @ rows)

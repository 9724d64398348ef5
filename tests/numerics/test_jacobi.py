"""Jacobi's rotations against the definition, and against LAPACK."""

from __future__ import annotations

import numpy as np
import pytest

from occontrol.numerics.jacobi import diagonalise


@pytest.mark.parametrize("n", [1, 2, 5, 9])
@pytest.mark.parametrize("spread", [1.0, 1e6])
def test_eigenvalues_and_vectors(n: int, spread: float) -> None:
    g = np.random.default_rng(n)
    scale = np.geomspace(1.0, spread, n)
    S = g.standard_normal((n, n))
    S = scale[:, None] * (S + S.T) * scale
    A, V = np.full((n + 2, n + 2), np.nan), np.full((n + 2, n + 2), np.nan)  # work space may be larger
    A[:n, :n] = S
    diagonalise(A, V, n)
    values, V = np.diag(A)[:n], V[:n, :n]
    size = np.max(np.abs(S))
    assert np.sort(values) == pytest.approx(np.linalg.eigvalsh(S), rel=1e-12, abs=1e-14 * n * size)
    assert V.T @ V == pytest.approx(np.eye(n), abs=1e-13)
    assert (V * values) @ V.T == pytest.approx(S, abs=1e-14 * n * size)


def test_equal_eigenvalues_and_nothing_at_all() -> None:
    for S in (np.zeros((3, 3)), np.eye(3), np.diag([1.0, -1.0, 1.0]), np.ones((3, 3))):
        A, V = S.copy(), np.empty((3, 3))
        diagonalise(A, V, 3)
        assert (V * np.diag(A)) @ V.T == pytest.approx(S, abs=1e-14)

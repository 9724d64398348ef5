"""Gauss-Legendre panels: values at the nodes of [0, 1] stand for the polynomial through them.

Unknowns of a panel: values[i] at nodes[i], i = 0 .. NODES-1, the node first in every array. The Bernstein form bounds
the polynomial from both sides, which makes the integral of a minimum of polynomials safe to bound.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.polynomial import legendre

NODES = 8


@lru_cache(maxsize=8)
def gauss_nodes(count: int = NODES) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights of Gauss-Legendre quadrature on [0, 1]; exact for degree 2 count - 1."""
    x, w = legendre.leggauss(count)
    return (x + 1) / 2, w / 2


@lru_cache(maxsize=8)
def legendre_matrix(count: int = NODES) -> np.ndarray:
    """(count, count) from node values to Legendre coefficients on [0, 1], lowest degree first."""
    c, w = gauss_nodes(count)
    values = legendre.legvander(2 * c - 1, count - 1)
    return (2 * np.arange(count)[:, None] + 1) * values.T * w


@lru_cache(maxsize=8)
def integration_matrix(count: int = NODES) -> np.ndarray:
    """(count, count) from node values to the integrals of the polynomial from 0 to each node."""
    c, _ = gauss_nodes(count)
    antiderivatives = np.zeros((count, count))
    for k in range(count):
        series = legendre.legint(np.eye(count)[k], lbnd=-1) / 2
        antiderivatives[:, k] = legendre.legval(2 * c - 1, series)
    return antiderivatives @ legendre_matrix(count)


def legendre_coefficients(values: np.ndarray) -> np.ndarray:
    """Legendre coefficients, lowest degree first, of the polynomials through values (P, count, ...), of that shape."""
    flat = values.reshape(len(values), values.shape[1], int(np.prod(values.shape[2:])))
    return (legendre_matrix(values.shape[1]) @ flat).reshape(values.shape)


@lru_cache(maxsize=8)
def legendre_powers(count: int = NODES) -> np.ndarray:
    """(count, count) row k: the Legendre polynomial of degree k on [0, 1] in powers of t."""
    from math import comb

    rows = range(count)
    return np.array([[(-1.0) ** (k + i) * comb(k, i) * comb(k + i, i) if i <= k else 0.0 for i in rows] for k in rows])


def tail(values: np.ndarray) -> np.ndarray:
    """Estimated largest error between the nodes of the polynomials through values (P, count, ...), shape (P, ...).

    The last two Legendre coefficients, carried on by the decay over the two before them, never more than themselves.
    """
    coefficients = np.abs(legendre_coefficients(values))
    last = np.maximum(coefficients[:, -1], coefficients[:, -2])
    before = np.maximum(coefficients[:, -3], coefficients[:, -4])
    size = np.max(coefficients, axis=1)
    decay = np.divide(last, before, out=np.ones_like(last), where=before > 1e-15 * size)
    return last * np.minimum(decay, 1.0)


@lru_cache(maxsize=8)
def bernstein_matrix(count: int = NODES) -> np.ndarray:
    """(count, count) from node values to Bernstein coefficients on [0, 1]."""
    from math import comb

    c, _ = gauss_nodes(count)
    degree = count - 1
    basis = np.stack([comb(degree, k) * c**k * (1 - c) ** (degree - k) for k in range(count)], axis=1)
    return np.linalg.inv(basis)


@lru_cache(maxsize=8)
def halving_matrices(count: int = NODES) -> tuple[np.ndarray, np.ndarray]:
    """De Casteljau: Bernstein coefficients of the left and of the right half of [0, 1]."""
    from math import comb

    left = np.array([[comb(i, j) / 2.0**i if j <= i else 0.0 for j in range(count)] for i in range(count)])
    return left, left[::-1, ::-1].copy()

"""Compiled Cholesky arithmetic for matrices of a few rows, where a LAPACK call (and even an allocation) costs more
than the work.

Unknowns: the lower triangle L of S = L L'. Everything else (log-determinants, solves) follows from L.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy")
def cholesky(matrix: np.ndarray, factor: np.ndarray) -> None:
    """Lower triangular factor of a symmetric positive definite matrix, written into `factor`.

    S = L L'

    Parameters
    ----------
    matrix : (p, p) symmetric; only its lower triangle is read
    factor : (p, p) receives L in its lower triangle (the rest is left alone); NaN where S is not positive definite
    """
    for i in range(matrix.shape[0]):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= factor[i, k] * factor[j, k]
            if i > j:
                factor[i, j] = total / factor[j, j]
            else:
                factor[i, i] = math.sqrt(total) if total > 0.0 else np.nan


@njit(cache=True, error_model="numpy")
def log_determinant(factor: np.ndarray) -> float:
    """Log-determinant of S from its Cholesky factor.

    ln |S| = 2 sum_i ln L_ii

    Parameters
    ----------
    factor : (p, p) lower triangular
    """
    product = 1.0
    for i in range(factor.shape[0]):
        product *= factor[i, i]
    if 1e-300 < product < 1e300:
        return 2.0 * math.log(product)
    total = 0.0
    for i in range(factor.shape[0]):
        total += math.log(factor[i, i])
    return 2.0 * total


@njit(cache=True, error_model="numpy")
def whiten(factor: np.ndarray, vector: np.ndarray) -> float:
    """Solve L y = b by forward substitution in place, and return |y|^2 = b' S^-1 b.

    Parameters
    ----------
    factor : (p, p) lower triangular
    vector : (p,) b, becomes y
    """
    distance = 0.0
    for i in range(len(vector)):
        total = vector[i]
        for k in range(i):
            total -= factor[i, k] * vector[k]
        vector[i] = total / factor[i, i]
        distance += vector[i] * vector[i]
    return distance


@njit(cache=True, error_model="numpy")
def unwhiten(factor: np.ndarray, vector: np.ndarray) -> None:
    """Solve L' x = y by backward substitution in place.

    Parameters
    ----------
    factor : (p, p) lower triangular
    vector : (p,) y, becomes x
    """
    for i in range(len(vector) - 1, -1, -1):
        total = vector[i]
        for k in range(i + 1, len(vector)):
            total -= factor[k, i] * vector[k]
        vector[i] = total / factor[i, i]

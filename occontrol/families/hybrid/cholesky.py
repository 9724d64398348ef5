"""Compiled Cholesky arithmetic for matrices of a few rows, where a LAPACK call (and even an allocation) costs more
than the work.

Unknowns: the lower triangle L of S = L L'. Everything else (log-determinants, solves) follows from L.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy")
def cholesky(matrix: np.ndarray, factor: np.ndarray, size: int) -> None:
    """Lower triangular factor of a symmetric positive definite matrix, with the reciprocals of its diagonal.

    S = L L', factor_ij = L_ij below the diagonal, factor_ii = 1/L_ii

    Parameters
    ----------
    matrix : (p, p) or larger, symmetric; only the lower triangle of its leading block is read
    factor : (p, p) or larger, receives the factor in its lower triangle; NaN where S is not positive definite
    size : p
    """
    if size == 2:  # written out: most sensors report two values, and short loops cost more than their work
        first = 1.0 / math.sqrt(matrix[0, 0]) if matrix[0, 0] > 0.0 else np.nan
        below = matrix[1, 0] * first
        rest = matrix[1, 1] - below * below
        factor[0, 0] = first
        factor[1, 0] = below
        factor[1, 1] = 1.0 / math.sqrt(rest) if rest > 0.0 else np.nan
        return
    for i in range(size):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= factor[i, k] * factor[j, k]
            if i > j:
                factor[i, j] = total * factor[j, j]
            else:
                factor[i, i] = 1.0 / math.sqrt(total) if total > 0.0 else np.nan


@njit(cache=True, error_model="numpy")
def log_determinant(factor: np.ndarray, size: int) -> float:
    """Log-determinant of S from its Cholesky factor.

    ln |S| = 2 sum_i ln L_ii

    Parameters
    ----------
    factor : (p, p) of `cholesky`
    size : p
    """
    product = 1.0
    for i in range(size):
        product *= factor[i, i]
    if 1e-300 < product < 1e300:
        return -2.0 * math.log(product)
    total = 0.0
    for i in range(size):
        total += math.log(factor[i, i])
    return -2.0 * total


@njit(cache=True, error_model="numpy")
def whiten(factor: np.ndarray, vector: np.ndarray, size: int) -> float:
    """Solve L y = b by forward substitution in place, and return |y|^2 = b' S^-1 b.

    Parameters
    ----------
    factor : (p, p) of `cholesky`
    vector : (p,) b, becomes y
    size : p
    """
    if size == 2:
        vector[0] *= factor[0, 0]
        vector[1] = (vector[1] - factor[1, 0] * vector[0]) * factor[1, 1]
        return vector[0] * vector[0] + vector[1] * vector[1]
    distance = 0.0
    for i in range(size):
        total = vector[i]
        for k in range(i):
            total -= factor[i, k] * vector[k]
        vector[i] = total * factor[i, i]
        distance += vector[i] * vector[i]
    return distance

"""Compiled Cholesky arithmetic for matrices of a few rows, where a LAPACK call costs more than the work.

Unknowns: the lower triangle L of S = L L'. Everything else (log-determinants, solves) follows from L.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True)
def cholesky(matrix: np.ndarray) -> np.ndarray:
    """Lower triangular factor of a symmetric positive definite matrix.

    S = L L'

    Parameters
    ----------
    matrix : (p, p) symmetric; only its lower triangle is read

    Returns
    -------
    (p, p) L; NaN in every entry that cannot be computed because S is not positive definite.
    """
    size = matrix.shape[0]
    factor = np.zeros((size, size))
    for i in range(size):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= factor[i, k] * factor[j, k]
            if i > j:
                factor[i, j] = total / factor[j, j]
            else:
                factor[i, i] = math.sqrt(total) if total > 0.0 else np.nan
    return factor


@njit(cache=True)
def log_determinant(factor: np.ndarray) -> float:
    """Log-determinant of S from its Cholesky factor.

    ln |S| = 2 sum_i ln L_ii

    Parameters
    ----------
    factor : (p, p) lower triangular
    """
    total = 0.0
    for i in range(factor.shape[0]):
        total += math.log(factor[i, i])
    return 2.0 * total


@njit(cache=True)
def whiten(factor: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Solve L y = b by forward substitution, so that |y|^2 = b' S^-1 b.

    Parameters
    ----------
    factor : (p, p) lower triangular
    vector : (p,)
    """
    size = len(vector)
    result = np.empty(size)
    for i in range(size):
        total = vector[i]
        for k in range(i):
            total -= factor[i, k] * result[k]
        result[i] = total / factor[i, i]
    return result

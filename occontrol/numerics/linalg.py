"""Symmetric matrices: packing them in a triangle, making them symmetric, square roots.

Packed order: the lower triangle, column by column, (0,0), (1,0), .., (n-1,0), (1,1), ..; it is CasADi's own order.
The factor 2 of the off-diagonal entries lives in `triangle_weights` and nowhere else.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np


@lru_cache(maxsize=64)
def triangle_indices(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the n(n+1)/2 packed entries."""
    columns, rows = np.triu_indices(n)
    return rows, columns


@lru_cache(maxsize=64)
def triangle_weights(n: int) -> np.ndarray:
    """(n(n+1)/2,) 1 on the diagonal and 2 off it.

    tr(X Y) = sum_i weights_i vech(X)_i vech(Y)_i, so the derivative of a function of a symmetric X by its packed
    entries is `weights` times the packed (full-matrix) derivative.
    """
    rows, columns = triangle_indices(n)
    return np.where(rows == columns, 1.0, 2.0)


def vech(matrix: Any) -> Any:
    """Packed lower triangle of symmetric matrices.

    Parameters
    ----------
    matrix : (..., n, n) NumPy array, or an (n, n) CasADi matrix

    Returns
    -------
    (..., n(n+1)/2) array, or an (n(n+1)/2, 1) CasADi matrix
    """
    rows, columns = triangle_indices(matrix.shape[-1])
    if isinstance(matrix, np.ndarray):
        return matrix[..., rows, columns]
    import casadi

    return casadi.vertcat(*[matrix[int(i), int(j)] for i, j in zip(rows, columns, strict=True)])


def unvech(packed: Any) -> Any:
    """The symmetric matrix of a packed triangle; the inverse of `vech`.

    Parameters
    ----------
    packed : (..., n(n+1)/2) NumPy array, or an (n(n+1)/2, 1) CasADi matrix
    """
    size = packed.shape[-1] if isinstance(packed, np.ndarray) else packed.shape[0]
    n = round((np.sqrt(8 * size + 1) - 1) / 2)
    rows, columns = triangle_indices(n)
    if isinstance(packed, np.ndarray):
        full = np.empty((*packed.shape[:-1], n, n), dtype=packed.dtype)
        full[..., rows, columns] = packed
        full[..., columns, rows] = packed
        return full
    position = {(int(i), int(j)): k for k, (i, j) in enumerate(zip(rows, columns, strict=True))}
    import casadi

    rows_of = [[packed[position[max(i, j), min(i, j)]] for i in range(n)] for j in range(n)]
    return casadi.horzcat(*[casadi.vertcat(*column) for column in rows_of])


def symmetrise(matrix: np.ndarray) -> np.ndarray:
    """(X + X')/2 over the last two axes."""
    return (matrix + np.swapaxes(matrix, -1, -2)) / 2


def square_root(matrix: np.ndarray) -> np.ndarray:
    """X with X X' = matrix for symmetric positive semidefinite (..., n, n); negative eigenvalues count as zero.

    Diagonal entries that differ by many orders of magnitude (up to 1e14) are brought to one first.
    """
    diagonal = np.einsum("...ii->...i", matrix)
    floor = 1e-14 * np.max(diagonal, axis=-1, keepdims=True)
    scale = np.sqrt(np.maximum(diagonal, np.where(floor > 0, floor, 1.0)))
    values, vectors = np.linalg.eigh(symmetrise(matrix / scale[..., :, None] / scale[..., None, :]))
    return scale[..., :, None] * vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :]


def solve_lower(lower: np.ndarray, right: np.ndarray) -> np.ndarray:
    """lower^-1 right for a lower triangular, nonsingular (r, r) and right sides (r, k).

    By BLAS itself: LAPACK's driver wakes all threads for six rows, a thousand times the work on a busy machine.
    """
    from scipy.linalg.blas import dtrsm  # type: ignore[attr-defined]

    return dtrsm(1.0, lower.T, right, lower=0, trans_a=1) if right.size else np.zeros(right.shape)

"""Symmetric matrices: packing them in a triangle, making them symmetric, square roots, whitening, normalised errors.

Packed order: the lower triangle, column by column, (0,0), (1,0), .., (n-1,0), (1,1), ..; it is CasADi's own order.
The factor 2 of the off-diagonal entries lives in `triangle_weights` and nowhere else.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TypeVar

import numpy as np

from occontrol.core.kinds import Casadi

ArrayOrCasadi = TypeVar("ArrayOrCasadi", np.ndarray, Casadi)


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


def vech(matrix: ArrayOrCasadi) -> ArrayOrCasadi:
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


def unvech(packed: ArrayOrCasadi) -> ArrayOrCasadi:
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
    """(X + X')/2 over the last two axes; `matrix` is X (..., n, n)."""
    return (matrix + np.swapaxes(matrix, -1, -2)) / 2


def square_root(
    matrix: np.ndarray, *, scaled: bool = True, floor: float = 1e-14, cut: float = 0.0, symmetric: bool = False
) -> np.ndarray:
    """S with S S' = matrix for symmetric positive semidefinite matrices; negative eigenvalues count as zero.

    matrix = D (V Lambda V') D,   S = D V Lambda^{1/2}   (times V' when `symmetric`)

    Parameters
    ----------
    matrix : (..., n, n)
    scaled : whether the states are brought to unit variance first (D); variances of very different units then keep
        their digits. Without it D = 1
    floor : diagonal entries below this share of the largest are rounding, and are scaled as if they were that large
    cut : eigenvalues up to this one count as zero
    symmetric : whether the root is to be the symmetric one of the scaled matrix, which does not depend on the choice
        of eigenvectors

    Returns (..., n, n).
    """
    if not scaled:
        return _root_of(symmetrise(matrix), cut, symmetric)
    diagonal = np.maximum(np.einsum("...ii->...i", matrix), 0.0)
    least = floor * np.max(diagonal, axis=-1, keepdims=True, initial=0.0)
    scale = np.sqrt(np.maximum(diagonal, least))
    scale = np.where(scale > 0, scale, 1.0)
    unit = matrix / scale[..., :, None] / scale[..., None, :]
    return scale[..., :, None] * _root_of(symmetrise(unit), cut, symmetric)


def _root_of(matrix: np.ndarray, cut: float, symmetric: bool) -> np.ndarray:
    values, vectors = np.linalg.eigh(matrix)
    root = vectors * np.sqrt(np.where(values > cut, values, 0.0))[..., None, :]
    return root @ np.swapaxes(vectors, -1, -2) if symmetric else root


def whiten(noise: np.ndarray, *arrays: np.ndarray) -> list[np.ndarray]:
    """R^{-1/2} times each array, R^{-1/2} being the inverse Cholesky factor: X with X'X = R^-1.

    Parameters
    ----------
    noise : (..., m, m) R, symmetric positive definite; LinAlgError otherwise
    arrays : (..., m, k) each, or (m,) vectors for a single R
    """
    factor = np.linalg.cholesky(noise)
    return [np.linalg.solve(factor, array) for array in arrays]


def normalised_square(error: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """e' P^-1 e as the square of a whitened error, so that rounding never makes it negative: NIS and NEES.

    Parameters
    ----------
    error : (..., n)
    covariance : (..., n, n) symmetric positive definite; LinAlgError otherwise

    Returns (...).
    """
    (white,) = whiten(covariance, np.asarray(error)[..., None])
    return np.sum(white[..., 0] ** 2, axis=-1)


def whitener(covariance: np.ndarray, rank: float = 1e-12) -> np.ndarray:
    """V (n, r) with V V' the pseudo-inverse of a positive semidefinite P, formed in units of the standard deviations.

    Parameters
    ----------
    covariance : (n, n) P, of rank r
    rank : eigenvalues of the correlation matrix below this share of the largest count as zero
    """
    scale = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    kept = np.flatnonzero(scale > 0)
    if not len(kept):
        return np.zeros((len(covariance), 0))
    values, vectors = np.linalg.eigh(covariance[np.ix_(kept, kept)] / np.outer(scale[kept], scale[kept]))
    good = values > rank * max(values[-1], 0.0)
    white = np.zeros((len(covariance), int(np.sum(good))))
    white[kept] = vectors[:, good] / np.sqrt(values[good]) / scale[kept, None]
    return white


def solve_lower(lower: np.ndarray, right: np.ndarray) -> np.ndarray:
    """lower^-1 right for a lower triangular, nonsingular (r, r) and right sides (r, k).

    By BLAS itself: LAPACK's driver wakes all threads for six rows, a thousand times the work on a busy machine.
    """
    from scipy.linalg.blas import dtrsm  # type: ignore[attr-defined]

    return dtrsm(1.0, lower.T, right, lower=0, trans_a=1) if right.size else np.zeros(right.shape)

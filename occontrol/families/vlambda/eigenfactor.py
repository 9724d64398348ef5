"""The V-Lambda filter's updates in information form: spectral factors in, spectral factors out.

Unknowns, in this order: the error covariance P = V Lambda V' through its eigenvectors V (columns) and the deviations
Lambda^{1/2} along them, largest first; then the mean. A covariance is never formed, so it cannot lose symmetry or
definiteness. Oshman (1994), equations (3)-(14); the corrected sign of the (2,1) block of (10) is used.
Rows of very different size (a prior of 1e16 beside a sensor of 0.1) go to the Jacobi SVD, which keeps the relative
accuracy of small singular values; the ordinary SVD keeps only the absolute one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import scipy.linalg

lapack: Any = scipy.linalg.lapack  # the compiled routines: no wrapper's overhead at n = 3
EPS = float(np.finfo(float).eps)
GRADED = 1e4  # from this ratio of singular values on, relative accuracy is worth the slower SVD


@dataclass(frozen=True, eq=False)
class Eigenfactors:
    """Spectral factors of an error covariance.

    P = V diag(deviations^2) V'

    Parameters
    ----------
    vectors : (n, n) V, orthonormal columns
    deviations : (n,) square roots of the eigenvalues, descending, >= 0
    """

    vectors: np.ndarray
    deviations: np.ndarray

    @property
    def eigenvalues(self) -> np.ndarray:
        """(n,) eigenvalues of P, descending."""
        return self.deviations**2

    @property
    def root(self) -> np.ndarray:
        """(n, n) S = V Lambda^{1/2}, so that P = S S'."""
        return self.vectors * self.deviations

    @property
    def covariance(self) -> np.ndarray:
        """(n, n) P, symmetric by construction."""
        return self.root @ self.root.T

    @property
    def standard_deviations(self) -> np.ndarray:
        """(n,) square roots of the diagonal of P."""
        return np.sqrt(np.einsum("ij,ij->i", self.root, self.root))

    @property
    def invertible(self) -> bool:
        """Whether the information form exists: every deviation is above 0."""
        return bool(self.deviations[-1] > 0.0)


def eigenfactors_of(covariance: np.ndarray) -> Eigenfactors:
    """Spectral factors of a positive semidefinite `covariance` (n, n); rounding below 0 counts as 0."""
    values, vectors = np.linalg.eigh((covariance + covariance.T) / 2)
    return Eigenfactors(vectors[:, ::-1].copy(), np.sqrt(np.clip(values[::-1], 0.0, None)))


def thin_svd(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Left vectors (r, n), singular values (n,) descending, right vectors (n, n) of a
    `matrix` (r, n), r >= n.

    Singular values have high relative accuracy when rows or columns of `matrix` differ widely in size.
    Raises LinAlgError when LAPACK does not converge (only non-finite entries do that).
    """
    left, values, right, info = lapack.dgesdd(matrix, full_matrices=0)
    if info == 0 and values[-1] * GRADED >= values[0]:
        return left, values, right.T
    if not np.all(np.isfinite(matrix)):
        raise np.linalg.LinAlgError("the matrix to be decomposed is not finite")
    # joba = 2: rows are sorted and pivoted before the one-sided Jacobi sweeps (LAPACK's 'F')
    accurate, jacobi_left, jacobi_right, work, _, failed = lapack.dgejsv(
        np.asfortranarray(matrix), joba=2, jobu=0, jobv=0, jobr=0, jobt=0, jobp=0
    )
    if failed == 0 and np.all(np.isfinite(accurate)):
        return jacobi_left[:, : len(accurate)], accurate * (work[0] / work[1]), jacobi_right
    if info:
        raise np.linalg.LinAlgError("the singular value decomposition did not converge")
    return left, values, right.T


@lru_cache(maxsize=16)
def _upper(n: int) -> np.ndarray:
    """(n, n) ones on and above the diagonal: faster than numpy.triu for small n."""
    return np.triu(np.ones((n, n)))


def measurement_update(
    factors: Eigenfactors, mean: np.ndarray, rows: np.ndarray, values: np.ndarray | None = None
) -> tuple[Eigenfactors, np.ndarray, float]:
    """Take one whitened measurement into the eigenfactors and the mean.

    [Lambda^{-1/2} V'; R^{-1/2} H] = Y [Sigma; 0] U',   V+ = U,   Lambda+^{-1/2} = Sigma,
    Y' [Lambda^{-1/2} V' x; R^{-1/2} y] = [Sigma U' x+; e]

    Parameters
    ----------
    factors : Eigenfactors of P(k|k-1), invertible
    mean : (n,) x(k|k-1)
    rows : (m, n) R^{-1/2} H
    values : (m,) R^{-1/2} y, or None when only the covariance is wanted

    Returns
    -------
    Eigenfactors of P(k|k), the mean (n,), and |e|^2: the normalised innovation squared (NaN without values).

    Only |e| has a meaning (it equals nu' S^-1 nu); the basis of e is arbitrary. Oshman (1994), equations (4)-(9).
    """
    prior = (factors.vectors / factors.deviations).T
    left, information, right = thin_svd(np.concatenate((prior, rows)))
    updated = Eigenfactors(right[:, ::-1], 1.0 / information[::-1])
    if values is None:
        return updated, mean, float("nan")
    stacked = np.concatenate((prior @ mean, values))
    normalised = left.T @ stacked
    residual = stacked - left @ normalised
    return updated, right @ (normalised / information), float(residual @ residual)


@dataclass(frozen=True)
class Propagation:
    """How a time update went: `loss` is the estimated relative error of the information form (1 = nothing left)."""

    factors: Eigenfactors | None
    loss: float


def time_update(factors: Eigenfactors, transition: np.ndarray, noise_root: np.ndarray) -> Propagation:
    """Propagate the eigenfactors in information form.

    tau [I, 0; -X Gamma, X] = [M, L; 0, N],   N = W S Z',   V = Z,   Lambda^{-1/2} = S,
    X = Lambda^{-1/2} V' F^-1,   Gamma = G Q^{1/2}

    Parameters
    ----------
    factors : Eigenfactors of P(k|k), invertible
    transition : (n, n) F, nonsingular
    noise_root : (n, p) Gamma = G Q^{1/2}; with it Q may be singular, and (10)'s Q^{-1/2} is not needed

    Returns
    -------
    Propagation with the factors of P(k+1|k) (None where F cannot be inverted) and the estimated loss:
    eps times the larger of cond F and |X|/|N|, the cancellation between plant noise and a contracting F.

    Oshman (1994), equations (10)-(13), columns of the first block scaled by Q^{1/2}.
    """
    n, p = noise_root.shape
    lu, _, solved, info = lapack.dgesv(transition.T, factors.vectors)
    if info:
        return Propagation(None, 1.0)
    reciprocal, _ = lapack.dgecon(lu, lapack.dlange("1", transition.T))
    if reciprocal <= EPS:
        return Propagation(None, 1.0)
    carried = (solved / factors.deviations).T
    array = np.zeros((n + p, n + p), order="F")
    array.T.flat[: p * (n + p) : n + p + 1] = 1.0  # the first p diagonal entries
    array[p:, :p] = -(carried @ noise_root)
    array[p:, p:] = carried
    if factors.deviations[0] > GRADED * factors.deviations[-1]:
        # large rows first: Householder QR then keeps the small rows' relative accuracy
        array = np.asfortranarray(array[np.argsort(-np.abs(array).max(axis=1), kind="stable")])
    size = lapack.dlange("F", carried)
    triangle = lapack.dgeqrf(array, overwrite_a=1)[0][p:, p:] * _upper(n)
    _, information, right = thin_svd(triangle)
    growth = size / math.sqrt(information @ information)
    loss = EPS * max(growth, 1.0 / reciprocal)
    if not information[-1] > 0.0:
        return Propagation(None, 1.0)
    return Propagation(Eigenfactors(right[:, ::-1], 1.0 / information[::-1]), min(loss, 1.0))

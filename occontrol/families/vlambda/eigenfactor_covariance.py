"""The V-Lambda filter's updates in covariance form, for steps where the information form has nothing to stand on.

Unknowns as in eigenfactor.py. Eigenfactors change form for free: V is the same and Lambda^{-1/2} is 1/Lambda^{1/2}, so
a single step may use the other form. These updates need neither F^-1 nor P^-1; they lose digits of small eigenvalues
where the prior is huge, which is where the information form is exact.
"""

from __future__ import annotations

import numpy as np

from occontrol.families.vlambda.eigenfactor import EPS, Eigenfactors, Propagation, lapack, thin_svd


def factors_of_root(root: np.ndarray) -> Eigenfactors:
    """Eigenfactors of S S' from a root S (n, r), r >= n; deviations at rounding level count as 0."""
    _, deviations, vectors = thin_svd(np.asfortranarray(root.T))
    floor = len(deviations) * EPS * deviations[0]
    return Eigenfactors(vectors, np.where(deviations > floor, deviations, 0.0))


def time_update_covariance(factors: Eigenfactors, transition: np.ndarray, noise_root: np.ndarray) -> Propagation:
    """Propagate the eigenfactors through any F, singular or not.

    [F V Lambda^{1/2}, G Q^{1/2}]' = W S Z',   V = Z,   Lambda^{1/2} = S

    Parameters
    ----------
    factors : Eigenfactors of P(k|k)
    transition : (n, n) F
    noise_root : (n, p) G Q^{1/2}

    Returns
    -------
    Propagation; its loss is eps times the ratio of the largest to the smallest deviation (1 when P is singular).
    """
    updated = factors_of_root(np.concatenate((transition @ factors.root, noise_root), axis=1))
    largest, smallest = updated.deviations[0], updated.deviations[-1]
    return Propagation(updated, min(EPS * largest / smallest, 1.0) if smallest > 0 else 1.0)


def measurement_update_covariance(
    factors: Eigenfactors, mean: np.ndarray, rows: np.ndarray, values: np.ndarray | None = None
) -> tuple[Eigenfactors, np.ndarray, float]:
    """Take one whitened measurement into eigenfactors that may be singular.

    [I, C S; 0, S]' is triangularised to [D, 0; K D, S+]' with C = R^{-1/2} H, S = V Lambda^{1/2}, D D' = I + C P C'

    Parameters
    ----------
    factors : Eigenfactors of P(k|k-1), deviations may be 0
    mean : (n,) x(k|k-1)
    rows : (m, n) R^{-1/2} H
    values : (m,) R^{-1/2} y, or None when only the covariance is wanted

    Returns
    -------
    Eigenfactors of P(k|k), the mean (n,), and the normalised innovation squared (NaN without values).

    The array form of the covariance update (Kailath, Sayed & Hassibi, Linear Estimation, section 12.3).
    """
    m, n = rows.shape
    root = factors.root
    array = np.zeros((m + n, m + n), order="F")
    array[:m, :m] = np.eye(m)
    array[m:, :m] = (rows @ root).T
    array[m:, m:] = root.T
    triangle = np.triu(lapack.dgeqrf(array, overwrite_a=1)[0])
    updated = factors_of_root(triangle[m:, m:].T)
    if values is None:
        return updated, mean, float("nan")
    innovation = np.linalg.solve(triangle[:m, :m].T, values - rows @ mean)
    return updated, mean + triangle[:m, m:].T @ innovation, float(innovation @ innovation)

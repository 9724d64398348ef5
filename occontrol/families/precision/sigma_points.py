"""Sigma points of the unscented transform and the moments that belong to them.

Unknowns: n_a, the size of the augmented state (state, then noise). The printed covariance (B_k = L L' with
L = diag(W^c) - W^c 1') is not the unscented one. The right form, I - W^m 1' on both sides of diag(W^c), is rewritten
so that nothing large is subtracted: with a_i = Y_i - Y_0 and d = sum_i w_i a_i (i from 1),

    mean = Y_0 + d,     covariance = sum_i w_i a_i a_i' + (beta - alpha^2) d d'

which is positive semidefinite for beta >= alpha^2 also when w_0 is a large negative number.
"""

from __future__ import annotations

import numpy as np

from occontrol.numerics.linalg import square_root as semidefinite_root


def spread(size: int, alpha: float, kappa: float) -> float:
    """n_a + rho = alpha^2 (n_a + kappa), the square of the distance of the points in standard deviations."""
    return alpha**2 * (size + kappa)


def weights(size: int, alpha: float, beta: float, kappa: float) -> tuple[np.ndarray, np.ndarray]:
    """Weights (2 n_a + 1,) of mean and covariance, as Das & Bhattacharya, section 3.3, define them.

    w_0^m = rho/(n_a + rho),  w_0^c = w_0^m + 1 - alpha^2 + beta,  w_i = 1/(2 (n_a + rho))
    """
    total = spread(size, alpha, kappa)
    mean = np.full(2 * size + 1, 0.5 / total)
    mean[0] = 1 - size / total
    covariance = mean.copy()
    covariance[0] += 1 - alpha**2 + beta
    return mean, covariance


def square_root(covariance: np.ndarray) -> np.ndarray:
    """A root A (n, n) with A A' = `covariance` (n, n): Cholesky's, or for a singular matrix the scaled symmetric one.

    The scaling to unit diagonal keeps variances of 1e-16 beside those of 1e2.
    """
    try:
        return np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        return semidefinite_root(covariance, floor=0.0, cut=1e-14 * len(covariance), symmetric=True)


def noise_root(covariance: np.ndarray) -> np.ndarray:
    """A root (n, n_w) with as many columns as there are independent noises: the rank of the covariance (n, n)."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    safe = np.where(scale > 0, scale, 1.0)
    values, vectors = np.linalg.eigh(covariance / safe / safe[:, None])
    keep = values > 1e-14 * len(values)
    return scale[:, None] * vectors[:, keep] * np.sqrt(values[keep])


def sigma_points(mean: np.ndarray, covariance: np.ndarray, alpha: float, kappa: float) -> np.ndarray:
    """Points (n_a, 2 n_a + 1): the mean, then the mean plus and minus the columns of a root of the covariance.

    X_i = mu +- (sqrt((n_a + rho) Sigma))_i, columns of `square_root`, which does not mind the units of the states.
    Das & Bhattacharya, section 3.3 (their index i - nq is i - n_a).

    `mean` (n_a,), `covariance` Sigma (n_a, n_a).
    """
    root = square_root(covariance) * np.sqrt(spread(len(mean), alpha, kappa))
    return np.hstack([mean[:, None], mean[:, None] + root, mean[:, None] - root])


def mean_and_anomalies(points: np.ndarray, alpha: float, beta: float, kappa: float) -> tuple[np.ndarray, np.ndarray]:
    """Mean (k,) and anomalies (k, 2 n_a + 1) with covariance = anomalies anomalies', of points (k, 2 n_a + 1).

    The header's second form. Needs beta >= alpha^2.
    """
    size = (points.shape[1] - 1) // 2
    weight = 0.5 / spread(size, alpha, kappa)
    away = points[:, 1:] - points[:, :1]
    # opposite points first: their sum is of second order in alpha and would drown otherwise
    shift = weight * np.sum(away[:, :size] + away[:, size:], axis=1)
    extra = np.sqrt(beta - alpha**2) * shift
    return points[:, 0] + shift, np.hstack([np.sqrt(weight) * away, extra[:, None]])


def moments(points: np.ndarray, alpha: float, beta: float, kappa: float) -> tuple[np.ndarray, np.ndarray]:
    """Mean (k,) and covariance (k, k) of points (k, 2 n_a + 1) by the weights themselves, for any beta.

    (I - W^m 1') diag(W^c) (I - W^m 1')', the corrected form of the printed B_k.
    """
    by_mean, by_covariance = weights((points.shape[1] - 1) // 2, alpha, beta, kappa)
    mean = points @ by_mean
    away = points - mean[:, None]
    return mean, (away * by_covariance) @ away.T

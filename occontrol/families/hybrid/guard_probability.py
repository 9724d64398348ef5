"""Transition probabilities of a plant whose mode depends on its state (Liu & Hwang, equations (3), (4), step 1).

A guard leads from one mode to another where L [x; theta] + b <= 0, theta ~ N(mean, covariance). Guards are kept as
arrays: source, target, rows (guards,), L (guards, most rows, n + l), b (guards, most rows). A mode without a guard
of its own onto itself stays with what the others leave.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from occontrol.families.hybrid.normal_orthant import orthant_probability


@njit(cache=True, error_model="numpy")
def guard_probability(
    L: np.ndarray,
    b: np.ndarray,
    mean: np.ndarray,
    covariance: np.ndarray,
    threshold_mean: np.ndarray,
    threshold_covariance: np.ndarray,
    tolerance: float,
) -> tuple[float, float]:
    """Probability that a state estimate and the random threshold satisfy a guard.

    Phi_v(L [x; theta] + b, L blkdiag(P, Sigma_theta) L')

    Parameters
    ----------
    L : (v, n + l)
    b : (v,)
    mean, covariance : (n,), (n, n) of the state
    threshold_mean, threshold_covariance : (l,), (l, l); l = 0 where nothing in the guards is random
    tolerance : see `orthant_probability`

    Returns
    -------
    probability, error estimate. Liu & Hwang, step 1; the printed theta is its mean.
    """
    rows, states, extra = len(b), len(mean), len(threshold_mean)
    centre = b.copy()
    spread = np.zeros((rows, rows))
    product = np.zeros((rows, states + extra))
    for i in range(rows):
        for c in range(states):
            centre[i] += L[i, c] * mean[c]
            if L[i, c] != 0.0:
                for d in range(states):
                    product[i, d] += L[i, c] * covariance[c, d]
        for c in range(extra):
            centre[i] += L[i, states + c] * threshold_mean[c]
            for d in range(extra):
                product[i, states + d] += L[i, states + c] * threshold_covariance[c, d]
    for i in range(rows):
        for j in range(i + 1):
            total = 0.0
            for c in range(states + extra):
                total += product[i, c] * L[j, c]
            spread[i, j] = total
            spread[j, i] = total
    return orthant_probability(centre, spread, tolerance)


@njit(cache=True, error_model="numpy")
def guard_transitions(
    means: np.ndarray,
    covariances: np.ndarray,
    source: np.ndarray,
    target: np.ndarray,
    rows: np.ndarray,
    L: np.ndarray,
    b: np.ndarray,
    threshold_mean: np.ndarray,
    threshold_covariance: np.ndarray,
    tolerance: float,
) -> tuple[np.ndarray, float, float]:
    """Transition matrix that the guards imply for one estimate per mode.

    Gamma_ij = Pr{(x, theta) in G(i, j)} with x ~ N(x_i, P_i), rows divided by their sum

    Parameters
    ----------
    means, covariances : (modes, n), (modes, n, n)
    source, target, rows : (guards,) integers: from which mode, to which, and how many rows; see the head of this file
    L, b : (guards, v, n + l), (guards, v), padded to the v rows of the longest guard
    threshold_mean, threshold_covariance : (l,), (l, l)
    tolerance : see `guard_probability`

    Returns
    -------
    matrix : (modes, modes), rows sum to 1
    excess : the largest |sum - 1| of a row before it was divided (guards that overlap, or leave a gap)
    error : the largest error estimate of a probability
    """
    modes = len(means)
    matrix = np.zeros((modes, modes))
    complete = np.zeros(modes, np.bool_)
    excess, error = 0.0, 0.0
    for g in range(len(source)):
        i, v = source[g], rows[g]
        probability, off = guard_probability(
            L[g, :v], b[g, :v], means[i], covariances[i], threshold_mean, threshold_covariance, tolerance
        )
        matrix[i, target[g]] += probability
        error = max(error, off)
        if target[g] == i:
            complete[i] = True
    for i in range(modes):
        total = 0.0
        for j in range(modes):
            total += matrix[i, j]
        if not complete[i] and total < 1.0:
            matrix[i, i] = 1.0 - total
            continue
        excess = max(excess, abs(total - 1.0))
        if total <= 0.0:
            matrix[i, i] = 1.0
            continue
        for j in range(modes):
            matrix[i, j] /= total
    return matrix, excess, error

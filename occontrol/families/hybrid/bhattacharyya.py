"""Bhattacharyya bound on the probability of naming the wrong mode (Liu & Hwang, equations (12), (13), corrected).

The printed exponent has |Sigma_i + Sigma_j|/2; with |(Sigma_i + Sigma_j)/2| it is a bound for any number of rows.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from occontrol.families.hybrid import equations_in_place as in_place


@njit(cache=True, error_model="numpy")
def error_bound(log_priors: np.ndarray, means: np.ndarray, covariances: np.ndarray) -> float:
    """Upper bound on the risk of a Bayes decision among Gaussian hypotheses.

    Pr{error} <= sum_{i<j} sqrt(c_i c_j) exp(-k_ij),
    k_ij = (r_j - r_i)' (S_i + S_j)^-1 (r_j - r_i)/4 + ln |(S_i + S_j)/2| / 2 - ln(|S_i| |S_j|)/4

    Parameters
    ----------
    log_priors : (modes,) ln c_j of the hypotheses; -inf is allowed
    means : (modes, p) r_j of the measurement under hypothesis j
    covariances : (modes, p, p) S_j, positive definite

    Returns
    -------
    float >= 0; with two hypotheses at most 1/2, with more it may exceed 1. NaN when an S_j is not positive definite.

    Two hypotheses that coincide with equal priors reach the risk, 1/2; the bound of far ones tends to 0.
    Liu & Hwang, equations (12), (13).
    """
    modes, rows = means.shape
    scratch = np.empty(modes), np.empty((rows, rows)), np.empty(rows)
    return in_place.error_bound(log_priors, means, covariances, rows, *scratch)

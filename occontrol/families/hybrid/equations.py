"""Interacting-multiple-model equations of a plant whose mode jumps (Liu & Hwang, steps 1, 2, 4, 5 and 6).

Unknowns of a step, mode first: means (modes, n), roots S (modes, n, n) of the covariances P = S S', log-probabilities
(modes,). No filter goes on from a covariance: it is formed for who reads it, and cannot lose definiteness.
A mode may be so unlikely that its probability is no double: everything about probabilities stays in logarithms.
Corrected against print: the mode prior in (12)/(13) is c_j; step 3 has C F W F' C'; the innovation of (18) is z - r;
the mode probabilities weight P_j too in step 6, whose spread is about x^(k+1).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from occontrol.families.hybrid import equations_in_place as in_place


@njit(cache=True, error_model="numpy")
def predict_modes(log_probabilities: np.ndarray, transition_matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Predicted mode probabilities and mixing weights (step 1).

    c_j = sum_i alpha_i Gamma_ij,    mu_ji = alpha_i Gamma_ij / c_j

    Parameters
    ----------
    log_probabilities : (modes,) ln alpha_i after the last measurement; -inf is allowed
    transition_matrix : (modes, modes) Gamma, probability of going from i (row) to j (column)

    Returns
    -------
    log_predicted : (modes,) ln c_j
    mixing : (modes, modes) mu_ji, row j sums to 1; where c_j = 0 the row is alpha, which keeps the estimate finite

    Liu & Hwang, equations (14), (15).
    """
    modes = len(log_probabilities)
    log_predicted, mixing = np.empty(modes), np.empty((modes, modes))
    in_place.predict_modes(log_probabilities, transition_matrix, log_predicted, mixing)
    return log_predicted, mixing


@njit(cache=True, error_model="numpy")
def match_moments(weights: np.ndarray, means: np.ndarray, covariances: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of mixtures of the same Gaussians with several sets of weights.

    x_j = sum_i w_ji x_i,    P_j = sum_i w_ji [P_i + (x_i - x_j)(x_i - x_j)']

    Parameters
    ----------
    weights : (sets, modes) every row sums to 1
    means : (modes, n)
    covariances : (modes, n, n)

    Returns
    -------
    means (sets, n), covariances (sets, n, n), exactly symmetric.

    Liu & Hwang, equations (16), (17) with the mixing weights, step 6 (corrected) with the mode probabilities.
    """
    sets, states = len(weights), means.shape[1]
    mean, covariance = np.empty((sets, states)), np.empty((sets, states, states))
    in_place.match_moments(weights, means, covariances, mean, covariance)
    return mean, covariance


@njit(cache=True, error_model="numpy")
def form_covariances(roots: np.ndarray) -> np.ndarray:
    """P_j = S_j S_j' (modes, n, n), exactly symmetric.

    Parameters
    ----------
    roots : (modes, n, n) S_j
    """
    covariances = np.empty(roots.shape)
    in_place.form_covariances(roots, covariances)
    return covariances


@njit(cache=True, error_model="numpy")
def predict(
    mixing: np.ndarray,
    means: np.ndarray,
    roots: np.ndarray,
    A: np.ndarray,
    noise_roots: np.ndarray,
    drift: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Every mode's mixed initial condition, predicted over one step.

    x_j = sum_i mu_ji x_i,    x_j- = A_j x_j + B_j u
    P_j- = A_j sum_i mu_ji [P_i + (x_i - x_j)(x_i - x_j)'] A_j' + F_j W_j F_j'
    [A_j [.. mu_ji^{1/2} S_i, mu_ji^{1/2} (x_i - x_j) ..], G_j] Theta = [S_j-, 0]

    Parameters
    ----------
    mixing : (modes, modes) mu_ji, row j sums to 1
    means, roots : (modes, n), (modes, n, n) S_i with P_i = S_i S_i'
    A : (modes, n, n)
    noise_roots : (modes, n, q) G with G G' = F W F'
    drift : (modes, n) B u(k+1)

    Returns
    -------
    means (modes, n), roots (modes, n, n), lower triangles. Liu & Hwang, equations (16), (17) and step 3, by roots.
    """
    modes, states = means.shape
    predicted, result, mixed = np.empty_like(means), np.empty((modes, states, states)), np.empty(states)
    array = np.empty((states, modes * (states + 1) + noise_roots.shape[2]))
    in_place.predict_roots(mixing, means, roots, A, noise_roots, drift, predicted, result, mixed, array)
    return predicted, result


@njit(cache=True, error_model="numpy")
def predict_measurement(
    means: np.ndarray, covariances: np.ndarray, C: np.ndarray, R: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What a sensor would read under every mode.

    r_j = C x_j-,    S_j = C P_j- C' + R

    Parameters
    ----------
    means, covariances : (modes, n), (modes, n, n) predicted to the time of the measurement
    C, R : (p, n), (p, p)

    Returns
    -------
    r (modes, p), S (modes, p, p) symmetric, cross (modes, n, p) = P- C'. Liu & Hwang, step 3.
    """
    modes, states = means.shape
    rows = len(C)
    expected, spread = np.empty((modes, rows)), np.empty((modes, rows, rows))
    cross = np.empty((modes, states, rows))
    in_place.predict_measurement(means, covariances, C, R, rows, expected, spread, cross)
    return expected, spread, cross


@njit(cache=True, error_model="numpy")
def correct(
    means: np.ndarray, roots: np.ndarray, C: np.ndarray, R_root: np.ndarray, values: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Every mode's measurement update in square-root form, and the log-likelihoods of the measurement.

    [C S, V; S, 0] Theta = [D, 0; K D, S+],    x = x- + K (z - C x-),    ln N(z - r; 0, D D')

    Parameters
    ----------
    means, roots : (modes, n), (modes, n, n) S with P- = S S', predicted to the time of the measurement
    C, R_root : (p, n), (p, p) V with R = V V'
    values : (p,) z

    Returns
    -------
    means (modes, n), roots (modes, n, n) of P, no triangles, log_likelihoods (modes,).

    Liu & Hwang, step 4 and equation (18), whose innovation is z - r.
    """
    modes, states = means.shape
    rows = len(C)
    updated, result, log_likelihoods = np.empty_like(means), np.empty((modes, states, states)), np.empty(modes)
    white, buffer = np.empty(rows), np.empty((rows + states) ** 2)
    in_place.correct(means, roots, C, R_root, rows, values, updated, result, log_likelihoods, white, buffer)
    return updated, result, log_likelihoods


@njit(cache=True, error_model="numpy")
def weigh_modes(log_predicted: np.ndarray, log_likelihoods: np.ndarray) -> np.ndarray:
    """Log-probabilities of the modes after a measurement.

    ln alpha_j = ln Lambda_j + ln c_j - ln sum_i Lambda_i c_i

    Parameters
    ----------
    log_predicted : (modes,) ln c_j
    log_likelihoods : (modes,) ln Lambda_j

    Returns
    -------
    (modes,) ln alpha_j; the exponentials sum to 1, and none is lost to underflow. Liu & Hwang, equations (19), (20).
    """
    log_probabilities = np.empty(len(log_predicted))
    in_place.weigh_modes(log_predicted, log_likelihoods, log_probabilities)
    return log_probabilities

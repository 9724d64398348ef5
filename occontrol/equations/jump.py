"""Interacting-multiple-model equations of a plant whose mode jumps (Liu & Hwang, steps 1, 2, 4, 5 and 6).

Unknowns of a step, mode first: means (modes, n), covariances (modes, n, n), log-probabilities (modes,).
A mode may be so unlikely that its probability is no double: everything about probabilities stays in logarithms.
Corrected against print: the mode prior in (12)/(13) is c_j; step 3 has C F W F' C'; the innovation of (18) is z - r; the
mode probabilities weight P_j too in step 6, whose spread is about x^(k+1).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from occontrol.numerics.small import cholesky, log_determinant, unwhiten, whiten

LOG_TWO_PI = math.log(2.0 * math.pi)


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
    log_predicted = np.empty(modes)
    mixing = np.empty((modes, modes))
    for j in range(modes):
        largest = -np.inf
        for i in range(modes):
            share = transition_matrix[i, j]
            mixing[j, i] = log_probabilities[i] + math.log(share) if share > 0.0 else -np.inf
            largest = max(largest, mixing[j, i])
        if largest == -np.inf:
            log_predicted[j] = -np.inf
            for i in range(modes):
                mixing[j, i] = math.exp(log_probabilities[i])
            continue
        total = 0.0
        for i in range(modes):
            mixing[j, i] = math.exp(mixing[j, i] - largest)
            total += mixing[j, i]
        for i in range(modes):
            mixing[j, i] /= total
        log_predicted[j] = largest + math.log(total)
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
    sets, modes = weights.shape
    states = means.shape[1]
    mean = np.zeros((sets, states))
    covariance = np.zeros((sets, states, states))
    apart = np.empty(states)
    for j in range(sets):
        for i in range(modes):
            for a in range(states):
                mean[j, a] += weights[j, i] * means[i, a]
        for i in range(modes):
            weight = weights[j, i]
            if weight == 0.0:
                continue
            for a in range(states):
                apart[a] = means[i, a] - mean[j, a]
            for a in range(states):
                for b in range(a + 1):
                    covariance[j, a, b] += weight * (covariances[i, a, b] + apart[a] * apart[b])
        for a in range(states):
            for b in range(a):
                covariance[j, b, a] = covariance[j, a, b]
    return mean, covariance


@njit(cache=True, error_model="numpy")
def propagate(
    means: np.ndarray, covariances: np.ndarray, A: np.ndarray, noise: np.ndarray, drift: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Every mode's prediction over one step.

    x_j- = A_j x_j + B_j u,    P_j- = A_j P_j A_j' + F_j W_j F_j'

    Parameters
    ----------
    means, covariances : (modes, n), (modes, n, n) the modes' mixed initial conditions
    A : (modes, n, n)
    noise : (modes, n, n) F W F'
    drift : (modes, n) B u(k+1)

    Returns
    -------
    means (modes, n), covariances (modes, n, n), exactly symmetric. Liu & Hwang, step 3.
    """
    modes, states = means.shape
    predicted = drift.copy()
    result = np.empty((modes, states, states))
    product = np.empty(states)
    for j in range(modes):
        for a in range(states):
            for b in range(states):
                product[b] = 0.0
            for c in range(states):
                entry = A[j, a, c]
                if entry != 0.0:
                    predicted[j, a] += entry * means[j, c]
                    for b in range(states):
                        product[b] += entry * covariances[j, c, b]
            for b in range(a + 1):
                total = noise[j, a, b]
                for c in range(states):
                    total += product[c] * A[j, b, c]
                result[j, a, b] = total
                result[j, b, a] = total
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
    expected = np.zeros((modes, rows))
    cross = np.zeros((modes, states, rows))
    spread = np.empty((modes, rows, rows))
    for j in range(modes):
        for a in range(rows):
            for c in range(states):
                entry = C[a, c]
                if entry != 0.0:
                    expected[j, a] += entry * means[j, c]
                    for b in range(states):
                        cross[j, b, a] += entry * covariances[j, c, b]
        for a in range(rows):
            for b in range(a + 1):
                total = R[a, b]
                for c in range(states):
                    total += cross[j, c, a] * C[b, c]
                spread[j, a, b] = total
                spread[j, b, a] = total
    return expected, spread, cross


@njit(cache=True, error_model="numpy")
def correct(
    means: np.ndarray, covariances: np.ndarray, C: np.ndarray, R: np.ndarray, values: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Every mode's measurement update, covariances in Joseph's form, and the log-likelihoods of the measurement.

    K = P- C' S^-1,    x = x- + K (z - C x-),    P = (I - K C) P- (I - K C)' + K R K',    ln N(z - r; 0, S)

    Parameters
    ----------
    means, covariances : (modes, n), (modes, n, n) predicted to the time of the measurement
    C, R : (p, n), (p, p)
    values : (p,) z

    Returns
    -------
    means (modes, n), covariances (modes, n, n) exactly symmetric, log_likelihoods (modes,).

    Liu & Hwang, step 4 and equation (18), whose innovation is z - r.
    """
    modes, states = means.shape
    rows = len(C)
    expected, spread, gain = predict_measurement(means, covariances, C, R)
    updated, result = means.copy(), np.empty((modes, states, states))
    log_likelihoods = np.empty(modes)
    factor, keep, left = np.empty((rows, rows)), np.empty((states, states)), np.empty(states)
    for j in range(modes):
        cholesky(spread[j], factor)
        for a in range(states):
            whiten(factor, gain[j, a])
            unwhiten(factor, gain[j, a])
            for c in range(states):
                keep[a, c] = 1.0 if a == c else 0.0
            for i in range(rows):
                weight = gain[j, a, i]
                updated[j, a] += weight * (values[i] - expected[j, i])
                for c in range(states):
                    keep[a, c] -= weight * C[i, c]
        for a in range(states):
            for b in range(states):
                left[b] = 0.0
            for c in range(states):
                for b in range(states):
                    left[b] += keep[a, c] * covariances[j, c, b]
            for b in range(a + 1):
                total = 0.0
                for c in range(states):
                    total += left[c] * keep[b, c]
                for i in range(rows):
                    for k in range(rows):
                        total += gain[j, a, i] * R[i, k] * gain[j, b, k]
                result[j, a, b] = total
                result[j, b, a] = total
        for i in range(rows):
            expected[j, i] = values[i] - expected[j, i]
        distance = whiten(factor, expected[j])
        log_likelihoods[j] = -0.5 * (distance + log_determinant(factor) + rows * LOG_TWO_PI)
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
    joint = log_predicted + log_likelihoods
    largest = -np.inf
    for j in range(len(joint)):
        largest = max(largest, joint[j])
    total = 0.0
    for j in range(len(joint)):
        total += math.exp(joint[j] - largest)
    return joint - (largest + math.log(total))

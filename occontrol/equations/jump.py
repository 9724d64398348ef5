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

from occontrol.numerics.small import cholesky, log_determinant, whiten

LOG_TWO_PI = math.log(2.0 * math.pi)


@njit(cache=True)
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


@njit(cache=True)
def match_moments(weights: np.ndarray, means: np.ndarray, covariances: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of a mixture of Gaussians.

    x = sum_i w_i x_i,    P = sum_i w_i [P_i + (x_i - x)(x_i - x)']

    Parameters
    ----------
    weights : (modes,) summing to 1
    means : (modes, n)
    covariances : (modes, n, n)

    Returns
    -------
    mean (n,), covariance (n, n), exactly symmetric.

    Liu & Hwang, equations (16), (17) with the mixing weights, step 6 (corrected) with the mode probabilities.
    """
    modes, states = means.shape
    mean = np.zeros(states)
    covariance = np.zeros((states, states))
    for i in range(modes):
        for a in range(states):
            mean[a] += weights[i] * means[i, a]
    for i in range(modes):
        weight = weights[i]
        if weight == 0.0:
            continue
        for a in range(states):
            from_mean = means[i, a] - mean[a]
            for b in range(a + 1):
                covariance[a, b] += weight * (covariances[i, a, b] + from_mean * (means[i, b] - mean[b]))
    for a in range(states):
        for b in range(a):
            covariance[b, a] = covariance[a, b]
    return mean, covariance


@njit(cache=True)
def propagate(
    mean: np.ndarray, covariance: np.ndarray, A: np.ndarray, noise: np.ndarray, drift: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """One mode's prediction over one step.

    x- = A x + B u,    P- = A P A' + F W F'

    Parameters
    ----------
    mean, covariance : (n,), (n, n) the mode's mixed initial condition
    A : (n, n)
    noise : (n, n) F W F'
    drift : (n,) B u(k+1)

    Returns
    -------
    mean (n,), covariance (n, n), exactly symmetric. Liu & Hwang, step 3.
    """
    states = len(mean)
    predicted = np.empty(states)
    product = np.empty((states, states))
    result = np.empty((states, states))
    for a in range(states):
        total = drift[a]
        for c in range(states):
            total += A[a, c] * mean[c]
        predicted[a] = total
        for b in range(states):
            product[a, b] = 0.0
        for c in range(states):
            if A[a, c] != 0.0:
                for b in range(states):
                    product[a, b] += A[a, c] * covariance[c, b]
    for a in range(states):
        for b in range(a + 1):
            total = noise[a, b]
            for c in range(states):
                total += product[a, c] * A[b, c]
            result[a, b] = total
            result[b, a] = total
    return predicted, result


@njit(cache=True)
def predict_measurement(
    mean: np.ndarray, covariance: np.ndarray, C: np.ndarray, R: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What a sensor would read under one mode.

    r = C x-,    S = C P- C' + R

    Parameters
    ----------
    mean, covariance : (n,), (n, n) of the mode, predicted to the time of the measurement
    C, R : (p, n), (p, p)

    Returns
    -------
    r (p,), S (p, p) symmetric, cross (p, n) = C P-. Liu & Hwang, step 3.
    """
    rows, states = C.shape
    expected = np.empty(rows)
    cross = np.empty((rows, states))
    spread = np.empty((rows, rows))
    for a in range(rows):
        total = 0.0
        for b in range(states):
            cross[a, b] = 0.0
        for c in range(states):
            total += C[a, c] * mean[c]
            if C[a, c] != 0.0:
                for b in range(states):
                    cross[a, b] += C[a, c] * covariance[c, b]
        expected[a] = total
    for a in range(rows):
        for b in range(a + 1):
            total = R[a, b]
            for c in range(states):
                total += cross[a, c] * C[b, c]
            spread[a, b] = total
            spread[b, a] = total
    return expected, spread, cross


@njit(cache=True)
def correct(
    mean: np.ndarray, covariance: np.ndarray, C: np.ndarray, R: np.ndarray, values: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """One mode's measurement update, with the covariance in Joseph's form, and the log-likelihood of the measurement.

    K = P- C' S^-1,    x = x- + K (z - C x-),    P = (I - K C) P- (I - K C)' + K R K',    ln N(z - r; 0, S)

    Parameters
    ----------
    mean, covariance : (n,), (n, n) of the mode, predicted to the time of the measurement
    C, R : (p, n), (p, p)
    values : (p,) z

    Returns
    -------
    mean (n,), covariance (n, n) exactly symmetric, log_likelihood. Liu & Hwang, step 4 and equation (18).
    """
    rows, states = C.shape
    expected, spread, cross = predict_measurement(mean, covariance, C, R)
    factor = cholesky(spread)
    innovation = whiten(factor, values - expected)
    distance = 0.0
    for a in range(rows):
        distance += innovation[a] * innovation[a]
    gain = np.empty((states, rows))
    for a in range(states):
        white = whiten(factor, cross[:, a])
        for i in range(rows - 1, -1, -1):
            total = white[i]
            for k in range(i + 1, rows):
                total -= factor[k, i] * gain[a, k]
            gain[a, i] = total / factor[i, i]
    updated = mean.copy()
    keep = np.eye(states)
    for a in range(states):
        for i in range(rows):
            updated[a] += gain[a, i] * (values[i] - expected[i])
            for b in range(states):
                keep[a, b] -= gain[a, i] * C[i, b]
    result = _joseph(keep, covariance, gain, R)
    return updated, result, -0.5 * (distance + log_determinant(factor) + rows * LOG_TWO_PI)


@njit(cache=True)
def _joseph(keep: np.ndarray, covariance: np.ndarray, gain: np.ndarray, R: np.ndarray) -> np.ndarray:
    states, rows = gain.shape
    result = np.zeros((states, states))
    left = np.zeros((states, states))
    for a in range(states):
        for c in range(states):
            if keep[a, c] != 0.0:
                for b in range(states):
                    left[a, b] += keep[a, c] * covariance[c, b]
    for a in range(states):
        for b in range(a + 1):
            total = 0.0
            for c in range(states):
                total += left[a, c] * keep[b, c]
            for i in range(rows):
                for j in range(rows):
                    total += gain[a, i] * R[i, j] * gain[b, j]
            result[a, b] = total
            result[b, a] = total
    return result


@njit(cache=True)
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

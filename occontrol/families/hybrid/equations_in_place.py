"""The equations of equations.py and bhattacharyya.py written into arrays that the caller provides.

One step of one run takes a few microseconds, as long as some tens of allocations: the many-run kernel brings one set of
arrays for all of them. Scratch arrays may be larger than needed; `rows` is the number of values of the measurement.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from occontrol.families.hybrid.cholesky import cholesky, log_determinant, unwhiten, whiten

LOG_TWO_PI = math.log(2.0 * math.pi)
SMALLEST = 1e-250


@njit(cache=True, error_model="numpy")
def predict_modes(log_probabilities, transition_matrix, log_predicted, mixing):
    """log_predicted (modes,), mixing (modes, modes)."""
    modes = len(log_probabilities)
    largest = np.max(log_probabilities)
    for i in range(modes):
        share = math.exp(log_probabilities[i] - largest)
        for j in range(modes):
            mixing[j, i] = share * transition_matrix[i, j]
    for j in range(modes):
        total = 0.0
        for i in range(modes):
            total += mixing[j, i]
        log_predicted[j] = largest
        if total < SMALLEST:
            # what feeds this mode underflowed beside the others: once more, relative to the largest of its own sources
            log_predicted[j] = _relative_to_sources(log_probabilities, transition_matrix, j, mixing[j])
            if log_predicted[j] == -np.inf:
                continue
            total = np.sum(mixing[j])
        for i in range(modes):
            mixing[j, i] /= total
        log_predicted[j] += math.log(total)


@njit(cache=True, error_model="numpy")
def _relative_to_sources(log_probabilities, transition_matrix, j, row):
    """The logarithm of the largest source of mode j; all sources relative to it in `row`, or alpha if there is none."""
    largest = -np.inf
    for i in range(len(row)):
        share = transition_matrix[i, j]
        row[i] = log_probabilities[i] + math.log(share) if share > 0.0 else -np.inf
        largest = max(largest, row[i])
    for i in range(len(row)):
        row[i] = math.exp(log_probabilities[i] if largest == -np.inf else row[i] - largest)
    return largest


@njit(cache=True, error_model="numpy")
def match_moments(weights, means, covariances, mean, covariance):
    """mean (sets, n), covariance (sets, n, n)."""
    sets, modes = weights.shape
    states = means.shape[1]
    mean[:] = 0.0
    covariance[:] = 0.0
    for j in range(sets):
        for i in range(modes):
            for a in range(states):
                mean[j, a] += weights[j, i] * means[i, a]
        for i in range(modes):
            weight = weights[j, i]
            if weight == 0.0:
                continue
            for a in range(states):
                apart = means[i, a] - mean[j, a]
                for b in range(a + 1):
                    covariance[j, a, b] += weight * (covariances[i, a, b] + apart * (means[i, b] - mean[j, b]))
        for a in range(states):
            for b in range(a):
                covariance[j, b, a] = covariance[j, a, b]


@njit(cache=True, error_model="numpy")
def propagate(means, covariances, A, noise, drift, predicted, result, product):
    """predicted (modes, n), result (modes, n, n); product (n,) is scratch."""
    modes, states = means.shape
    predicted[:] = drift
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


@njit(cache=True, error_model="numpy")
def predict_measurement(means, covariances, C, R, rows, expected, spread, cross):
    """expected (modes, p), spread (modes, p, p), cross (modes, n, p)."""
    modes, states = means.shape
    for j in range(modes):
        for a in range(rows):
            expected[j, a] = 0.0
            for b in range(states):
                cross[j, b, a] = 0.0
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


@njit(cache=True, error_model="numpy")
def correct(
    means,
    covariances,
    C,
    R,
    rows,
    values,
    updated,
    result,
    log_likelihoods,
    expected,
    spread,
    cross,
    gain,
    factor,
    left,
    row,
):
    """updated (modes, n), result (modes, n, n), log_likelihoods (modes,); the rest is scratch."""
    modes, states = means.shape
    predict_measurement(means, covariances, C, R, rows, expected, spread, cross)
    updated[:] = means
    for j in range(modes):
        cholesky(spread[j], factor, rows)
        for i in range(rows):
            expected[j, i] = values[i] - expected[j, i]
        for a in range(states):
            for i in range(rows):
                gain[j, a, i] = cross[j, a, i]
            whiten(factor, gain[j, a], rows)
            unwhiten(factor, gain[j, a], rows)
            for i in range(rows):
                updated[j, a] += gain[j, a, i] * expected[j, i]
        for a in range(states):
            # row a of (I - K C) P-, of that times C', and of K R
            for b in range(states):
                total = covariances[j, a, b]
                for i in range(rows):
                    total -= gain[j, a, i] * cross[j, b, i]
                left[b] = total
            for i in range(rows):
                total = 0.0
                for k in range(rows):
                    total += gain[j, a, k] * R[k, i]
                for c in range(states):
                    total -= left[c] * C[i, c]
                row[i] = total
            for b in range(a + 1):
                total = left[b]
                for i in range(rows):
                    total += row[i] * gain[j, b, i]
                result[j, a, b] = total
                result[j, b, a] = total
        distance = whiten(factor, expected[j], rows)
        log_likelihoods[j] = -0.5 * (distance + log_determinant(factor, rows) + rows * LOG_TWO_PI)


@njit(cache=True, error_model="numpy")
def weigh_modes(log_predicted, log_likelihoods, log_probabilities):
    """log_probabilities (modes,)."""
    largest = -np.inf
    for j in range(len(log_predicted)):
        log_probabilities[j] = log_predicted[j] + log_likelihoods[j]
        largest = max(largest, log_probabilities[j])
    total = 0.0
    for j in range(len(log_predicted)):
        total += math.exp(log_probabilities[j] - largest)
    total = largest + math.log(total)
    for j in range(len(log_predicted)):
        log_probabilities[j] -= total


@njit(cache=True, error_model="numpy")
def error_bound(log_priors, means, covariances, rows, determinants, both, apart):
    """The bound; determinants (modes,), both (p, p) and apart (p,) are scratch."""
    modes = len(means)
    for i in range(modes):
        cholesky(covariances[i], both, rows)
        determinants[i] = 0.5 * log_priors[i] + 0.25 * log_determinant(both, rows)
    bound = 0.0
    for i in range(modes):
        for j in range(i + 1, modes):
            weight = determinants[i] + determinants[j]
            if weight == -np.inf:
                continue
            for a in range(rows):
                apart[a] = means[j, a] - means[i, a]
                for b in range(a + 1):
                    both[a, b] = 0.5 * (covariances[i, a, b] + covariances[j, a, b])
            cholesky(both, both, rows)
            # (S_i + S_j)^-1 is half the inverse of `both`, hence an eighth and not a quarter
            bound += math.exp(weight - 0.125 * whiten(both, apart, rows) - 0.5 * log_determinant(both, rows))
    return bound

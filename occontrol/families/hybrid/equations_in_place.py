"""The equations of equations.py and bhattacharyya.py written into arrays that the caller provides.

One step of one run takes a few microseconds, as long as some tens of allocations: the many-run kernel brings one set of
arrays for all of them. Scratch arrays may be larger than needed; `rows` is the number of values of the measurement.
Every mode's filter carries a root S (n, n) of its covariance, as numerics/square_root_filter.py does.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from occontrol.families.hybrid.cholesky import cholesky, log_determinant, whiten
from occontrol.numerics.square_root_filter import triangularise

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
def form_covariances(roots, covariances):
    """covariances (modes, n, n) = S S', for the reader, guards and scores; no filter goes on from them."""
    modes, states, columns = roots.shape
    for j in range(modes):
        for a in range(states):
            for b in range(a + 1):
                total = 0.0
                for c in range(columns):
                    total += roots[j, a, c] * roots[j, b, c]
                covariances[j, a, b] = total
                covariances[j, b, a] = total


@njit(cache=True, error_model="numpy")
def predict_roots(mixing, means, roots, A, noise_roots, drift, predicted, result, mixed, array):
    """predicted (modes, n), result (modes, n, n), lower triangles; mixed (n,), array (n, modes (n+1) + q): scratch."""
    modes, states = means.shape
    for j in range(modes):
        mixed[:] = 0.0
        for i in range(modes):
            for a in range(states):
                mixed[a] += mixing[j, i] * means[i, a]
        array[:] = 0.0
        for a in range(states):
            total = drift[j, a]
            for c in range(states):
                entry = A[j, a, c]
                if entry == 0.0:
                    continue
                total += entry * mixed[c]
                for i in range(modes):
                    if mixing[j, i] > 0.0:
                        share, at = math.sqrt(mixing[j, i]) * entry, i * (states + 1)
                        for b in range(states):
                            array[a, at + b] += share * roots[i, c, b]
                        array[a, at + states] += share * (means[i, c] - mixed[c])
            predicted[j, a] = total
            at = modes * (states + 1)
            for b in range(noise_roots.shape[2]):
                array[a, at + b] = noise_roots[j, a, b]
        triangularise(array, states)
        result[j] = array[:, :states]


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
def correct(means, roots, C, R_root, rows, values, updated, result, log_likelihoods, white, buffer):
    """updated (modes, n), result (modes, n, n), log_likelihoods (modes,); white (p,), buffer ((p+n)^2,) are scratch."""
    modes, states = means.shape
    size = rows + states
    array = buffer[: size * size].reshape((size, size))
    for j in range(modes):
        for a in range(rows):
            white[a] = values[a]
            for b in range(states):
                array[a, b] = 0.0
            for c in range(states):
                entry = C[a, c]
                if entry != 0.0:
                    white[a] -= entry * means[j, c]
                    for b in range(states):
                        array[a, b] += entry * roots[j, c, b]
            for b in range(rows):
                array[a, states + b] = R_root[a, b]
        for a in range(states):
            for b in range(states):
                array[rows + a, b] = roots[j, a, b]
            for b in range(rows):
                array[rows + a, states + b] = 0.0
        triangularise(array, rows)
        logarithm = rows * LOG_TWO_PI
        for a in range(rows):
            for b in range(a):
                white[a] -= array[a, b] * white[b]
            white[a] /= array[a, a]
            logarithm += 2.0 * math.log(abs(array[a, a])) + white[a] * white[a]
        log_likelihoods[j] = -0.5 * logarithm
        for a in range(states):
            total = means[j, a]
            for b in range(rows):
                total += array[rows + a, b] * white[b]
            updated[j, a] = total
            for b in range(states):
                result[j, a, b] = array[rows + a, rows + b]


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

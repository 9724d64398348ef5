"""Compiled interacting-multiple-model filter with a sensor chooser, for one step and for many runs.

Unknowns of a run: means (modes, n), covariances (modes, n, n), log-probabilities (modes,). A `JumpModel` holds the sampled
problem; whatever changes with time has one entry per step k = 1 .. steps (index k - 1), the rest a single one.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from occontrol.equations.bhattacharyya import error_bound
from occontrol.equations.guards import guard_transitions
from occontrol.equations.jump import correct, match_moments, predict_measurement, predict_modes, propagate, weigh_modes
from occontrol.numerics.small import cholesky, whiten


class JumpModel(NamedTuple):
    """A jumping-mode plant and its groups of sensors as arrays.

    transition_matrix (modes, modes), used when there is no guard; guards as in equations/guards.py;
    A, noise (K or 1, modes, n, n) with noise = F W F'; drift (K or 1, modes, n) = B u;
    C (K or 1, groups, p, n), R (K or 1, groups, p, p), rows (groups,) of them in use, place (groups, p) of each row among all
    rows of all sensors; position (components,) of the state that count as position.
    """

    transition_matrix: np.ndarray
    source: np.ndarray
    target: np.ndarray
    guard_rows: np.ndarray
    guard_L: np.ndarray
    guard_b: np.ndarray
    threshold_mean: np.ndarray
    threshold_covariance: np.ndarray
    tolerance: float
    A: np.ndarray
    noise: np.ndarray
    drift: np.ndarray
    C: np.ndarray
    R: np.ndarray
    rows: np.ndarray
    place: np.ndarray
    position: np.ndarray


@njit(cache=True, error_model="numpy")
def predict_step(model, k: int, means: np.ndarray, covariances: np.ndarray, log_probabilities: np.ndarray):
    """Steps 1 and 2 and the prediction of every mode from k - 1 to k.

    c_j, x_j- and P_j- of every mode; see predict_modes, match_moments and propagate in equations/jump.py

    Parameters
    ----------
    model : JumpModel
    k : step, 1 .. steps
    means, covariances, log_probabilities : (modes, n), (modes, n, n), (modes,) at k - 1

    Returns
    -------
    means, covariances, log_predicted at k before the measurement, and excess and error of the guards' probabilities.
    """
    excess, error = 0.0, 0.0
    transition = model.transition_matrix
    if len(model.source):
        transition, excess, error = guard_transitions(
            means, covariances, model.source, model.target, model.guard_rows, model.guard_L, model.guard_b,
            model.threshold_mean, model.threshold_covariance, model.tolerance,
        )  # fmt: skip
    log_predicted, mixing = predict_modes(log_probabilities, transition)
    A = model.A[min(k, len(model.A)) - 1]
    noise = model.noise[min(k, len(model.noise)) - 1]
    drift = model.drift[min(k, len(model.drift)) - 1]
    mixed_means, mixed_covariances = match_moments(mixing, means, covariances)
    new_means, new_covariances = propagate(mixed_means, mixed_covariances, A, noise, drift)
    return new_means, new_covariances, log_predicted, excess, error


@njit(cache=True, error_model="numpy")
def position_variance(
    position: np.ndarray, log_predicted: np.ndarray, covariances: np.ndarray, cross: np.ndarray, spread: np.ndarray
) -> float:
    """Expected trace of the modes' own position covariances after a measurement.

    sum_j c_j tr P_j,pos,    P_j = P_j- - P_j- C' S_j^-1 C P_j-

    Parameters
    ----------
    position : indices of the state that count as position
    log_predicted : (modes,) ln c_j
    covariances, cross, spread : (modes, n, n) P-, (modes, n, p) P- C', overwritten, (modes, p, p) S

    The probabilities after the measurement average to c_j, which makes this the part of the expected error covariance that does
    not depend on the measurement; what is left out is the spread of the modes' means about the estimate.
    """
    factor = np.empty(spread.shape[1:])
    total = 0.0
    for j in range(len(log_predicted)):
        cholesky(spread[j], factor)
        own = 0.0
        for d in position:
            own += covariances[j, d, d] - whiten(factor, cross[j, d])
        total += math.exp(log_predicted[j]) * own
    return total


@njit(cache=True, error_model="numpy")
def score_groups(
    model,
    k: int,
    means: np.ndarray,
    covariances: np.ndarray,
    log_predicted: np.ndarray,
    bound_weight: float,
    position_weight: float,
) -> np.ndarray:
    """Step 3: what every group of sensors promises; the smallest is chosen.

    score = bound_weight * bound + position_weight * sum_j c_j tr P_j,pos

    Parameters
    ----------
    model : JumpModel
    k : step, 1 .. steps
    means, covariances, log_predicted : of `predict_step`
    bound_weight, position_weight : (1, lambda) for the paper's rule, (0, 1) for the expected covariance

    Returns
    -------
    (groups,)
    """
    C, R = model.C[min(k, len(model.C)) - 1], model.R[min(k, len(model.R)) - 1]
    scores = np.zeros(len(model.rows))
    for g in range(len(scores)):
        p = model.rows[g]
        expected, spread, cross = predict_measurement(means, covariances, C[g, :p], R[g, :p, :p])
        if bound_weight != 0.0:
            scores[g] += bound_weight * error_bound(log_predicted, expected, spread)
        if position_weight != 0.0:
            scores[g] += position_weight * position_variance(model.position, log_predicted, covariances, cross, spread)
    return scores


@njit(cache=True, error_model="numpy", nogil=True)
def filter_runs(
    model, mean: np.ndarray, covariance: np.ndarray, log_probabilities: np.ndarray, values: np.ndarray, choices: np.ndarray,
    bound_weight: float, position_weight: float,
):  # fmt: skip
    """All steps of all runs: predict, choose, correct, combine.

    Parameters
    ----------
    model : JumpModel
    mean, covariance, log_probabilities : (n,), (n, n), (modes,) at k = 0, the same for every mode and run
    values : (runs, steps, rows of all sensors) what every sensor would read; only the chosen group's rows are looked at
    choices : (runs, steps) group to use, filled in place where it is negative on entry
    bound_weight, position_weight : see `score_groups`

    Returns
    -------
    estimates (runs, steps, n), covariances (runs, steps, n, n), log_probabilities (runs, steps, modes), excess and error
    (the largest of the guards' probabilities, zero without guards).
    """
    runs, steps, _ = values.shape
    modes, states = len(log_probabilities), len(mean)
    estimates = np.empty((runs, steps, states))
    spreads = np.empty((runs, steps, states, states))
    chances = np.empty((runs, steps, modes))
    excess, error = 0.0, 0.0
    reading = np.empty(model.C.shape[2])
    for run in range(runs):
        x, P, chance = np.empty((modes, states)), np.empty((modes, states, states)), log_probabilities.copy()
        for j in range(modes):
            x[j] = mean
            P[j] = covariance
        for k in range(1, steps + 1):
            x, P, chance, over, off = predict_step(model, k, x, P, chance)
            excess, error = max(excess, over), max(error, off)
            group = choices[run, k - 1]
            if group < 0:
                group = np.argmin(score_groups(model, k, x, P, chance, bound_weight, position_weight))
                choices[run, k - 1] = group
            p = model.rows[group]
            for i in range(p):
                reading[i] = values[run, k - 1, model.place[group, i]]
            C, R = model.C[min(k, len(model.C)) - 1], model.R[min(k, len(model.R)) - 1]
            x, P, log_likelihoods = correct(x, P, C[group, :p], R[group, :p, :p], reading[:p])
            chance = weigh_modes(chance, log_likelihoods)
            combined, spread = match_moments(np.exp(chance).reshape(1, -1), x, P)
            estimates[run, k - 1] = combined[0]
            spreads[run, k - 1] = spread[0]
            chances[run, k - 1] = chance
    return estimates, spreads, chances, excess, error

"""Compiled interacting-multiple-model filter with a sensor chooser, for one step and for many runs.

Unknowns of a run: means (modes, n), roots of the covariances (modes, n, n), log-probabilities (modes,). A `JumpModel`
holds the sampled problem; whatever changes with time has one entry per step k = 1 .. steps (index k - 1), the rest a
single one.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from occontrol.families.hybrid import equations_in_place as in_place
from occontrol.families.hybrid.cholesky import cholesky, whiten
from occontrol.families.hybrid.guard_probability import guard_transitions


class JumpModel(NamedTuple):
    """A jumping-mode plant and its groups of sensors as arrays.

    transition_matrix (modes, modes), used when there is no guard; guards as in families/hybrid/guard_probability.py;
    A, noise (K or 1, modes, n, n) with noise = F W F'; noise_root (K or 1, modes, n, q), a root of it;
    drift (K or 1, modes, n) = B u; C (K or 1, groups, p, n), R and R_root, a root of it (K or 1, groups, p, p);
    rows (groups,) of them in use, place (groups, p) of each row among all rows of all sensors; position (components,)
    of the state that count as position.
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
    noise_root: np.ndarray
    drift: np.ndarray
    C: np.ndarray
    R: np.ndarray
    R_root: np.ndarray
    rows: np.ndarray
    place: np.ndarray
    position: np.ndarray


class Scratch(NamedTuple):
    """Arrays that every step of every run overwrites; p is the largest number of values of a group."""

    mixing: np.ndarray  # (modes, modes)
    mixed: np.ndarray  # (n,)
    covariances: np.ndarray  # (modes, n, n)
    expected: np.ndarray  # (modes, p)
    spread: np.ndarray  # (modes, p, p)
    cross: np.ndarray  # (modes, n, p)
    factor: np.ndarray  # (p, p)
    row: np.ndarray  # (p,)
    sources: np.ndarray  # (n, modes (n+1) + q)
    buffer: np.ndarray  # ((p+n)^2,)
    each: np.ndarray  # (modes,)
    scores: np.ndarray  # (groups,)


@njit(cache=True, error_model="numpy")
def make_scratch(modes: int, states: int, rows: int, groups: int, noises: int):
    """Scratch of the given sizes.

    Parameters
    ----------
    modes, states, rows, groups, noises : rows is the largest number of values of a group, noises q of noise_root
    """
    return Scratch(
        np.empty((modes, modes)), np.empty(states), np.empty((modes, states, states)), np.empty((modes, rows)),
        np.empty((modes, rows, rows)), np.empty((modes, states, rows)), np.empty((rows, rows)), np.empty(rows),
        np.empty((states, modes * (states + 1) + noises)), np.empty((rows + states) ** 2), np.empty(modes),
        np.empty(groups),
    )  # fmt: skip


@njit(cache=True, error_model="numpy")
def predict_step(model, k: int, means: np.ndarray, roots: np.ndarray, log_probabilities: np.ndarray):
    """Steps 1 and 2 and the prediction of every mode from k - 1 to k.

    c_j, x_j- and a root of P_j- of every mode; see predict_modes and predict in families/hybrid/equations.py

    Parameters
    ----------
    model : JumpModel
    k : step, 1 .. steps
    means, roots, log_probabilities : (modes, n), (modes, n, n), (modes,) at k - 1

    Returns
    -------
    means, roots, log_predicted at k before the measurement, and excess and error of the guards' probabilities.
    """
    modes, states = means.shape
    scratch = make_scratch(modes, states, 1, 1, model.noise_root.shape[3])
    new_means, new_roots, log_predicted = np.empty_like(means), np.empty((modes, states, states)), np.empty(modes)
    excess, error = _predict(model, k, means, roots, log_probabilities, scratch, new_means, new_roots, log_predicted)
    return new_means, new_roots, log_predicted, excess, error


@njit(cache=True, error_model="numpy", inline="always")
def _predict(model, k, means, roots, log_probabilities, scratch, new_means, new_roots, log_predicted):
    excess, error = 0.0, 0.0
    transition = model.transition_matrix
    if len(model.source):
        in_place.form_covariances(roots, scratch.covariances)
        transition, excess, error = guard_transitions(
            means, scratch.covariances, model.source, model.target, model.guard_rows, model.guard_L, model.guard_b,
            model.threshold_mean, model.threshold_covariance, model.tolerance,
        )  # fmt: skip
    in_place.predict_modes(log_probabilities, transition, log_predicted, scratch.mixing)
    A = model.A[min(k, len(model.A)) - 1]
    noise_root = model.noise_root[min(k, len(model.noise_root)) - 1]
    drift = model.drift[min(k, len(model.drift)) - 1]
    in_place.predict_roots(
        scratch.mixing, means, roots, A, noise_root, drift, new_means, new_roots, scratch.mixed, scratch.sources
    )
    return excess, error


@njit(cache=True, error_model="numpy")
def position_variance(
    position: np.ndarray,
    log_predicted: np.ndarray,
    covariances: np.ndarray,
    cross: np.ndarray,
    spread: np.ndarray,
    rows: int,
    factor: np.ndarray,
) -> float:
    """Expected trace of the modes' own position covariances after a measurement.

    sum_j c_j tr P_j,pos,    P_j = P_j- - P_j- C' S_j^-1 C P_j-

    Parameters
    ----------
    position : (q,) indices of the states that count as position
    log_predicted : (modes,) ln c_j
    covariances, cross, spread : (modes, n, n) P-, (modes, n, p) P- C', overwritten, (modes, p, p) S
    rows, factor : p, and (p, p) of scratch

    The probabilities after the measurement average to c_j, which makes this the part of the expected error
    covariance that does not depend on the measurement; what is left out is the spread of the modes' means about the
    estimate.
    """
    total = 0.0
    for j in range(len(log_predicted)):
        cholesky(spread[j], factor, rows)
        own = 0.0
        for d in position:
            own += covariances[j, d, d] - whiten(factor, cross[j, d], rows)
        total += math.exp(log_predicted[j]) * own
    return total


@njit(cache=True, error_model="numpy")
def score_groups(
    model,
    k: int,
    means: np.ndarray,
    roots: np.ndarray,
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
    means, roots, log_predicted : (modes, n), (modes, n, n), (modes,), of `predict_step`
    bound_weight, position_weight : (1, lambda) for the paper's rule, (0, 1) for the expected covariance

    Returns
    -------
    (groups,)
    """
    modes, states = means.shape
    scratch = make_scratch(modes, states, model.C.shape[2], len(model.rows), model.noise_root.shape[3])
    _score(model, k, means, roots, log_predicted, bound_weight, position_weight, scratch)
    return scratch.scores


@njit(cache=True, error_model="numpy", inline="always")
def _score(model, k, means, roots, log_predicted, bound_weight, position_weight, scratch):
    C, R = model.C[min(k, len(model.C)) - 1], model.R[min(k, len(model.R)) - 1]
    expected, spread, cross, covariances = scratch.expected, scratch.spread, scratch.cross, scratch.covariances
    in_place.form_covariances(roots, covariances)
    for g in range(len(model.rows)):
        rows, score = model.rows[g], 0.0
        in_place.predict_measurement(means, covariances, C[g], R[g], rows, expected, spread, cross)
        if bound_weight != 0.0:
            score += bound_weight * in_place.error_bound(
                log_predicted, expected, spread, rows, scratch.each, scratch.factor, scratch.row
            )
        if position_weight != 0.0:
            score += position_weight * position_variance(
                model.position, log_predicted, covariances, cross, spread, rows, scratch.factor
            )
        scratch.scores[g] = score


@njit(cache=True, error_model="numpy", nogil=True)
def filter_runs(
    model,
    mean: np.ndarray,
    root: np.ndarray,
    log_probabilities: np.ndarray,
    values: np.ndarray,
    choices: np.ndarray,
    bound_weight: float,
    position_weight: float,
):
    """All steps of all runs: predict, choose, correct, combine.

    Parameters
    ----------
    model : JumpModel
    mean, root, log_probabilities : (n,), (n, n) of the covariance, (modes,) at k = 0, the same for every mode and run
    values : (runs, steps, rows) what all sensors would read; only the rows of the chosen group are looked at
    choices : (runs, steps) group to use, filled in place where it is negative on entry
    bound_weight, position_weight : see `score_groups`

    Returns
    -------
    estimates (runs, steps, n), covariances (runs, steps, n, n), log_probabilities (runs, steps, modes), excess and
    error (the largest of the guards' probabilities, zero without guards).
    """
    runs, steps, _ = values.shape
    modes, states = len(log_probabilities), len(mean)
    estimates = np.empty((runs, steps, states))
    spreads = np.empty((runs, steps, states, states))
    chances = np.empty((runs, steps, modes))
    excess, error = 0.0, 0.0
    reading = np.empty(model.C.shape[2])
    scratch = make_scratch(modes, states, model.C.shape[2], len(model.rows), model.noise_root.shape[3])
    x, S, chance = np.empty((modes, states)), np.empty((modes, states, states)), np.empty(modes)
    ahead, wide, log_predicted = np.empty_like(x), np.empty_like(S), np.empty(modes)
    likelihoods, weights = np.empty(modes), np.empty((1, modes))
    for run in range(runs):
        x[:] = mean
        S[:] = root
        chance[:] = log_probabilities
        for k in range(1, steps + 1):
            over, off = _predict(model, k, x, S, chance, scratch, ahead, wide, log_predicted)
            excess, error = max(excess, over), max(error, off)
            group = choices[run, k - 1]
            if group < 0:
                _score(model, k, ahead, wide, log_predicted, bound_weight, position_weight, scratch)
                group = np.argmin(scratch.scores)
                choices[run, k - 1] = group
            rows = model.rows[group]
            for i in range(rows):
                reading[i] = values[run, k - 1, model.place[group, i]]
            C, R_root = model.C[min(k, len(model.C)) - 1, group], model.R_root[min(k, len(model.R_root)) - 1, group]
            in_place.correct(
                ahead, wide, C, R_root, rows, reading, x, S, likelihoods, scratch.row, scratch.buffer
            )
            in_place.weigh_modes(log_predicted, likelihoods, chance)
            for j in range(modes):
                weights[0, j] = math.exp(chance[j])
                chances[run, k - 1, j] = chance[j]
            in_place.form_covariances(S, scratch.covariances)
            in_place.match_moments(weights, x, scratch.covariances, estimates[run, k - 1 : k], spreads[run, k - 1 : k])
    return estimates, spreads, chances, excess, error

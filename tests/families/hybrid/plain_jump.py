"""The estimator of Liu & Hwang written out plainly for one run, sharing nothing with the package."""

from __future__ import annotations

import numpy as np
from scipy.stats import multivariate_normal


def guard_matrix(means, covariances, guards, threshold_mean, threshold_covariance):
    """Rows: from; guards are (source, target, L, b) with positions of modes."""
    modes = len(means)
    matrix = np.zeros((modes, modes))
    own = {source for source, target, _, _ in guards if source == target}
    for source, target, L, b in guards:
        joint_mean = np.concatenate([means[source], threshold_mean])
        n, extra = len(means[source]), len(threshold_mean)
        joint = np.zeros((n + extra, n + extra))
        joint[:n, :n], joint[n:, n:] = covariances[source], threshold_covariance
        y, S = L @ joint_mean + b, L @ joint @ L.T
        matrix[source, target] += multivariate_normal.cdf(np.zeros(len(y)), y, S, allow_singular=True, abseps=1e-10)
    for i in range(modes):
        if i not in own and matrix[i].sum() < 1:
            matrix[i, i] = 1 - matrix[i].sum()
        matrix[i] /= matrix[i].sum()
    return matrix


def predict(transition, A, Q, drift, means, covariances, alpha):
    """Steps 1, 2 and the prediction: c, x-, P- of every mode."""
    modes = len(alpha)
    c = transition.T @ alpha
    xs, Ps = [], []
    for j in range(modes):
        mu = transition[:, j] * alpha / c[j]
        x0 = sum(mu[i] * means[i] for i in range(modes))
        P0 = sum(mu[i] * (covariances[i] + np.outer(means[i] - x0, means[i] - x0)) for i in range(modes))
        xs.append(A[j] @ x0 + drift[j])
        Ps.append(A[j] @ P0 @ A[j].T + Q[j])
    return c, xs, Ps


def bound(c, xs, Ps, C, R):
    """Bhattacharyya bound of one sensor, with |(S_i + S_j)/2|."""
    total = 0.0
    r, S = [C @ x for x in xs], [C @ P @ C.T + R for P in Ps]
    for i in range(len(c)):
        for j in range(i + 1, len(c)):
            d, both = r[j] - r[i], (S[i] + S[j]) / 2
            k = d @ np.linalg.solve(both, d) / 8
            k += 0.5 * np.log(np.linalg.det(both) / np.sqrt(np.linalg.det(S[i]) * np.linalg.det(S[j])))
            total += np.sqrt(c[i] * c[j]) * np.exp(-k)
    return total


def position_variance(c, Ps, C, R, position):
    """Sum of c_j tr P_j, position block, after the measurement."""
    total = 0.0
    for cj, P in zip(c, Ps, strict=True):
        after = P - P @ C.T @ np.linalg.inv(C @ P @ C.T + R) @ C @ P
        total += cj * sum(after[d, d] for d in position)
    return total


def update(c, xs, Ps, C, R, z):
    """Steps 4 and 5: x, P, alpha."""
    likelihood, means, covariances = [], [], []
    for x, P in zip(xs, Ps, strict=True):
        S = C @ P @ C.T + R
        K = P @ C.T @ np.linalg.inv(S)
        v = z - C @ x
        likelihood.append(np.exp(-0.5 * v @ np.linalg.solve(S, v)) / np.sqrt(np.linalg.det(2 * np.pi * S)))
        means.append(x + K @ v)
        covariances.append(P - K @ S @ K.T)
    alpha = c * np.array(likelihood)
    return means, covariances, alpha / alpha.sum()


def run(problem, transition_of, z_of, weight, choose=None):
    """One run: estimates, probabilities, combined covariances, choices.

    problem: dict with A(k), Q(k), drift(k) per mode, groups [(C, R)], mean, covariance, alpha, steps, position;
    z_of(k, group) the measurement; choose(k) or None for the criterion with `weight`.
    """
    modes = len(problem["alpha"])
    means, covariances = [problem["mean"]] * modes, [problem["covariance"]] * modes
    alpha = np.array(problem["alpha"], dtype=float)
    estimates, chances, spreads, choices = [], [], [], []
    for k in range(1, problem["steps"] + 1):
        Gamma = transition_of(means, covariances)
        c, xs, Ps = predict(Gamma, problem["A"](k), problem["Q"](k), problem["drift"](k), means, covariances, alpha)
        if choose is None:
            scores = [
                bound(c, xs, Ps, C, R) + weight * position_variance(c, Ps, C, R, problem["position"])
                for C, R in problem["groups"]
            ]
            g = int(np.argmin(scores))
        else:
            g = choose(k)
        C, R = problem["groups"][g]
        means, covariances, alpha = update(c, xs, Ps, C, R, z_of(k, g))
        x = sum(a * m for a, m in zip(alpha, means, strict=True))
        parts = zip(alpha, means, covariances, strict=True)
        spreads.append(sum(a * (P + np.outer(m - x, m - x)) for a, m, P in parts))
        estimates.append(x)
        chances.append(alpha)
        choices.append(g)
    return np.array(estimates), np.array(chances), np.array(spreads), np.array(choices)

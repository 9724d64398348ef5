"""An outside judge for precision programs: CVXPY on the anomaly form, which shares nothing with the solvers.

With joint anomalies P = AA', G = AB', Y = BB' the bound reads  I + B'SB >= A'(P^d)^-1 A: no rank decision and no
inverse of Y.
Both sides are multiplied by (I + A'(P^d)^-1 A)^(-1/2), which changes nothing but the scale.
"""

from __future__ import annotations

import numpy as np


def anomalies_of(state, cross, measurement):
    """Joint anomalies (n+m, k) from moments, by an eigenvalue decomposition of the whole."""
    joint = np.block([[state, cross], [cross.T, measurement]])
    scale = np.sqrt(np.diag(joint))
    values, vectors = np.linalg.eigh(joint / scale / scale[:, None])
    return scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))


def least_precision(anomalies, bound, prices=None, caps=None, tolerance=1e-11):
    """Objective and status of the program by CVXPY with Clarabel."""
    import cvxpy as cp

    n = bound.shape[0]
    m = anomalies.shape[0] - n
    prices = np.ones(m) if prices is None else prices
    caps = np.full(m, np.inf) if caps is None else caps
    a, b = np.linalg.solve(np.linalg.cholesky(bound), anomalies[:n]), anomalies[n:]
    k = a.T @ a
    values, vectors = np.linalg.eigh(k)
    half = (vectors / np.sqrt(1 + np.maximum(values, 0))) @ vectors.T
    b = b @ half
    constant = half @ (np.eye(k.shape[0]) - k) @ half
    unit = 1 / np.sum(b**2, axis=1)
    x = cp.Variable(m, nonneg=True)
    rows = b * np.sqrt(unit)[:, None]
    constraints = [(constant + constant.T) / 2 + rows.T @ cp.diag(x) @ rows >> 0]
    finite = np.isfinite(caps)
    if np.any(finite):
        constraints.append(x[finite] <= (caps / unit)[finite])
    costs = prices * unit
    problem = cp.Problem(cp.Minimize((costs / np.mean(costs)) @ x), constraints)
    problem.solve(solver=cp.CLARABEL, tol_gap_abs=tolerance, tol_gap_rel=tolerance, tol_feas=tolerance)
    value = None if problem.value is None else float(problem.value * np.mean(costs))
    return value, problem.status


def random_case(rng):
    """Moments, anomalies, bound, prices and caps with units spread over eight decades and, mostly, a singular Y."""
    from occontrol.families.precision.moments import Moments

    n, m, members = rng.integers(1, 6), rng.integers(1, 10), rng.integers(2, 12)
    anomalies = rng.standard_normal((n + m, members))
    if rng.random() < 0.7:  # something of the state that no sensor sees
        own = np.vstack([np.diag(rng.uniform(0.1, 0.6, n)), np.zeros((m, n))])
        anomalies = np.hstack([anomalies, own])
    units = 10.0 ** rng.uniform(-4, 4, n + m)
    anomalies *= units[:, None]
    joint = anomalies @ anomalies.T
    a = rng.standard_normal((n, n))
    bound = units[:n, None] * (a @ a.T / n + 0.3 * np.eye(n)) * units[:n]
    variance = np.diag(joint)[n:]
    prices = 10.0 ** rng.uniform(-1, 1, m) * variance
    caps = np.full(m, np.inf)
    if rng.random() < 0.5:
        caps = np.where(rng.random(m) < 0.6, 10.0 ** rng.uniform(-1, 2, m) / variance, np.inf)
    factor = anomalies if rng.random() < 0.5 else None
    return Moments(joint[:n, :n], joint[:n, n:], joint[n:, n:], factor), anomalies, bound, prices, caps


def place_bound(program, over):
    """The bound scaled to `over` times the smallest reachable one (to 5 % of the prior where that is still less)."""
    from dataclasses import replace

    from occontrol.families.precision.program import examine, relative_margin

    _, verdict, _ = examine(program)
    prior = 1 - relative_margin(program.moments.state, program.bound)
    return replace(program, bound=program.bound * max(verdict.factor, 0.05 * prior) * over)

"""The cost of a schedule by a plain recursion in NumPy and SciPy that shares no code with the package's.

Half predict by van Loan's exponential over short pieces (midpoint values; second order in their length), update in
Joseph form, half predict; the running cost is charged at the nodes by the trapezoidal rule.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.linalg import expm


def flow(plant, a, b, pieces, memory):
    """F and Q from a to b."""
    n = plant.states
    if plant.A.constant and plant.noise.constant:
        key = round(b - a, 12)
        if key not in memory:
            memory[key] = _exponential(plant.A.at(0.0), plant.noise.at(0.0), b - a)
        return memory[key]
    cuts = np.union1d(plant.A.breaks(a, b), plant.noise.breaks(a, b))
    nodes = np.concatenate([[a], cuts[(cuts > a + 1e-9) & (cuts < b - 1e-9)], [b]])
    F, Q = np.eye(n), np.zeros((n, n))
    for u, v in pairwise(nodes):
        for i in range(pieces):
            middle, h = u + (i + 0.5) * (v - u) / pieces, (v - u) / pieces
            f, q = _exponential(plant.A.at(middle), plant.noise.at(middle), h)
            F, Q = f @ F, f @ Q @ f.T + q
    return F, Q


def _exponential(A, noise, h):
    n = len(A)
    big = expm(h * np.block([[-A, noise], [np.zeros((n, n)), A.T]]))
    F = big[n:, n:].T
    Q = F @ big[:n, n:]
    return F, (Q + Q.T) / 2


def schedule_cost(problem, weights, pieces=1):
    """alpha int q v dt + int tr(R Sigma) dt + tr(W Sigma(T)) of an integral policy (N, M)."""
    plant, edges, memory = problem.plant, problem.edges, {}
    S = plant.covariance
    total = 0.0
    R = (lambda t: 0.0) if problem.running is None else (lambda t: np.trace(problem.running.at(t) @ S))
    for k, (a, b) in enumerate(pairwise(edges)):
        h, middle = b - a, (a + b) / 2
        total += h / 2 * R(a)
        F, Q = flow(plant, a, middle, pieces, memory)
        S = F @ S @ F.T + Q
        for j in np.flatnonzero(weights[k] > 0.5):
            sensor = problem.sensors[j]
            total += problem.cost_weight * h * sensor.cost.at(middle)[0, 0]
            if sensor.rows:
                C, noise = sensor.C.at(middle), sensor.noise.at(middle) / h
                K = S @ C.T @ np.linalg.inv(C @ S @ C.T + noise)
                left = np.eye(len(S)) - K @ C
                S = left @ S @ left.T + K @ noise @ K.T
        F, Q = flow(plant, middle, b, pieces, memory)
        S = F @ S @ F.T + Q
        total += h / 2 * R(b)
    D, F = problem.output.at(problem.predict_at), np.eye(len(S))
    later = np.linspace(edges[-1], problem.predict_at, 401)
    if problem.predict_at > edges[-1]:
        for a, b in pairwise(later):
            F = flow(plant, a, b, pieces, memory)[0] @ F
    return total + float(np.trace(D @ F @ S @ F.T @ D.T))

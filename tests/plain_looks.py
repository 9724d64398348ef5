"""Small problems of targets, and their optimum over all schedules of whole looks by listing them, in plain NumPy.

Nothing here is shared with the product: F and Q from one matrix exponential, information form, every pattern of looks
of a target listed, patterns of two or three targets combined where they leave every resource its capacity.
"""

from __future__ import annotations

import itertools

import numpy as np
from scipy.linalg import expm


def flow(A: np.ndarray, X: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
    """F and Q over a time t."""
    n = len(A)
    big = expm(np.block([[-A, X], [np.zeros((n, n)), A.T]]) * t)
    F = big[n:, n:].T
    return F, F @ big[:n, n:]


def patterns(document: dict, i: int) -> np.ndarray:
    """What target i costs with every set of looks: bit k R + r is a look of resource r on interval k."""
    target = document["targets"][i]
    model = document["target_models"][target["model"]]
    horizon, sites = document["horizon"], document["resources"]
    N, s, R = horizon["intervals"], horizon["substeps"], len(sites)
    h = (horizon["end"] - horizon["start"]) / N
    weight = target.get("weight", 1.0)
    A, X = np.array(model["A"]), np.array(model["noise"])
    running = weight * np.array(model["running"])
    D = np.array(model["output"])
    alpha = document["objective"]["cost_weight"]
    told, paid = [], []
    for r, site in enumerate(sites):
        look = document["looks"][r]
        C, theta = np.array(look["C"]), np.array(target["noise"][site["name"]])
        told.append(C.T @ np.linalg.inv(theta) @ C)
        paid.append(alpha * look["cost"] * h)
    F1, Q1 = flow(A, X, h / s / 2)
    F, Q = flow(A, X, h / s)
    S, cost = np.array(model["initial"]["covariance"])[None], np.zeros(1)
    for k in range(N):
        open_ = [
            r for r, site in enumerate(sites)
            if any(a <= k * h + 1e-9 and (k + 1) * h <= b + 1e-9 for a, b in site["windows"])
        ]  # fmt: skip
        after, costs = [], []
        for used in itertools.product((0, 1), repeat=R):
            used = used[::-1]  # bit r counts 2^r
            if any(u and r not in open_ for r, u in enumerate(used)):
                after.append(S.copy())
                costs.append(np.full(len(S), np.inf))
                continue
            T, c = S.copy(), cost + sum(u * p for u, p in zip(used, paid, strict=True))
            L = sum((u * t for u, t in zip(used, told, strict=True)), np.zeros_like(A))
            for q in range(s):
                first = k == 0 and q == 0
                T = (F1 if first else F) @ T @ (F1 if first else F).T + (Q1 if first else Q)
                c = c + h / s / 2 * np.einsum("ij,pji->p", running, T)
                T = np.linalg.inv(np.linalg.inv(T) + h / s * L)
                c = c + h / s / 2 * np.einsum("ij,pji->p", running, T)
            after.append(T)
            costs.append(c)
        S, cost = np.concatenate(after), np.concatenate(costs)  # the later interval has the higher bits
    S = F1 @ S @ F1.T + Q1
    return cost + weight * np.einsum("ij,pjk,ik->p", D, S, D)


def optimum(document: dict) -> float:
    """The least cost of all schedules of whole looks."""
    each = [patterns(document, i) for i in range(len(document["targets"]))]
    size = len(each[0])
    full = size - 1
    capacity = document["resources"][0]["capacity"]
    if capacity >= len(each):
        return float(sum(np.min(c) for c in each))
    below = each[-1].copy()  # the best of all subsets
    for bit in range(size.bit_length() - 1):
        has = np.flatnonzero(np.arange(size) >> bit & 1)
        below[has] = np.minimum(below[has], below[has ^ (1 << bit)])
    every = np.arange(size)
    if len(each) == 2:
        return float(np.min(each[0] + below[full ^ every]))
    best = np.inf
    for p in range(size):
        if np.isfinite(each[0][p]):
            if capacity == 1:
                other = every[(every & p) == 0]
                total = each[1][other] + below[full ^ (p | other)]
            else:
                total = each[1] + below[full ^ (p & every)]
            best = min(best, each[0][p] + np.min(total))
    return float(best)


def small(seed: int) -> dict:
    """Two or three targets of one or two states; precise or weak looks, windows, capacities 1 and 2, two sites."""
    g = np.random.default_rng(seed)
    K = int(g.integers(2, 4))
    sites = int(g.integers(1, 3))
    N = {(2, 1): int(g.integers(8, 15)), (3, 1): int(g.integers(6, 10)), (2, 2): int(g.integers(4, 8)), (3, 2): 4}[
        K, sites
    ]
    h, s = float(10 ** g.uniform(-1, 0.2)), int(g.integers(1, 3))
    size = 10 ** g.uniform(-2, 1)  # of the noise of looks
    names = ["east", "west"][:sites]
    capacity = int(g.integers(1, 3)) if K == 3 else 1
    resources, looks = [], []
    for r, name in enumerate(names):
        cut = int(g.integers(2, N - 1))
        window = [[0, N * h]] if r == 0 and g.random() < 0.6 else [[0, (cut - 1) * h], [cut * h, N * h]]
        resources.append({"name": name, "capacity": capacity, "windows": window})
        looks.append({"resource": name, "C": None, "cost": float(g.choice([0.0, 0.05, 0.5]))})
    models, targets = {}, []
    n = int(g.integers(1, 3))
    for look in looks:
        look["C"] = np.round(g.standard_normal((1, n)), 2).tolist() if g.random() < 0.3 else np.eye(1, n).tolist()
    for i in range(K):
        A = np.diag(np.ones(n - 1), 1) - np.diag(g.uniform(-0.1, 0.4, n))
        X = np.diag(g.uniform(0.2, 1.5, n) * (np.arange(n) == n - 1) + 1e-3)
        start = 10 ** g.uniform(-1.5, 1.0, n)
        models[f"m{i}"] = {
            "A": A.tolist(), "noise": X.tolist(), "running": np.diag(g.uniform(0.2, 2, n)).tolist(),
            "output": (g.uniform(0, 1) * np.eye(1, n)).tolist(), "initial": {"covariance": np.diag(start).tolist()},
        }  # fmt: skip
        noise = {name: [[float(size * 10 ** g.uniform(-0.5, 0.5))]] for name in names}
        targets.append({"name": f"t{i}", "model": f"m{i}", "noise": noise, "weight": float(10 ** g.uniform(-0.3, 0.3))})
    return {
        "family": "athans", "name": f"small {seed}",
        "horizon": {"start": 0, "end": N * h, "intervals": N, "substeps": s}, "resources": resources,
        "target_models": models, "targets": targets, "looks": looks, "objective": {"cost_weight": 1.0},
    }  # fmt: skip

"""The recursion of a scheduling problem in 60 digits: an evaluator that shares no code with the product.

Plain arrays in; matrices of the standard library's decimal numbers, textbook formulas, full enumeration. For up to 3
states and constant data.
"""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal, localcontext
from itertools import pairwise, product

import numpy as np

DIGITS = 60


@dataclass
class Data:
    """A, Xi, Sigma0 (n, n); sensors [(C, Theta, q)], idle has no rows; D (p, n); R (n, n) or None; edges (N+1,)."""

    A: np.ndarray
    noise: np.ndarray
    covariance: np.ndarray
    sensors: list
    output: np.ndarray
    edges: np.ndarray
    cost_weight: float = 1.0
    running: np.ndarray | None = None


def exact(array) -> np.ndarray:
    """The doubles of a matrix as decimal numbers, to the last digit."""
    return np.array([[Decimal(float(x)) for x in row] for row in np.atleast_2d(array)], dtype=object)


def inverse(matrix: np.ndarray) -> np.ndarray:
    """By Gauss and Jordan with pivots."""
    n = len(matrix)
    wide = np.concatenate([matrix, exact(np.eye(n))], axis=1)
    for j in range(n):
        p = max(range(j, n), key=lambda i, j=j: abs(wide[i, j]))
        wide[[j, p]] = wide[[p, j]]
        wide[j] = wide[j] / wide[j, j]
        for i in range(n):
            if i != j:
                wide[i] = wide[i] - wide[i, j] * wide[j]
    return wide[:, n:]


def exponential(matrix: np.ndarray) -> np.ndarray:
    """By the power series of matrix/2^k, squared k times."""
    size = max(float(np.max(np.abs(matrix))) * len(matrix), 1e-30)
    k = max(0, int(np.ceil(np.log2(size))) + 4)
    small = matrix / Decimal(2**k)
    total = term = exact(np.eye(len(matrix)))
    for i in range(1, 60):
        term = term @ small / Decimal(i)
        total = total + term
    for _ in range(k):
        total = total @ total
    return total


class Judge:
    """Costs of schedules of one problem, as decimal numbers."""

    def __init__(self, data: Data):
        self.data = data
        with localcontext() as context:
            context.prec = DIGITS
            D = exact(data.output)
            self.start, self.W = exact(data.covariance), D.T @ D
            self.R = None if data.running is None else exact(data.running)
            edges = [Decimal(float(t)) for t in data.edges]
            self.h = [b - a for a, b in pairwise(edges)]
            self.sensors = [(exact(C) if len(C) else None, theta, Decimal(float(q))) for C, theta, q in data.sensors]
            context.prec = 2 * DIGITS
            self.half = [self._flow(h / 2) for h in self.h]

    def _flow(self, h: Decimal) -> tuple[np.ndarray, np.ndarray]:
        """exp(A h) and int exp(A t) Xi exp(A t)' dt, from the exponential of [[-A, Xi], [0, A']] h."""
        A, X = exact(self.data.A), exact(self.data.noise)
        n = len(A)
        E = exponential(np.block([[-A, X], [exact(np.zeros((n, n))), A.T]]) * h)
        F = E[n:, n:].T
        return F, F @ E[:n, n:]

    def step(self, k: int, S: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, Decimal]:
        """Covariance after interval k, and what the interval costs."""
        F, Q = self.half[k]
        S = F @ S @ F.T + Q
        spent, charge = Decimal(0), [S]
        for (C, theta, q), v in zip(self.sensors, weights, strict=True):
            v = Decimal(float(v))
            spent += Decimal(float(self.data.cost_weight)) * q * v * self.h[k]
            if C is not None and v > 0:
                gain = S @ C.T @ inverse(C @ S @ C.T + exact(theta) / (self.h[k] * v))
                S = S - gain @ C @ S
        charge.append(S)
        if self.R is not None:
            spent += self.h[k] / 2 * sum(np.trace(self.R @ each) for each in charge)
        return F @ S @ F.T + Q, spent

    def cost(self, weights: np.ndarray) -> Decimal:
        """J of a policy (N, M)."""
        with localcontext() as context:
            context.prec = DIGITS
            S, total = self.start, Decimal(0)
            for k in range(len(self.h)):
                S, spent = self.step(k, S, weights[k])
                total += spent
            return total + np.trace(self.W @ S)

    def optimum(self) -> tuple[Decimal, tuple[int, ...]]:
        """Least cost of all schedules that use one sensor at a time, and the schedule."""
        M, N = len(self.sensors), len(self.h)
        with localcontext() as context:
            context.prec = DIGITS
            known = {(): (self.start, Decimal(0))}
            for k in range(N):
                later = {}
                for path, (S, spent) in known.items():
                    for j in range(M):
                        after, more = self.step(k, S, np.eye(M)[j])
                        later[(*path, j)] = after, spent + more
                known = later
            total = {path: known[path][1] + np.trace(self.W @ known[path][0]) for path in product(range(M), repeat=N)}
            best = min(total, key=lambda path: total[path])
            return total[best], best


def random_data(rng: np.random.Generator, regime: str) -> Data:
    """A random problem with n <= 3 states, two sensors and idle, 3 or 4 intervals, in one of REGIMES."""
    n, N = int(rng.integers(1, 4)), int(rng.integers(3, 5))
    end = float(rng.uniform(0.5, 3))
    A = rng.normal(size=(n, n))
    prior, theta, scale = 1.0, 0.1, np.ones(n)
    if regime == "growth":
        A = A * (rng.uniform(8, 25) / end / max(np.max(np.linalg.eigvals(A).real), 0.3))
    elif regime == "prior":
        prior = 1e14
    elif regime == "precise":
        theta = 1e-6
    elif regime == "very precise":
        theta = 1e-10
    elif regime == "scales":
        scale = 10.0 ** rng.uniform(-6, 6, size=n)
    G, S = rng.normal(size=(n, n)), rng.normal(size=(n, n))
    noise, covariance = G @ G.T * 0.3, S @ S.T * prior
    sensors = [
        (rng.normal(size=(int(rng.integers(1, 3)), n)) / scale, theta, float(rng.choice([0.0, 0.2]))) for _ in range(2)
    ]
    sensors = [(C, t * np.eye(len(C)), q) for C, t, q in sensors]
    sensors.append((np.zeros((0, n)), np.zeros((0, 0)), 0.0))
    both = np.outer(scale, scale)
    running = None
    if rng.random() < 0.4:
        V = rng.normal(size=(n, n)) / scale
        running = V.T @ V
    noise, covariance = noise * both, covariance * both
    return Data(
        A * (scale[:, None] / scale),
        (noise + noise.T) / 2,
        (covariance + covariance.T) / 2,
        sensors,
        rng.normal(size=(1, n)) / scale,
        np.linspace(0.0, end, N + 1),
        0.1,
        None if running is None else (running + running.T) / 2,
    )


REGIMES = ("growth", "prior", "precise", "very precise", "scales")

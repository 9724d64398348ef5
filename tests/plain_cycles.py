"""Cycles without the program's code: a covariance filter that is iterated, and all cycles counted one by one."""

from __future__ import annotations

from itertools import product

import numpy as np

from occontrol.scheduling.periodic.letters import Letters, smallest_covariance


def discrete(F, Q, H, R, weight, prices=None, at="prior") -> Letters:
    """Letters of sensors H[j], R[j] of a plant in discrete time, charged tr(weight S) before or after the reading."""
    n, count = len(F), len(H)
    L = np.array([h.T @ np.linalg.inv(r) @ h if len(h) else np.zeros((n, n)) for h, r in zip(H, R, strict=True)])
    seen = np.zeros((count, 1, n, n)) if at == "prior" else L[:, None]
    constant = np.zeros(count) if prices is None else np.array(prices, dtype=float)
    plant = np.tile(F, (count, 1, 1)), np.tile(Q, (count, 1, 1))
    return Letters(*plant, L, seen, np.tile(weight, (count, 1, 1, 1)), constant)


def vehicle() -> Letters:
    """Gupta's vehicle: two position sensors, double integrators in the plane, h = 0.2."""
    h, eye = 0.2, np.eye(2)
    F, B = np.kron([[1, h], [0, 1]], eye), np.kron([[h * h / 2], [h]], eye)
    H = np.hstack([eye, np.zeros((2, 2))])
    return discrete(F, B @ [[1, 0.25], [0.25, 1]] @ B.T, [H, H], [np.diag([2.4, 0.4]), np.diag([0.7, 1.4])], np.eye(4))


def on_off() -> Letters:
    """A scalar plant that grows, one sensor that costs 1 a reading, and idle."""
    one = np.eye(1)
    return discrete(1.1 * one, one, [one, np.zeros((0, 1))], [0.5 * one, np.zeros((0, 0))], one, [1.0, 0.0])


def unstable() -> Letters:
    """Three states, two of which grow, and four scalar sensors."""
    rows = [(0.75, -0.2, -0.65), (0.35, 0.85, 0.35), (0.2, -0.65, 1.25), (0.7, 0.5, 0.5)]
    F = np.array([[-0.6, 0.8, 0.5], [-0.1, 1.5, -1.1], [1.1, 0.4, -0.2]])
    R = [np.array([[v]]) for v in (0.53, 0.8, 0.2, 0.5)]
    return discrete(F, np.eye(3), [np.array([r]) for r in rows], R, np.eye(3))


def random_plant(seed: int, states: int = 2, sensors: int = 2) -> Letters:
    """A small random plant, stable or growing slightly, with scalar sensors and prices."""
    g = np.random.default_rng(seed)
    F = g.standard_normal((states, states))
    F *= g.uniform(0.6, 1.25) / np.max(np.abs(np.linalg.eigvals(F)))
    root = g.standard_normal((states, states))
    H = [g.standard_normal((1, states)) for _ in range(sensors)]
    R = [np.array([[10 ** g.uniform(-2, 0.5)]]) for _ in range(sensors)]
    at = "prior" if seed % 2 else "posterior"
    Q, prices = 0.2 * root @ root.T + 0.05 * np.eye(states), g.uniform(0, 0.5, sensors)
    return discrete(F, Q, H, R, np.eye(states), prices, at)


def mean_cost(letters: Letters, word, cycles: int = 400) -> float:
    """The mean charge of the last of many cycles, from the identity; inf where it still grows."""
    S, before = np.eye(letters.states), np.inf
    eye = np.eye(letters.states)
    for _ in range(cycles):
        total = 0.0
        for a in word:
            Y = np.linalg.inv(S)
            for seen, weight in zip(letters.seen[a], letters.weight[a], strict=True):
                total += np.trace(weight @ np.linalg.inv(Y + seen))
            total += letters.constant[a]
            S = letters.F[a] @ np.linalg.solve(Y + letters.L[a], eye) @ letters.F[a].T + letters.Q[a]
            S = (S + S.T) / 2
        if not np.trace(S) < 1e9:
            return np.inf
        if abs(total - before) <= 1e-13 * abs(total):
            break
        before = total
    return total / len(word)


def best_by_counting(letters: Letters, longest: int) -> tuple[float, tuple[int, ...]]:
    """The best cycle of up to so many steps, all of them looked at but for rotations."""
    best = (np.inf, ())
    for p in range(1, longest + 1):
        for word in product(range(letters.count), repeat=p):
            if word == min(word[k:] + word[:k] for k in range(p)):
                cost = mean_cost(letters, word)
                if cost < best[0] - 1e-11:
                    best = (cost, word)
    return best


def in_units(letters: Letters) -> tuple[Letters, np.ndarray]:
    """The letters in units in which the smallest covariance is the identity, and its root."""
    root = np.linalg.cholesky(smallest_covariance(letters.F[0], letters.Q[0], np.sum(letters.L, axis=0)))
    return letters.in_units(root), root

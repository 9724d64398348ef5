"""Many runs of the jumping-mode estimator: the compiled kernel against a per-run Python loop of the same algorithm."""

from __future__ import annotations

import statistics
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from occontrol.api import read_problem
from occontrol.families.hybrid.methods import Scheduled
from occontrol.families.hybrid.monte_carlo import monte_carlo, run_some
from occontrol.families.hybrid.problem import Problem
from occontrol.families.hybrid.runs import experiment

PROBLEM = Path(__file__).parents[1] / "problems" / "turning_target.yaml"


def plain_run(problem: Problem, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """One run in NumPy, the kernel's steps one by one: estimates (steps, n), choices (steps,)."""
    plant, modes = problem.plant, range(len(problem.plant.modes))
    A = [m.A.at(1) for m in plant.modes]
    Q = [m.F.at(1) @ m.W.at(1) @ m.F.at(1).T for m in plant.modes]
    sensors = [(s.C.at(1), s.R.at(1), slice(2 * j, 2 * j + 2)) for j, s in enumerate(problem.sensors)]
    Gamma, eye = np.asarray(plant.transition_matrix), np.eye(plant.states)
    x, P, alpha = [plant.mean] * len(A), [plant.covariance] * len(A), plant.probabilities
    estimates, choices = np.empty((problem.steps, plant.states)), np.empty(problem.steps, dtype=int)
    for k in range(problem.steps):
        c = Gamma.T @ alpha
        mu = Gamma * alpha[:, None] / c
        x0 = [sum(mu[i, j] * x[i] for i in modes) for j in modes]
        P0 = [sum(mu[i, j] * (P[i] + np.outer(x[i] - x0[j], x[i] - x0[j])) for i in modes) for j in modes]
        x = [A[j] @ x0[j] for j in modes]
        P = [A[j] @ P0[j] @ A[j].T + Q[j] for j in modes]
        choices[k] = np.argmin([plain_bound(c, x, P, C, R) for C, R, _ in sensors])
        C, R, rows = sensors[choices[k]]
        z, likelihood = values[k, rows], np.empty(len(A))
        for j in modes:
            S = C @ P[j] @ C.T + R
            inverse = np.linalg.inv(S)
            K, v = P[j] @ C.T @ inverse, z - C @ x[j]
            x[j] = x[j] + K @ v
            L = eye - K @ C
            P[j] = L @ P[j] @ L.T + K @ R @ K.T
            likelihood[j] = np.exp(-0.5 * v @ inverse @ v) / (2 * np.pi * np.sqrt(np.linalg.det(S)))
        alpha = c * likelihood
        alpha = alpha / alpha.sum()
        estimates[k] = sum(alpha[j] * x[j] for j in modes)
        # the covariance of the mixture, which the kernel reports too
        sum(alpha[j] * (P[j] + np.outer(x[j] - estimates[k], x[j] - estimates[k])) for j in modes)
    return estimates, choices


def plain_bound(c: np.ndarray, x: list, P: list, C: np.ndarray, R: np.ndarray) -> float:
    """Bhattacharyya bound of one sensor."""
    r, S = [C @ mean for mean in x], [C @ covariance @ C.T + R for covariance in P]
    determinants = [np.linalg.det(matrix) for matrix in S]
    bound = 0.0
    for i in range(len(c)):
        for j in range(i + 1, len(c)):
            d, both = r[j] - r[i], (S[i] + S[j]) / 2
            ratio = np.linalg.det(both) / np.sqrt(determinants[i] * determinants[j])
            bound += np.sqrt(c[i] * c[j]) * np.exp(-d @ np.linalg.solve(both, d) / 8) / np.sqrt(ratio)
    return bound


def rows(quick: bool) -> list[dict[str, Any]]:
    """One record: seconds of both for 1,000 runs x 110 steps x 3 modes, their ratio, medians of interleaved repeats.

    Parameters
    ----------
    quick : fewer repeats, and fewer runs for the loop to be timed on

    The compiled time is that of the whole experiment on all cores, truths, noise and statistics included, and once more
    on one thread; the loop is timed on some runs and scaled, and is given its truths for nothing.
    """
    runs, sample, repeats = 1000, (5 if quick else 20), (3 if quick else 9)
    problem = replace(read_problem(PROBLEM), runs=runs)
    tried = experiment(problem, Scheduled())
    models = tried.models()
    given = run_some(tried, models, range(sample))  # compiles, too
    worst = 0.0
    fast, slow, single = [], [], []
    for _ in range(repeats):
        began = time.perf_counter()
        found = [plain_run(problem, given.truths.values[i]) for i in range(sample)]
        slow.append((time.perf_counter() - began) * runs / sample)
        began = time.perf_counter()
        monte_carlo(tried, runs)
        fast.append(time.perf_counter() - began)
        began = time.perf_counter()
        run_some(tried, models, range(runs))
        single.append(time.perf_counter() - began)
        for i, (estimates, choices) in enumerate(found):
            assert np.array_equal(choices, given.choices[i])
            worst = max(worst, float(np.max(np.abs(estimates - given.estimates[i]))))
    medians = {name: statistics.median(times) for name, times in (("fast", fast), ("slow", slow), ("single", single))}
    return [
        {
            "case": f"jumping modes: {runs} runs x {problem.steps} steps x {len(problem.plant.modes)} modes",
            "ours": "compiled, all runs together",
            "seconds": medians["fast"],
            "seconds_one_thread": medians["single"],
            "rival": "per-run Python loop of the same algorithm",
            "rival_seconds": medians["slow"],
            "ratio": statistics.median(s / f for s, f in zip(slow, fast, strict=True)),
            "ratio_one_thread": statistics.median(s / f for s, f in zip(slow, single, strict=True)),
            "repeats": repeats,
            "difference": worst,
        }
    ]


if __name__ == "__main__":
    for record in rows(quick=False):
        for key, value in record.items():
            print(f"{key:20} {value}")

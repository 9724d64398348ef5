"""Five targets and one radar: the best of all schedules, by sets of looks that no code of the package is asked about.

Targets are independent, so a schedule costs the sum of what each target costs with its own set of looks. All 4096 sets
are propagated for every target, and the cheapest way to share out the intervals follows by joining target after target.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from ruamel.yaml import YAML
from scipy.linalg import expm

from occontrol.api import read_problem, solve

FILE = Path(__file__).resolve().parents[4] / "problems" / "five_targets.yaml"
N, STEPS = 12, 32
A = np.array([[0, 1], [0, -0.2]])


def exact(P: np.ndarray, q: float, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """P (S, 2, 2) one minute later, and the integral of its first entry: the linear flow behind Riccati's equation."""
    H = np.block([[-A.T, np.diag([rate, 0])], [np.diag([0, q]), A]])
    nodes, shares = np.polynomial.legendre.leggauss(12)
    path = []
    for t in (*(nodes + 1) / 2, 1.0):
        E = expm(H * t)
        path.append((E[2:, :2] + E[2:, 2:] @ P) @ np.linalg.inv(E[:2, :2] + E[:2, 2:] @ P))
    return path[-1], np.tensordot(shares / 2, np.array(path)[:-1, :, 0, 0], 1)


def split(P: np.ndarray, q: float, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """The same by the recursion that result.json is of: half a prediction, a look, half a prediction, 32 times."""
    h, total = 1 / STEPS, 0.0
    E = expm(np.block([[-A, np.diag([0, q])], [np.zeros((2, 2)), A.T]]) * h / 2)
    F = E[2:, 2:].T
    Q = F @ E[:2, 2:]
    for _ in range(STEPS):
        before = F @ P @ F.T + Q
        after = np.linalg.inv(np.linalg.inv(before) + np.diag([rate * h, 0]))
        P, total = F @ after @ F.T + Q, total + h * (before[:, 0, 0] + after[:, 0, 0]) / 2
    return P, np.asarray(total)


def of_every_set(step, q: float, r: float, w: float, closed: int) -> np.ndarray:
    """(2^N,) cost of one target for every set of looks; bit k is the look on interval k."""
    P, J = np.diag([4.0, 1.0])[None], np.zeros(1)
    for k in range(N):
        (P0, J0), (P1, J1) = step(P, q, 0.0), step(P, q, 1 / r)
        P, J = np.concatenate([P0, P1]), np.concatenate([J + w * J0, J + w * J1 + (np.inf if k == closed else 0.0)])
    return J


@cache
def cheapest(step) -> float:
    table = YAML(typ="safe").load(FILE.read_text())["targets"][0]["table"]
    best = None
    for q, r, w in zip(table["q"], table["r"], table["w"], strict=True):
        own = of_every_set(step, q, r, w, closed=4)
        if best is None:
            best = own
            continue
        joined = np.full(1 << N, np.inf)
        for some in range(1 << N):  # looks of this target; what others have lies beside it
            rest = ((1 << N) - 1) & ~some
            beside = rest & np.arange(1 << N)
            at = np.flatnonzero(beside == np.arange(1 << N))
            np.minimum.at(joined, at | some, own[some] + best[at])
        best = joined
    return float(np.min(best))


@pytest.mark.slow
def test_the_best_schedule_is_found_and_proven_not_beaten() -> None:
    problem = read_problem(FILE)
    solution = solve(problem)
    result, expect = solution.result, problem.expect
    assert cheapest(split) == pytest.approx(expect["cost"], rel=1e-9)
    assert result["cost"] == pytest.approx(expect["cost"], rel=expect["tolerance"])
    assert result["lower_bound"] <= cheapest(split) * (1 + 1e-12)
    # in continuous time the same schedule costs what is the least there, too
    assert result["continuous"]["cost"] == pytest.approx(cheapest(exact), rel=1e-6)  # what its check allows itself

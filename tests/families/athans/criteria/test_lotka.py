"""Counting predators and prey without a prior: information by sensitivity equations of their own, solved by SciPy."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import occontrol as oc
from tests.families.athans.problem_texts import written

FILE = Path(__file__).parents[4] / "problems" / "lotka_design.yaml"
TIMES = 0.0025 + 0.005 * np.arange(2400)


@cache
def sensitivities() -> np.ndarray:
    """(2400, 2, 2) dx/dp at the middle of every cell, by the equations written out."""

    def slope(t: float, y: np.ndarray) -> np.ndarray:
        x1, x2 = y[:2]
        A = np.array([[1 - x2, -x1], [x2, x1 - 1]])
        S = A @ y[2:].reshape(2, 2) + np.diag([-x1 * x2, x1 * x2])
        return np.concatenate([[x1 - x1 * x2, x1 * x2 - x2], S.ravel()])

    start = np.concatenate([[0.5, 0.7], np.zeros(4)])
    return solve_ivp(slope, (0, 12), start, "DOP853", TIMES, rtol=1e-12, atol=1e-13).y[2:].T.reshape(-1, 2, 2)


def information(weights: np.ndarray) -> np.ndarray:
    """F of shares (2400, 2)."""
    G = sensitivities()
    return 0.005 * np.einsum("ki,kia,kib->ab", weights, G, G)


CASES = {
    "trace": (lambda X: np.trace(X), 0.06395592869, 0.06395592869),
    "logdet": (lambda X: np.log(np.linalg.det(X)), np.log(9.907860222617e-4), np.log(9.907860222617e-4)),
}
E = 0.0361893947, 0.0361930349


@pytest.mark.parametrize("name", CASES)
def test_a_d_and_e_optimal_counts(tmp_path: Path, name: str) -> None:
    value, low, high = CASES[name]
    pairs = ("output: [p2, p4]}", f"output: [p2, p4], criterion: {{name: {name}}}}}")
    solution = oc.solve(written(tmp_path, FILE.read_text(), pairs))
    r, v = solution.result, solution.arrays["weights"][:, :2]
    assert np.all(np.isin(v, [0.0, 1.0])) and v.sum(axis=0).tolist() == [800, 800]
    own = value(np.linalg.inv(information(v)))
    assert r["cost"] == pytest.approx(own, rel=1e-8)
    # the best shares, a little below the best schedule: no more than their own tangent may prove
    assert r["lower_bound"] <= high * (1 + np.sign(high) * 1e-9) and r["cost"] >= low - 1e-9 * abs(low)
    assert r["cost"] - r["lower_bound"] <= 1e-8
    assert "others_save_at_most" in r["equivalence"]
    if name == "trace":
        starts = [np.flatnonzero(np.diff(column, prepend=0) == 1) * 0.005 for column in v.T]
        assert starts[0] == pytest.approx([2.29, 9.13], abs=0.011)
        assert starts[1] == pytest.approx([2.9, 9.48], abs=0.011)
        everything = np.trace(np.linalg.inv(information(np.ones((2400, 2)))))
        assert everything == pytest.approx(0.0535286890, abs=6e-11)


def test_e_optimal_shares(tmp_path: Path) -> None:
    pairs = ("output: [p2, p4]}", "output: [p2, p4], criterion: {name: largest-eigenvalue}}"), ("1.0e-9", "5.0e-5")
    p = written(tmp_path, FILE.read_text(), *pairs)
    solution = oc.solve(p, "relaxed")
    r, v = solution.result, solution.arrays["weights"][:, :2]
    assert r["cost"] == pytest.approx(np.linalg.norm(np.linalg.inv(information(v)), 2), rel=1e-8)
    assert E[0] <= r["lower_bound"] <= E[1] and E[0] <= r["cost"] <= E[1] * (1 + 5e-5)
    assert r["cost"] - r["lower_bound"] <= 5e-5 * r["cost"]


WITH_PRIOR = "initial: {mean: [0.5, 0.7], covariance: {diag: [0.1, 0]}}"


def test_what_needs_a_prior_says_so(tmp_path: Path) -> None:
    text = FILE.read_text()
    few = ("{prey count: 800, predator count: 800}", "{prey count: 4, predator count: 4}")
    short = (("samples: 2400, first: 0.0025", "samples: 12, first: 0.5"), few)
    p = written(tmp_path, text, *short)
    solution = oc.solve(p, "greedy")
    assert oc.document(oc.read_problem(tmp_path / "x.yaml")) == oc.document(p)
    with pytest.raises(oc.UsageError, match="needs an initial covariance, and this problem has none"):
        oc.run_filter(p, solution, [])
    with pytest.raises(oc.ProblemError, match="nothing is known of 'p2', and something uncertain is known of the rest"):
        written(tmp_path, text, *short, ("initial: {mean: [0.5, 0.7], covariance: {diag: [0, 0]}}", WITH_PRIOR))
    with pytest.raises(oc.ProblemError, match="first belongs to samples"):
        written(tmp_path, text, ("samples: 2400, first: 0.0025", "sample_times: [1, 2, 3], first: 0.5"))

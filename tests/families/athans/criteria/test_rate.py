"""Criteria of continuous sensing: against an ordinary differential equation along every schedule of a few intervals."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import occontrol as oc
from tests.families.athans.problem_texts import written

TEXT = """\
family: athans
name: volume of a drift
horizon: {start: 0, end: 2, intervals: 4}
plant: {A: [[0, 1], ["-(1+0.2*sin(t))", -0.4]], noise: {diag: [0, 0.5]}, initial: {covariance: {diag: [2, 1]}}}
sensors:
  - {name: range, C: [[1, 0]], noise: [[0.1]], cost: 2.0}
  - {name: doppler, C: [[0, 1]], noise: [[0.4]], cost: 0.5}
  - idle
objective: {cost_weight: 0.1, output: [[1, 0], [0, 1]], criterion: {name: logdet}}
method: {name: schedule, relative_gap: 1.0e-3}
"""
VALUES = {
    "logdet": lambda X: np.log(np.linalg.det(X[-1])),
    "largest-eigenvalue": lambda X: np.linalg.norm(X[-1], 2),
    "schatten": lambda X: np.sum(np.linalg.eigvalsh(X[-1]) ** 4) ** 0.25,
    "log-trace": lambda X: np.log(np.trace(X[-1])),
    "peak, from: 1": lambda X: max(np.trace(S) for S in X[2:]),
}
SEEN = [np.diag([1 / 0.1, 0]), np.diag([0, 1 / 0.4]), np.zeros((2, 2))]
PRICE = [0.2, 0.05, 0.0]


def along(word: tuple[int, ...]) -> list[np.ndarray]:
    """Covariance at the edges."""
    S, found = np.diag([2.0, 1.0]), [np.diag([2.0, 1.0])]
    for k, j in enumerate(word):

        def slope(t: float, y: np.ndarray, j=j) -> np.ndarray:
            P, A = y.reshape(2, 2), np.array([[0, 1], [-(1 + 0.2 * np.sin(t)), -0.4]])
            return (A @ P + P @ A.T + np.diag([0, 0.5]) - P @ SEEN[j] @ P).ravel()

        S = solve_ivp(slope, (k / 2, (k + 1) / 2), S.ravel(), rtol=1e-10, atol=1e-12).y[:, -1].reshape(2, 2)
        found.append(S)
    return found


@pytest.fixture(scope="module")
def every() -> dict[tuple[int, ...], list[np.ndarray]]:
    """The covariances of all schedules."""
    known: dict[tuple[int, ...], np.ndarray] = {}
    return {word: along(word) for word in itertools.product(range(3), repeat=4)} | known  # type: ignore[return-value]


@pytest.mark.parametrize("name", VALUES)
def test_costs_and_bounds_against_all_schedules(tmp_path: Path, every: dict, name: str) -> None:
    s = oc.solve(written(tmp_path, TEXT, ("logdet", name)))
    r = s.result
    costs = {w: 0.5 * sum(PRICE[j] for j in w) + VALUES[name](X) for w, X in every.items()}
    word = tuple(int(j) for j in np.argmax(s.arrays["weights"], axis=1))
    best = min(costs.values())
    assert s.status in ("certified", "feasible")
    assert r["continuous"]["cost"] == pytest.approx(costs[word], rel=1e-7, abs=1e-7)
    assert r["cost"] == pytest.approx(costs[word], rel=3e-4, abs=3e-4)  # the steps are as fine as that
    assert max(r["lower_bound"], r["relaxed_lower_bound"]) <= best + 3e-4 * (1 + abs(best))
    assert r["cost"] <= best + 3e-4 * (1 + abs(best))
    if name.startswith("peak"):
        assert r["top"]["of"] == "grid" and r["continuous"]["lower_bound"] is None
    else:
        assert r["top"]["of"] == "continuous" and r["continuous"]["lower_bound"] <= best + 1e-9 * (1 + abs(best))
        assert r["continuous"]["lower_bound"] >= best - 0.2 * (1 + abs(best))
    absolute = name in ("logdet", "log-trace")
    size = 1.0 if absolute else abs(r["cost"])
    assert r["relative_gap"] == pytest.approx((r["cost"] - r["lower_bound"]) / size, rel=1e-9, abs=1e-15)


def test_a_limit_certify_and_the_words(tmp_path: Path, every: dict) -> None:
    peaks = {w: max(np.trace(X) for X in S[2:]) for w, S in every.items()}
    limit = float(np.quantile(list(peaks.values()), 0.2))
    p = written(tmp_path, TEXT, ("{name: logdet}", f"{{name: peak, from: 1, limit: {limit}}}"))
    r = oc.solve(p).result
    cheapest = min(0.5 * sum(PRICE[j] for j in w) for w, peak in peaks.items() if peak <= limit * (1 - 1e-3))
    assert r["cost"] <= cheapest + 1e-9 and r["criterion"] <= limit * (1 + 1e-8)
    low = written(tmp_path, TEXT, ("{name: logdet}", "{name: peak, from: 1, limit: 0.01}"))
    with pytest.raises(oc.InfeasibleError, match="least peak is"):
        oc.solve(low)
    p = written(tmp_path, TEXT)
    s = oc.solve(p, "round-robin")
    judged = oc.certify(p, s.schedule)
    assert judged.result["cost"] == pytest.approx(s.result["cost"], rel=1e-9)
    path = tmp_path / "again.json"
    path.write_text(json.dumps(oc.document(p)))
    assert oc.document(oc.read_problem(path)) == oc.document(p)
    with pytest.raises(oc.UsageError, match="collocation does not do criteria"):
        oc.solve(p, "collocation")
    ruled = written(tmp_path, TEXT, ("relative_gap: 1.0e-3", "off_grid: true"), more="constraints: {max_switches: 2}\n")
    with pytest.raises(oc.UsageError, match="off_grid does not do criteria"):
        oc.solve(ruled)
    with pytest.raises(oc.ProblemError, match="a rate has no before and after"):
        written(tmp_path, TEXT, ("{name: logdet}", "{name: peak, at: prior}"))

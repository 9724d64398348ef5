"""Continuous sensing without a prior: known optima, enumeration, a convex solver, readings as intervals shrink."""

from __future__ import annotations

import json
from pathlib import Path

import cvxpy as cp
import numpy as np
import pytest

import occontrol as oc
from occontrol.api import figures_of
from occontrol.core.errors import InfeasibleError
from tests.families.athans.problem_texts import written
from tests.plain_design import BlindRules, blind_document, random_experiment

DECAY = """
family: athans
name: three parameters of a decay
horizon: {start: 0, end: 6, intervals: 12}
plant:
  A: [[0, 0, 0], [0, 0, 0], [0, 0, 0]]
  noise: {diag: [0, 0, 0]}
  initial: {mean: [0.5, 3, 2], covariance: none}
sensors:
  - {name: near, C: [["-2*t*exp(-0.5*t)", "2*t*exp(-3*t)", "exp(-0.5*t) - exp(-3*t)"]], noise: 0.02, cost: 0.3}
  - {name: far, C: [["t*exp(-0.7*t)", 0, "exp(-0.7*t)"]], noise: 0.01, cost: 0.1}
  - idle
objective: {output: {identity: 3}, criterion: {name: logdet}}
"""
TOY = """
family: athans
name: when to watch an exponential
horizon: {start: 0, end: 1, intervals: 10}
plant: {A: [[0]], noise: [[0]], initial: {mean: [-2], covariance: none}}
sensors:
  - {name: watch, C: [["t*exp(-2*t)"]], noise: 1, max_time: 0.2}
  - idle
objective: {output: [[1]]}
method: {name: schedule, exact: true}
"""


def problem_of(tmp_path: Path, document: dict) -> oc.SchedulingProblem:
    path = tmp_path / "x.json"
    path.write_text(json.dumps(document))
    return oc.read_problem(path)  # type: ignore[return-value]


def decay(tmp_path: Path, name: str, *changes: tuple[str, str], more: str = "") -> oc.SchedulingProblem:
    return written(tmp_path, DECAY, ("logdet", name), *changes, more=more)  # type: ignore[return-value]


@pytest.mark.parametrize(("rate", "known"), [(-2, 149.7778538201801), (-0.5, 15.207367203002965)])
def test_a_fifth_of_the_time_to_watch_an_exponential(tmp_path: Path, rate: float, known: float) -> None:
    """The interval's information is exact, so the known optimum of ten cells is met to its digits."""
    r = oc.solve(written(tmp_path, TOY, ("exp(-2*t)", f"exp({rate}*t)"))).result
    assert r["cost"] == pytest.approx(known, rel=1e-12) and r["proven_optimal"]
    assert r["lower_bound"] <= known * (1 + 1e-12) and r["constraints"]["active"] == ["max_time of sensor 'watch'"]


@pytest.mark.parametrize(("seed", "ruled"), [(0, True), (1, True), (3, True), (20, False), (23, False), (31, False)])
def test_no_schedule_is_better_than_the_one_that_is_proven(tmp_path: Path, seed: int, ruled: bool) -> None:
    e = random_experiment(seed, 5, ruled)
    best, count = e.optimum()
    p = problem_of(tmp_path, e.document)
    if not count:
        with pytest.raises(InfeasibleError):
            oc.solve(p)
        return
    s = oc.solve(p)
    size = max(1.0, abs(best))
    assert s.result["cost"] == pytest.approx(best, abs=1e-6 * size) and s.result["proven_optimal"]
    assert best - 2e-6 * size <= s.result["lower_bound"] <= best + 1e-9 * size
    assert oc.certify(p, s.schedule).cost == pytest.approx(s.cost, rel=1e-9)


@pytest.mark.parametrize("seed", [0, 2, 3])
def test_rules_on_readings_without_a_prior(tmp_path: Path, seed: int) -> None:
    document = blind_document(np.random.default_rng((seed, 31)), 5)
    document["method"] = {"name": "schedule", "exact": True}
    judge = BlindRules(document)
    best = min((judge.value(s) for s in judge.plain.schedules() if judge.keeps(s)), default=np.inf)
    p = problem_of(tmp_path, document)
    if np.isinf(best):
        with pytest.raises(InfeasibleError):
            oc.solve(p)
        return
    s = oc.solve(p)
    assert s.result["cost"] == pytest.approx(best, abs=1e-6 * max(1, abs(best))) and s.result["proven_optimal"]
    assert s.result["lower_bound"] <= best + 1e-9 * max(1, abs(best))
    assert oc.certify(p, s.schedule).cost == pytest.approx(s.cost, rel=1e-9)


def quadrature(count: int = 4000) -> tuple[np.ndarray, np.ndarray]:
    """Information (12, 2, 3, 3) and prices (12, 2) of DECAY's intervals by the trapezoidal rule, refined once."""

    def trapezoid(parts: int) -> np.ndarray:
        t = np.linspace(0, 6, 12 * parts + 1)
        near = np.stack([-2 * t * np.exp(-0.5 * t), 2 * t * np.exp(-3 * t), np.exp(-0.5 * t) - np.exp(-3 * t)], axis=1)
        far = np.stack([t * np.exp(-0.7 * t), 0 * t, np.exp(-0.7 * t)], axis=1)
        found = []
        for rows, theta in ((near, 0.02), (far, 0.01)):
            L = np.einsum("ti,tj->tij", rows, rows) / theta * (t[1] - t[0])
            ends = L.reshape(-1, 3, 3)
            inner = np.stack([ends[k * parts : (k + 1) * parts + 1] for k in range(12)])
            found.append(np.sum(inner, axis=1) - (inner[:, 0] + inner[:, -1]) / 2)
        return np.stack(found, axis=1)

    coarse, fine = trapezoid(count // 2), trapezoid(count)
    return (4 * fine - coarse) / 3, np.tile([0.3 * 0.5, 0.1 * 0.5], (12, 1))


@pytest.mark.parametrize("name", ["trace", "logdet", "largest-eigenvalue"])
def test_shares_are_those_of_a_convex_solver(tmp_path: Path, name: str) -> None:
    """The continuous design by Newton's method against cvxpy, whose bound is that of the dual."""
    L, prices = quadrature()
    s = oc.solve(decay(tmp_path, name, more="method: {name: relaxed, relative_gap: 1.0e-7}\n"))
    v = cp.Variable((12, 2), nonneg=True)
    F = sum(v[k, j] * (L[k, j] + L[k, j].T) / 2 for k in range(12) for j in range(2))
    value = {"trace": cp.tr_inv(F), "logdet": -cp.log_det(F), "largest-eigenvalue": cp.inv_pos(cp.lambda_min(F))}[name]
    problem = cp.Problem(cp.Minimize(cp.sum(cp.multiply(prices, v)) + value), [cp.sum(v, axis=1) <= 1])
    best = problem.solve(solver=cp.CLARABEL)
    size = max(1.0, abs(best))
    assert s.result["cost"] == pytest.approx(best, abs=1e-6 * size)
    assert best - 2e-6 * size <= s.result["lower_bound"] <= best + 1e-7 * size
    assert s.result["equivalence"]["excess"] <= 2e-6 * size  # the General Equivalence Theorem, interval by interval
    own = np.einsum("kj,kjab->ab", s.arrays["weights"][:, :2], L)
    np.testing.assert_allclose(s.arrays["information"][-1], own, rtol=1e-8)
    np.testing.assert_allclose(np.linalg.inv(own), s.arrays["covariance"][-1], rtol=1e-6)


def test_the_bound_holds_whenever_a_schedule_changes(tmp_path: Path) -> None:
    """On a grid four times as fine cheaper schedules appear, none below the coarse grid's bound for any change."""
    relaxed = "method: {name: relaxed, relative_gap: 1.0e-7}\n"
    coarse = oc.solve(decay(tmp_path, "trace", more=relaxed)).result
    fine = oc.solve(decay(tmp_path, "trace", ("intervals: 12", "intervals: 96"), more=relaxed)).result
    assert coarse["top"]["of"] == "continuous" and coarse["cost"] > fine["cost"] > coarse["top"]["lower_bound"]
    assert fine["top"]["lower_bound"] > coarse["top"]["lower_bound"]
    assert fine["top"]["relative_gap"] < 0.2 * coarse["top"]["relative_gap"]


def test_many_readings_are_continuous_sensing(tmp_path: Path) -> None:
    """A reading of variance Theta/h in the middle of every step of h: the cost differs by h^2."""
    apart = []
    for count in (24, 48):
        h = 6 / count
        p = decay(tmp_path, "trace", ("intervals: 12", f"intervals: {count}"), more="method: {name: relaxed}\n")
        shares = oc.solve(p, oc.athans.BestSingle()).schedule
        assert shares is not None
        text = DECAY.replace("logdet", "trace").replace("intervals: 12", f"samples: {count}, first: {h / 2}")
        text = text.replace("\nplant:", "\nsensing: samples\nplant:").replace("noise: 0.02", f"variance: {0.02 / h}")
        text = text.replace("noise: 0.01", f"variance: {0.01 / h}").replace("cost: 0.3", f"cost: {0.3 * h}")
        q = written(tmp_path, text.replace("cost: 0.1}", f"cost: {0.1 * h}}}"))
        read = oc.certify(q, q.make_schedule(q.edges, shares.weights))
        apart.append(abs(read.cost - oc.certify(p, shares).cost) / read.cost)
    assert apart[1] < 0.3 * apart[0] and apart[0] < 3e-2


def test_parameters_of_a_formula(tmp_path: Path) -> None:
    """Predators and prey, each counted for four of twelve units of time, close to the known optimum of fine cells."""
    text = """
family: athans
name: counting for a while
horizon: {start: 0, end: 12, intervals: 60}
plant:
  states: [prey, predators]
  f: ["prey - p2*prey*predators", "-predators + p4*prey*predators"]
  parameters: {p2: {mean: 1, sd: none}, p4: {mean: 1, sd: none}}
  noise: {diag: [0, 0]}
  initial: {mean: [0.5, 0.7], covariance: {diag: [0, 0]}}
sensors:
  - {name: prey count, h: [prey], noise: 1, max_time: 4}
  - {name: predator count, h: [predators], noise: 1, max_time: 4}
select: 0..2
objective: {output: [p2, p4]}
"""
    p = written(tmp_path, text)
    s = oc.solve(p)
    assert p.prior is False and s.result["certificate_of"] == "linearised"
    assert s.result["cost"] == pytest.approx(0.06395592869, rel=4e-3)
    assert 0.0638 < s.result["lower_bound"] <= s.result["cost"]


def test_a_run_is_written_and_read_and_drawn(tmp_path: Path) -> None:
    more = "constraints: {min_on: 1.0, max_switches: 4, switch_cost: 0.01}\n"
    p = decay(tmp_path, "schatten", ("cost: 0.3}", "cost: 0.3, warm_up: 0.5}"), more=more)
    s = oc.solve(p)
    oc.write_run(tmp_path / "run", p, s)
    again, read = oc.read_run(tmp_path / "run")
    assert again.prior is False and oc.document(again) == oc.document(p)
    judged = oc.certify(again, read.schedule)
    assert judged.result["cost"] == pytest.approx(s.result["cost"], rel=1e-12)
    drawn = figures_of(p, s)
    assert {"overview", "schedule", "sensitivity", "deviations", "rules"} <= set(drawn)
    known = np.isfinite(s.arrays["covariance"][:, 0, 0])
    assert not known[0] and known[-1]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("noise: {diag: [0, 0, 0]}", "noise: {diag: [0, 1, 0]}"), "without a prior the plant has no noise"),
        (("criterion: {name: logdet}", "criterion: {name: peak}"), "a peak is infinite before"),
        (("output: {identity: 3},", "output: {identity: 3}, running: {identity: 3},"), "a running weight is infinite"),
        (("objective:", "constraints: {max_error: 3}\nobjective:"), "a cap on the error is searched with a prior only"),
    ],
)
def test_what_goes_without_a_prior_and_what_does_not(tmp_path: Path, change: tuple[str, str], words: str) -> None:
    with pytest.raises(oc.ProblemError, match=words):
        trace = DECAY.replace(", criterion: {name: logdet}", "")
        written(tmp_path, trace if "max_error" in change[1] else DECAY, change)


def test_what_needs_a_prior_says_so(tmp_path: Path) -> None:
    p = decay(tmp_path, "trace")
    s = oc.solve(p, "greedy")
    for refused in (lambda: oc.simulate(p, s), lambda: oc.tradeoff(p, [1.0]), lambda: oc.run_filter(p, s, [])):
        with pytest.raises(oc.UsageError, match="needs an initial covariance"):
            refused()
    for method in ("collocation", oc.athans.RelaxRoundPolish(off_grid=True)):
        with pytest.raises(oc.UsageError, match=r"collocation does not do|off_grid needs"):
            oc.solve(p, method)


def test_directions_that_no_sensor_sees(tmp_path: Path) -> None:
    blind = ('"exp(-0.5*t) - exp(-3*t)"', '"4*t*exp(-3*t)"')
    text = "\n".join(line for line in DECAY.splitlines() if "far" not in line)
    with pytest.raises(InfeasibleError, match=r"no schedule sees the direction x2 - 0\.5 x3 of the states"):
        oc.solve(written(tmp_path, text, blind))

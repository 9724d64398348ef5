"""Plans flown on simulated runs, in every family that simulates: their errors are those that the plans predict."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

import occontrol as oc
from occontrol.core.errors import UsageError
from occontrol.core.monitor import Monitor
from occontrol.families import flights
from occontrol.families.abilities import Ability
from occontrol.families.athans.replanning.continuous import charged

PROBLEMS = Path(__file__).resolve().parents[2] / "problems"
RATE = """\
family: athans
name: two states
horizon: {start: 0, end: 4, intervals: 40, predict_at: 4.5}
plant: {A: [[-0.3, 1], [0, -0.1]], noise: {diag: [0.2, 0.1]}, initial: {mean: [1, 2], covariance: {diag: [2, 1]}}}
sensors:
  - {name: fine, C: [[1, 0]], noise: [[0.2]], cost: 0.4}
  - {name: slow, C: [[0, 1]], noise: [[0.1]], cost: 0.3}
  - idle
objective: {cost_weight: 0.1, output: [[1, 0.5]], running: {diag: [0.5, 0.2]}}
"""


def flown(path: Path, names: list[str] | None, runs: int, **more):
    """The comparison of a problem file, its nominal plan and its family."""
    problem = oc.read_problem(path)
    solution, family = oc.solve(problem), oc.api.family_of(problem)
    return family.monte_carlo(solution.problem, solution, names, runs, 3, Monitor(), **more), solution, family


@pytest.fixture(scope="module")
def rate(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("rate") / "rate.yaml"
    path.write_text(RATE, encoding="utf-8")
    return path


def test_continuous_sensing_costs_what_the_plan_says(rate: Path) -> None:
    found, solution, _ = flown(rate, ["nominal", "round-robin"], 150)
    row = found.policies["nominal"]
    assert found.judged == "cost" and found.runs <= 150
    assert abs(row["cost"] - solution.cost) < 4 * row["standard_error"] + 0.01 * solution.cost
    other = oc.solve(solution.problem, "round-robin")
    expected, row = other.cost - solution.cost, found.policies["round-robin"]
    assert abs(row["difference"] - expected) < 4 * row["difference_error"] + 0.01 * solution.cost
    # squared errors of a filter that knows its covariance: chi-square with two degrees of freedom, correlated in time
    assert abs(found.policies["nominal"]["nees"] - 1.0) < 0.1


def test_numbers_do_not_depend_on_batches_or_on_who_does_them(rate: Path) -> None:
    problem = oc.read_problem(rate)
    solution, family = oc.solve(problem), oc.api.family_of(problem)

    def one_by_one(names, pieces):
        for piece in pieces:
            yield from [family.monte_carlo_batch(solution.problem, solution, names, [seed]) for seed in piece]

    names = ["nominal", "random"]
    whole = family.monte_carlo(solution.problem, solution, names, 7, 3, Monitor())
    split = family.monte_carlo(solution.problem, solution, names, 7, 3, Monitor(), one_by_one)
    for name in names:
        a, b = ({k: v for k, v in found.policies[name].items() if k != "milliseconds"} for found in (whole, split))
        assert a == b


@pytest.mark.parametrize(
    ("file", "runs", "policies"),
    [
        ("oshman_example", 3, ["nominal", "round-robin", "fixed:one"]),
        ("turning_target", 4, ["nominal", "alternate"]),
        ("lorenz96_enkf", 4, ["nominal", "uniform"]),
        ("robust_oscillator", 2, ["nominal", "best-single"]),
    ],
)
def test_every_family_that_simulates_compares_its_methods(file: str, runs: int, policies: list[str]) -> None:
    found, solution, family = flown(PROBLEMS / f"{file}.yaml", policies, runs)
    assert family.can(Ability.CLOSED_LOOP) and found.runs == runs and list(found.policies) == policies
    for row in found.policies.values():
        assert np.isfinite(row["mean"]) and row["readings"] > 0 and row["diverged"] <= 1
    assert found.judged == "error" and ("error than" in found.verdict or "difference" in found.verdict)
    # one run by hand: the first seed's truth and readings, filtered, judged
    seed = int(np.random.SeedSequence(3).spawn(runs)[0].generate_state(1, np.uint64)[0] >> np.uint64(1))
    measurements, truth = oc.simulate(solution.problem, solution, seed)
    estimate = oc.run_filter(solution.problem, solution, measurements)
    by_time = {t: x for t, x in zip(truth.times, truth.values, strict=True)}
    mean = np.mean([np.sum((by_time[t] - m) ** 2) for t, m in zip(estimate.times, estimate.mean, strict=True)])
    outcomes, _ = family.monte_carlo_batch(solution.problem, solution, ["nominal"], np.random.SeedSequence(3).spawn(1))
    assert outcomes["nominal"].error[0] == pytest.approx(mean, rel=1e-12)


def test_a_filter_that_knows_its_covariance_is_consistent() -> None:
    found, _, _ = flown(PROBLEMS / "oshman_example.yaml", ["nominal"], 20)
    assert abs(found.policies["nominal"]["nees"] - 1) < 0.15 and abs(found.policies["nominal"]["nis"] - 1) < 0.1


def test_all_that_can_be_flown_is_flown_and_shares_are_not(rate: Path) -> None:
    found, _, family = flown(rate, None, 2)
    assert next(iter(found.policies)) == "nominal" and "relaxed" not in found.policies and "greedy" in found.policies
    with pytest.raises(UsageError, match="no method"):
        flights.policies_of(family, oc.read_problem(rate), ["nominal", "roundrobin"])


def test_what_is_known_exactly_and_other_units_do_not_matter() -> None:
    g = np.random.default_rng(5)
    root = g.standard_normal((4, 3, 3))
    P, e = root @ np.swapaxes(root, 1, 2), g.standard_normal((4, 3))
    expected = [x @ np.linalg.solve(S, x) for x, S in zip(e, P, strict=True)]
    assert flights.normalised(e, P) == pytest.approx(expected, rel=1e-9)
    units = np.array([1e-6, 1.0, 1e7])
    assert flights.normalised(e * units, P * np.outer(units, units)) == pytest.approx(expected, rel=1e-7)
    P[:, 2], P[:, :, 2] = 0.0, 0.0
    expected = [x[:2] @ np.linalg.solve(S[:2, :2], x[:2]) for x, S in zip(e, P, strict=True)]
    assert flights.normalised(e, P) == pytest.approx(expected, rel=1e-9)


def test_an_error_is_charged_as_the_objective_charges_it(rate: Path) -> None:
    problem = oc.read_problem(rate)
    error = np.random.default_rng(1).standard_normal((len(problem.edges), 2))
    A, D, R = np.array([[-0.3, 1.0], [0.0, -0.1]]), np.array([1.0, 0.5]), np.array([0.5, 0.2])
    ahead = D @ expm(A * 0.5) @ error[-1]  # predict_at lies half a unit behind the end
    along = np.sum(R * error**2, axis=1)
    expected = ahead**2 + np.sum((along[1:] + along[:-1]) / 2) * 0.1
    assert charged(problem, error, problem.edges) == pytest.approx(expected, rel=1e-9)

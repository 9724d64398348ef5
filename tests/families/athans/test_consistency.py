"""NIS and NEES of every shipped problem against the continuous plant, their order in h, and a wrong gain caught."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from ruamel.yaml import YAML
from scipy.stats import chi2

import occontrol
from occontrol.core.schedule import Schedule
from occontrol.families.athans.filter.consistency import expected_nees, monte_carlo
from occontrol.families.athans.filter.kalman_bucy import run_filter
from occontrol.families.athans.filter.online import Plan, make_plan
from occontrol.families.athans.filter.planned import default_model
from occontrol.families.athans.filter.sampled_model import exact_model, split_model
from occontrol.families.athans.filter.simulate import simulate
from occontrol.numerics.consistency import average_band, judge_run, nees
from tests.families.athans.scheduling_cases import blocks, cycling, moving

PROBLEMS = Path(__file__).resolve().parents[3] / "problems"
FILES = {path.stem: YAML(typ="safe").load(path.read_text(encoding="utf-8")) for path in PROBLEMS.glob("*.yaml")}
READINGS = [n for n, d in FILES.items() if "steps" in d.get("horizon", {}) or d.get("sensing") == "samples"]
RULED = [n for n, d in FILES.items() if "constraints" in d or "targets" in d]
ATHANS = sorted({n for n, d in FILES.items() if d["family"] == "athans"} - {*READINGS, *RULED})
SEEDS = range(1000, 1100)  # fixed: of all the averages below, each to lie in a 99 % band, chance alone throws some out


def inside(value, band):
    return band[0] <= value <= band[1]


def assert_consistent(found):
    """Averages over the runs: NIS over all samples; NEES at the end, and over time (whose own band is narrower)."""
    assert inside(found.average_nis, found.nis_band), (found.average_nis, found.nis_band)
    assert inside(found.average_nees[-1], found.nees_band), (found.average_nees[-1], found.nees_band)
    assert inside(np.mean(found.average_nees), found.nees_band)
    assert found.nees_inside > 0.9


def test_there_are_problems_to_test():
    assert len(ATHANS) >= 7 and "tracking_network" in ATHANS


@pytest.mark.slow
@pytest.mark.parametrize("name", ATHANS)
def test_the_shipped_problem_is_consistent_with_the_continuous_plant(name, solved):
    solution = solved(name)
    problem, schedule = solution.problem, solution.schedule
    # with several steps an interval the exact model is the filter that is exported with the schedule
    own = {"split": (split_model, "covariance"), "exact": (exact_model, "filter_covariance")}
    model, name_of_array = own[default_model(solution.result)]
    plan, stored = make_plan(model(problem, schedule)), solution.arrays[name_of_array]
    scale = np.max(np.abs(stored), axis=(1, 2), keepdims=True)
    assert np.max(np.abs(plan.covariance - stored) / scale) < 1e-10
    for model in ("split", "exact"):
        assert_consistent(monte_carlo(problem, schedule, SEEDS, model))
    # and without any luck of the draw
    expected = expected_nees(problem, schedule)
    assert np.max(np.abs(expected - 1)) < 0.15 and abs(np.mean(expected) - 1) < 0.05


@pytest.mark.slow
@pytest.mark.parametrize("name", ATHANS)
def test_the_exact_model_is_consistent_at_five_intervals_too(name):
    problem = occontrol.read_problem(PROBLEMS / f"{name}.yaml")
    if any(s.windows for s in problem.sensors):
        # one interval per pass, and idle between them
        spans = sorted({w for s in problem.sensors for w in s.windows or ()})[:5]
        edges = np.unique([problem.edges[0], *np.ravel(spans), problem.edges[-1]])
        weights = np.zeros((len(edges) - 1, len(problem.sensors)))
        for k, (a, b) in enumerate(pairwise(edges)):
            weights[k, next(j for j, s in enumerate(problem.sensors) if s.available(a, b))] = 1
        schedule = Schedule(edges, weights, tuple(problem.sensors.names))
        problem = replace(problem, edges=edges)  # that ends with the fifth pass
        assert np.sum(weights[:, :-1]) == 5
    else:
        schedule = blocks(problem, np.linspace(problem.edges[0], problem.edges[-1], 6), 5)
    assert_consistent(monte_carlo(problem, schedule, SEEDS, "exact"))
    np.testing.assert_allclose(expected_nees(problem, schedule, "exact"), 1, atol=1e-6)


@pytest.mark.parametrize("name", ["attitude_telemetry", "survey_panel", "scalar_on_off"])
def test_the_split_filters_inconsistency_falls_as_h_squared(name):
    problem = occontrol.read_problem(PROBLEMS / f"{name}.yaml")
    excess = []
    for intervals in (80, 160, 320):
        edges = np.linspace(problem.edges[0], problem.edges[-1], intervals + 1)
        excess.append(abs(expected_nees(problem, blocks(problem, edges, 5))[-1] - 1))
    assert excess[-1] > 1e-7
    assert excess[0] / excess[1] == pytest.approx(4, rel=0.1) and excess[1] / excess[2] == pytest.approx(4, rel=0.05)


def test_at_five_intervals_and_a_wide_start_the_split_filter_fails_and_the_exact_one_does_not():
    problem = moving(5)
    problem = replace(problem, plant=replace(problem.plant, covariance=[[250.0, 0], [0, 250.0]]))
    schedule = blocks(problem, problem.edges, 3)
    assert np.max(expected_nees(problem, schedule)) > 1.5
    found = monte_carlo(problem, schedule, SEEDS, "split")
    assert not inside(np.max(found.average_nees), found.nees_band)
    assert_consistent(monte_carlo(problem, schedule, SEEDS, "exact"))


def test_expected_nees_is_what_simulation_finds():
    """Mean of 4000 runs against the recursion for its expectation, where that is far from 1."""
    problem = moving(5)
    problem = replace(problem, plant=replace(problem.plant, covariance=[[250.0, 0], [0, 250.0]]))
    schedule = blocks(problem, problem.edges, 3)
    expected = expected_nees(problem, schedule)
    found = monte_carlo(problem, schedule, range(4000), "split")
    spread = np.std(found.nees, axis=0) / 2 / np.sqrt(4000)
    assert np.max(np.abs(expected - 1)) > 10 * np.max(spread)
    assert np.all(np.abs(found.average_nees - expected) < 4.5 * spread)


@pytest.mark.parametrize(("factor", "caught"), [(1.0, False), (2.0, True), (0.4, True)])
def test_a_wrong_gain_is_caught_by_the_nees(factor, caught):
    problem = moving(60)
    schedule = cycling(problem)
    plan = make_plan(split_model(problem, schedule))
    wrong = Plan([factor * gain for gain in plan.gain], plan.innovation_root, plan.root)
    found = monte_carlo(problem, schedule, SEEDS, plan=wrong)
    assert inside(np.mean(found.average_nees), found.nees_band) is not caught
    assert (found.nees_inside > 0.9) is not caught


def test_data_of_the_split_model_are_exactly_consistent_with_it_on_any_grid():
    problem = moving(5)
    schedule = cycling(problem)
    found = monte_carlo(problem, schedule, range(400), truth=split_model(problem, schedule))
    assert_consistent(found)


def test_many_runs_at_once_are_the_runs_one_by_one():
    problem = moving(15, select=2)
    schedule = cycling(problem)
    together = monte_carlo(problem, schedule, [4, 9])
    for i, seed in enumerate((4, 9)):
        measurements, truth = simulate(problem, schedule, seed)
        alone = judge_run(run_filter(problem, schedule, measurements), truth)
        np.testing.assert_allclose(together.nees[i], alone.nees[0], rtol=1e-9)
        np.testing.assert_allclose(together.nis[i], alone.nis[0], rtol=1e-9)


def test_the_filters_report_has_nis_and_its_band():
    problem = moving(30)
    schedule = cycling(problem)
    measurements, _ = simulate(problem, schedule, 2)
    estimate = run_filter(problem, schedule, measurements)
    values = int(np.sum(estimate.dimension))
    low, high = average_band(values)
    assert f"{np.nansum(estimate.nis) / values:.4g} per value" in estimate.notes[-1]
    assert f"inside its 99 % band [{low:.4g}, {high:.4g}]" in estimate.notes[-1]
    shouted = [replace(m, values=m.values + 5) for m in measurements]
    assert "OUTSIDE" in " ".join(run_filter(problem, schedule, shouted).notes)


def test_bands_and_singular_covariances():
    low, high = average_band(100)
    assert chi2.cdf(100 * high, 100) - chi2.cdf(100 * low, 100) == pytest.approx(0.99)
    P = np.array([[4.0, 2, 0], [2, 1, 0], [0, 0, 0]])  # rank 1
    value, degrees = nees(np.array([[2.0, 1, 0]]), np.zeros((1, 3)), P[None])
    assert degrees[0] == 1 and value[0] == pytest.approx(1.0)

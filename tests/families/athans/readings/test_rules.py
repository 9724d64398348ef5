"""Rules on readings: against enumeration, and from the file to the filter."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pytest

import occontrol as oc
from scripts.campaign_ruled_readings import judged, wrong
from tests.families.athans.problem_texts import written
from tests.plain_readings import random_document
from tests.plain_rules_of_readings import with_rules

STEPS = """\
family: athans
name: rules in steps
horizon: {steps: 8}
plant: {F: [[1, 0.5], [0, 0.9]], Q: {diag: [0.0, 0.5]}, initial: {covariance: {diag: [5, 5]}}}
sensors:
  - {name: radar, H: [[1, 0]], R: [[0.1]], cost: 0.5}
  - {name: sonar, H: [[0, 1]], R: [[0.2]], cost: 0.2}
  - idle
objective: {cost_weight: 0.1, output: [[1, 0]], running: {diag: [0.1, 0]}}
method: {name: schedule, exact: true}
"""
SAMPLES = """\
family: athans
name: rules on samples
horizon: {start: 0, end: 4, sample_times: [0.5, 1, 1.5, 2, 3, 4]}
sensing: samples
plant: {A: [[0, 1], [-1, -0.4]], noise: {diag: [0.0, 0.5]}, initial: {covariance: {diag: [5, 5]}}}
sensors:
  - {name: radar, C: [[1, 0]], noise: [[0.1]], cost: 0.5}
  - {name: sonar, C: [[0, 1]], noise: [[0.2]], cost: 0.2}
objective: {cost_weight: 0.1, output: [[1, 0]]}
method: {name: schedule, exact: true}
"""


@pytest.mark.parametrize("seed", range(8))
def test_the_optimum_of_enumeration_is_found_and_proven(seed: int) -> None:
    rng, found = np.random.default_rng(100 + seed), []
    while len(found) < 2:
        result = judged(with_rules(rng, random_document(rng, 5)), most=300)
        found += [] if result is None else [result]
    assert not any(map(wrong, found)), found


def test_max_uses_counts_readings_and_is_named_with_the_time(tmp_path: Path) -> None:
    p = written(tmp_path, SAMPLES, ("cost: 0.5}", "cost: 0, max_uses: 2}"))
    solution = oc.solve(p)
    r = solution.result
    assert solution.arrays["weights"][:, 0].sum() == 2 and r["proven_optimal"]
    assert r["constraints"]["active"] == ["max_uses of sensor 'radar'"]
    assert r["multipliers"]["max_uses of sensor 'radar'"] > 0
    with pytest.raises(oc.ProblemError) as error:
        oc.certify(p, p.make_schedule(p.edges, np.array([[1, 0]] * 3 + [[0, 1]] * 3, dtype=float)))
    assert "sensor 'radar' gives 3 readings, max_uses is 2" in str(error.value)


def test_a_document_with_rules_is_read_back_and_its_run_is_certified(tmp_path: Path) -> None:
    limits = "constraints: {max_switches: 2, switch_cost: 0.01, min_off: 2, after: enforce}\n"
    p = written(tmp_path, STEPS, ("cost: 0.5}", "cost: 0.5, min_on: 2, max_time: 4}"), more=limits)
    assert oc.document(p)["constraints"]["max_switches"] == 2
    solution = oc.solve(p)
    oc.write_run(tmp_path / "run", p, solution)
    again, read = oc.read_run(tmp_path / "run")
    assert oc.document(again) == oc.document(p)
    judgement = oc.certify(again, read.schedule)
    assert judgement.cost == pytest.approx(solution.cost, rel=1e-12)
    assert judgement.certificate.lower_bound <= solution.cost * (1 + 1e-9)
    r = solution.result
    # the plain filter has checked the cost with its changes, or the status would be another
    assert str(solution.status) == str(judgement.status) == "certified" and r["switching_cost"] == 0.02
    parts = 0.1 * r["observation_cost"] + r["running_cost"] + r["prediction_error"] + r["switching_cost"]
    assert r["cost"] == pytest.approx(parts, rel=1e-12)


@pytest.mark.parametrize(
    "key", ["min_on: 1", "max_on: 2", "min_off: 1", "warm_up: 1", "max_time: 2", "max_share: 0.5", "revisit: 2"]
)
def test_samples_know_no_rules_of_times(tmp_path: Path, key: str) -> None:
    with pytest.raises(oc.ProblemError) as error:
        written(tmp_path, SAMPLES, ("cost: 0.5}", f"cost: 0.5, {key}}}"))
    name = key.split(":")[0]
    assert f"{name} is a time, and samples are instants" in str(error.value) and "x.yaml:7:" in str(error.value)
    assert error.value.exit_code == 3


def test_steps_lost_to_a_slew_are_empty_and_the_filter_follows(tmp_path: Path) -> None:
    limits = "constraints: {switch_delay: {radar: {sonar: 1}, sonar: {radar: 1}}, max_switches: 2}\n"
    p = written(
        tmp_path, STEPS, ("  - idle\n", ""), ("cost: 0.5}", "cost: 0.5, max_time: 3, warm_up: 1}"), more=limits
    )
    solution = oc.solve(p)
    weights, measuring = solution.arrays["weights"], solution.arrays["measuring"]
    lost = np.flatnonzero(weights.sum(axis=1) == 0)
    assert 1 <= len(lost) <= 2 and [e["sensors"] for e in solution.result["schedule"]].count([]) == len(lost)
    warm = np.flatnonzero((weights > measuring).any(axis=1))
    assert len(warm) >= 1 and measuring[warm].sum() == 0
    measurements, _ = oc.simulate(p, solution, seed=3)
    read = {round(m.time) for m in measurements}
    assert read == set(np.flatnonzero(measuring.sum(axis=1)).tolist())
    estimate = oc.run_filter(p, solution, measurements)
    assert np.allclose(estimate.covariance[-1], solution.arrays["covariance"][-1], rtol=1e-9)
    again = oc.certify(p, solution.schedule)
    assert again.cost == pytest.approx(solution.cost, rel=1e-12)


def test_caps_on_cost_and_error(tmp_path: Path) -> None:
    capped = written(tmp_path, SAMPLES, ("{cost_weight: 0.1, ", "{minimise: error, "),
                     more="constraints: {max_observation_cost: 1.8}\n")  # fmt: skip
    r = oc.solve(capped).result
    assert r["proven_optimal"] and r["observation_cost"] <= 1.8 * (1 + 1e-9)
    assert r["cost"] == pytest.approx(r["prediction_error"], rel=1e-12)
    limit = r["cost"] * 1.01
    cheapest = written(tmp_path, SAMPLES, ("{cost_weight: 0.1, ", "{minimise: observation, "),
                       more=f"constraints: {{max_error: {limit!r}}}\n")  # fmt: skip
    s = oc.solve(cheapest).result
    assert s["cost"] == pytest.approx(s["observation_cost"], rel=1e-12) and s["prediction_error"] <= limit * (1 + 1e-9)
    assert s["cost"] <= r["observation_cost"] * (1 + 1e-9)
    with pytest.raises(oc.InfeasibleError):
        oc.solve(written(tmp_path, SAMPLES, ("{cost_weight: 0.1, ", "{minimise: observation, "),
                         more="constraints: {max_error: 1.0e-6}\n"))  # fmt: skip


def test_max_error_holds_the_whole_integral_of_the_running_weight(tmp_path: Path) -> None:
    """Its constant, which no reading changes, is part of the error that is limited."""
    running = "output: [[1, 0]], running: {diag: [0.3, 0.1]}}"
    free = written(tmp_path, SAMPLES, ("output: [[1, 0]]}", running))
    errors, prices = {}, {}
    for word in product((0, 1), repeat=6):
        r = oc.certify(free, free.make_schedule(free.edges, np.eye(2)[list(word)])).result
        errors[word], prices[word] = r["running_cost"] + r["prediction_error"], r["observation_cost"]
    limit = sorted(errors.values())[20] * (1 + 1e-9)
    cheapest = min(price for word, price in prices.items() if errors[word] <= limit)
    p = written(
        tmp_path, SAMPLES, ("{cost_weight: 0.1, output: [[1, 0]]}", "{minimise: observation, " + running),
        more=f"constraints: {{max_error: {limit!r}}}\n",
    )  # fmt: skip
    r = oc.solve(p).result
    assert r["running_cost"] + r["prediction_error"] <= limit * (1 + 1e-9)
    assert r["cost"] == pytest.approx(cheapest, rel=1e-12) and r["proven_optimal"]


def test_where_nothing_need_be_read_the_cost_is_zero_and_proven(tmp_path: Path) -> None:
    p = written(tmp_path, STEPS, ("{cost_weight: 0.1, ", "{minimise: observation, "),
                more="constraints: {max_error: 1.0e+3}\n")  # fmt: skip
    solution = oc.solve(p)
    assert solution.cost == 0.0 and str(solution.status) == "certified" and "Rounding" not in solution.message


def test_a_budget_and_rules_exclude_each_other(tmp_path: Path) -> None:
    with pytest.raises(oc.ProblemError) as error:
        written(tmp_path, SAMPLES, more="budget: {total: 3}\nconstraints: {max_switches: 1}\n")
    assert "a budget is of exact numbers of readings" in str(error.value)


@pytest.mark.parametrize("name", ["hminimal", "best-single", "round-robin", "random", "greedy", "relaxed"])
def test_other_methods_obey_the_rules(tmp_path: Path, name: str) -> None:
    p = written(tmp_path, STEPS, more="constraints: {max_switches: 2, min_on: 2}\n")
    solution, best = oc.solve(p, name), oc.solve(p)
    assert solution.result["constraints"]["satisfied"]
    assert solution.result["lower_bound"] <= best.cost * (1 + 1e-9)
    if name != "relaxed":
        assert solution.cost >= best.cost * (1 - 1e-9)
        assert oc.certify(p, solution.schedule).cost == pytest.approx(solution.cost, rel=1e-12)

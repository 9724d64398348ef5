"""Problem files with rules, from the file to the filter, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import occontrol as oc
from occontrol.families.athans.discretise import discretise
from occontrol.scheduling.sweep import Sweep
from tests.families.athans.problem_texts import written

DATA = Path(__file__).resolve().parents[3] / "data" / "rules"
BASE = """\
family: athans
name: rules
horizon: {start: 0, end: 4, intervals: 8, substeps: 1}
plant: {A: [[0, 1], [-1, -0.4]], noise: {diag: [0.0, 0.5]}, initial: {covariance: {diag: [5, 5]}}}
sensors:
  - {name: radar, C: [[1, 0]], noise: [[0.1]], cost: 0.5}
  - {name: sonar, C: [[0, 1]], noise: [[0.2]], cost: 0.2}
objective: {cost_weight: 0.1, output: [[1, 0]]}
"""


def problem(tmp_path: Path, *changes: tuple[str, str], more: str = "") -> object:
    return written(tmp_path, BASE, *changes, more=more)


@pytest.mark.parametrize("path", sorted(DATA.glob("*.json")), ids=lambda path: path.stem)
def test_the_known_optimum_is_found_and_proven(path: Path) -> None:
    p = oc.read_problem(path)
    r = oc.solve(p).result
    assert r["cost"] == pytest.approx(p.expect["cost"], abs=1e-7)
    assert r["proven_optimal"] and 0 <= r["relative_gap"] <= 1e-6
    assert r["relaxed_lower_bound"] <= r["lower_bound"] <= r["cost"]
    assert r["top"]["of"] == "grid" and r["constraints"]["satisfied"]


def test_a_solution_is_certified_again_and_its_document_is_the_same_problem(tmp_path: Path) -> None:
    limits = "constraints: {min_on: 1.0, max_switches: 2, switch_cost: 0.002, before: {sensor: sonar, for: 0.5}}\n"
    p = problem(tmp_path, ("cost: 0.5}", "cost: 0.5, max_uses: 1, duty: {window: 2.0, time: 1.5}}"), more=limits)
    assert oc.document(p)["constraints"]["before"] == {"sensor": "sonar", "for": 0.5}
    solution = oc.solve(p)
    oc.write_run(tmp_path / "run", p, solution)
    again, read = oc.read_run(tmp_path / "run")
    assert oc.document(again) == oc.document(p)
    judged = oc.certify(again, read.schedule)
    assert judged.cost == pytest.approx(solution.cost, rel=1e-12)
    assert judged.certificate.lower_bound <= solution.cost
    r = solution.result
    assert r["cost"] == pytest.approx(
        0.1 * r["observation_cost"] + r["prediction_error"] + r["switching_cost"], rel=1e-12
    )


@pytest.mark.parametrize(
    ("limits", "letters", "words"),
    [
        ("{min_on: 1.0}", "rsssrrrr", "sensor 'radar' is on from t = 0 to 0.5, min_on is 1"),
        ("{max_switches: 1}", "rrrsssrr", "there are 2 changes, max_switches is 1"),
        ("{max_uses: 1}", "rrssrrss", "sensor 'radar' has 2 uses, max_uses is 1"),
        ("{max_time: 1.0}", "rrrsssss", "sensor 'radar' is on for 1.5 in all, max_time is 1"),
        ("{min_off: 1.0}", "rrsrrrrr", "sensor 'radar' is off from t = 1 to 1.5 only, min_off is 1"),
        ("{max_observation_cost: 1.0}", "rrrrrrrr", "the observation cost of the schedule is 2"),
        ("{max_error: 0.01}", "rrrrrrrr", "max_error is 0.01"),
        ("{switch_delay: {radar: {sonar: 0.7}}}", "rrr-ssss", "'radar' and 'sonar', the switch_delay of 0.7"),
    ],
)
def test_certify_names_the_rule_that_a_schedule_breaks(tmp_path: Path, limits: str, letters: str, words: str) -> None:
    p = problem(tmp_path, more=f"constraints: {limits}\n")
    weights = np.array([[c == "r", c == "s"] for c in letters], dtype=float)
    with pytest.raises(oc.OccontrolError) as error:
        oc.certify(p, oc.Schedule(p.edges, weights, ("radar", "sonar")))
    assert words in str(error.value)


@pytest.mark.parametrize(
    ("own", "limits", "words"),
    [
        ("windows: [[0, 1]], min_on: 2", "{max_switches: 0, before: {sensor: radar, for: 2}}", "beyond the interval"),
        ("windows: [[0, 1.5]], max_uses: 0", "{max_observation_cost: 0.1}", "needs 0.8 of max_observation_cost"),
        ("cost: 0.5", "{min_on: 3, after: enforce, before: {sensor: radar, for: 1.0}, max_switches: 1, max_time: 1.5}",
         "keep"),
    ],
)  # fmt: skip
def test_impossible_rules_are_named_with_the_first_interval(
    tmp_path: Path, own: str, limits: str, words: str
) -> None:
    p = problem(tmp_path, ("cost: 0.5", own if own.startswith("cost") else f"cost: 0.5, {own}"),
                more=f"constraints: {limits}\n")  # fmt: skip
    with pytest.raises(oc.InfeasibleError) as error:
        oc.solve(p)
    assert words in str(error.value) and "hint: there would be one without" in str(error.value)
    assert error.value.exit_code == 4


def test_check_says_what_times_become_on_the_grid(tmp_path: Path) -> None:
    from occontrol.api import family_of

    p = problem(
        tmp_path,
        ("cost: 0.5}", "cost: 0.5, min_on: 1.2, max_on: 1.9, warm_up: 0.3}"),
        more="constraints: {switch_delay: {radar: {sonar: 0.7}}}\n",
    )
    lines = dict(family_of(p).describe(p))
    assert lines["rules of radar"] == (
        "min_on 1.2 (3 intervals, 1.5); max_on 1.9 (3 intervals, 1.5); warm_up 0.3 (1 interval, 0.5)"
    )
    assert "switch_delay from radar to sonar 0.7 (2 intervals, 1)" in lines["rules"]


def test_while_warming_and_slewing_nothing_is_measured(tmp_path: Path) -> None:
    p = problem(
        tmp_path,
        ("cost: 0.5}", "cost: 0.5, warm_up: 0.5}"),
        ("cost: 0.2}", "cost: 0.2, max_time: 2.0}"),
        more="constraints: {switch_delay: {radar: {sonar: 0.5}, sonar: {radar: 0.5}}, max_switches: 1}\n",
    )
    solution = oc.solve(p)
    weights, measuring = solution.arrays["weights"], solution.arrays["measuring"]
    slewing = np.flatnonzero(weights.sum(axis=1) == 0)
    assert len(slewing) == 1 and not measuring[slewing].any()
    first = int(np.argmax(weights[:, 0] > 0))
    assert weights[first, 0] == 1 and measuring[first, 0] == 0 and measuring[first + 1, 0] == 1
    assert any(segment["sensors"] == [] for segment in solution.result["schedule"])
    assert solution.result["switches"] == 1
    measurements, _ = oc.simulate(p, solution, seed=3)
    read = {round(m.time, 9) for m in measurements}
    assert round(float(p.edges[first + 1]), 9) not in read
    estimate = oc.run_filter(p, solution, measurements)
    assert np.allclose(estimate.covariance[-1], solution.arrays["covariance"][-1], rtol=1e-9)
    # what is on and measures nothing is paid for all the same
    spent = float(np.diff(p.edges) @ weights @ np.array([0.5, 0.2]))
    assert solution.result["observation_cost"] == pytest.approx(spent, rel=1e-12)


def test_exact_without_rules_is_the_optimum_of_all_schedules(tmp_path: Path) -> None:
    import itertools

    p = problem(tmp_path, more="method: {name: schedule, exact: {relative_gap: 1.0e-6, max_nodes: 5000}}\n")
    sweep = Sweep(discretise(p))
    least = min(sweep.cost(np.eye(2)[list(word)]) for word in itertools.product((0, 1), repeat=8))
    r = oc.solve(p).result
    assert r["cost"] == pytest.approx(least, rel=1e-10) and r["proven_optimal"]
    assert "constraints" not in r and "that keeps the rules" not in oc.solve(p).message


@pytest.mark.parametrize("name", ["hminimal", "best-single", "round-robin", "random", "greedy", "relaxed"])
def test_other_methods_obey_the_rules(tmp_path: Path, name: str) -> None:
    p = problem(tmp_path, more="constraints: {min_on: 1.0, max_switches: 2}\n")
    best = oc.solve(p).result
    solution = oc.solve(p, name)
    assert solution.cost >= best["lower_bound"] * (1 - 1e-9)
    assert solution.certificate.lower_bound <= best["cost"] * (1 + 1e-9)
    if name != "relaxed":
        assert oc.certify(p, solution.schedule).cost == pytest.approx(solution.cost, rel=1e-10)


def test_collocation_refuses_rules_by_name(tmp_path: Path) -> None:
    p = problem(tmp_path, more="constraints: {max_switches: 2}\n")
    with pytest.raises(oc.UsageError, match="collocation does not do rules on schedules"):
        oc.solve(p, "collocation")


def test_error_and_observation_as_what_is_minimised(tmp_path: Path) -> None:
    free = oc.solve(problem(tmp_path, more="constraints: {max_switches: 3}\n")).result
    error, spent = free["prediction_error"], free["observation_cost"]
    goal = ("output: [[1, 0]]", "output: [[1, 0]], minimise: observation")
    least = oc.solve(problem(tmp_path, goal, more=f"constraints: {{max_error: {1.02 * error}}}\n")).result
    assert least["cost"] == pytest.approx(least["observation_cost"]) and least["cost"] <= spent * (1 + 1e-9)
    assert least["prediction_error"] <= 1.02 * error * (1 + 1e-9)
    goal = ("output: [[1, 0]]", "output: [[1, 0]], minimise: error")
    least = oc.solve(problem(tmp_path, goal, more=f"constraints: {{max_observation_cost: {spent}}}\n")).result
    assert least["cost"] == pytest.approx(least["prediction_error"]) and least["observation_cost"] <= spent * (1 + 1e-9)
    assert least["multipliers"]["max_observation_cost"] >= 0


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("cost: 0.5}", "cost: 0.5, min_on: -1}", "min_on of sensor 'radar' is -1"),
        ("cost: 0.5}", "cost: 0.5, max_share: 1.5}", "max_share of sensor 'radar' is 1.5"),
        ("output: [[1, 0]]", "output: [[1, 0]], minimise: error", "minimise: error needs constraints.max_obs"),
        ("objective:", "constraints: {before: {sensor: rader, for: 1}}\nobjective:", "did you mean 'radar'?"),
        ("objective:", "constraints: {switch_cost: {radar: {sona: 1}}}\nobjective:", "there is no sensor 'sona'"),
        ("objective:", "select: 2\nconstraints: {switch_delay: {radar: {sonar: 1}}}\nobjective:", "select above 1"),
    ],
)
def test_rules_that_make_no_sense_are_refused(tmp_path: Path, old: str, new: str, words: str) -> None:
    with pytest.raises(oc.ProblemError) as error:
        problem(tmp_path, (old, new))
    assert words in str(error.value)


def test_the_example_of_the_page_on_rules_prints_what_it_shows(tmp_path: Path, monkeypatch, capsys) -> None:
    from occontrol.cli import run

    page = (Path(__file__).resolve().parents[4] / "docs" / "rules.md").read_text(encoding="utf-8")
    (tmp_path / "two_radars.yaml").write_text(page.split("```yaml\n", 1)[1].split("```", 1)[0], encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert run(["check", "two_radars.yaml"]) == 0
    shown = "rules of range     min_on 0.5 (2 intervals, 0.5); warm_up 0.25 (1 interval, 0.25); max_uses 2"
    assert shown in page and shown in capsys.readouterr().out
    assert run(["solve", "two_radars.yaml", "--no-figures"]) == 0
    printed = capsys.readouterr().out
    assert "proven optimal; rules kept" in printed
    assert run(["certify", "runs/two_radars"]) == 0


def test_prices_that_do_not_count_do_not_hide_the_error_of_the_steps(tmp_path: Path) -> None:
    p = problem(
        tmp_path, (", substeps: 1}", "}"), ("cost: 0.5}", "cost: 5.0e+3}"),
        ("{cost_weight: 0.1, ", "{minimise: error, "),
        more="constraints: {max_observation_cost: 1.0e+4}\n",
    )  # fmt: skip
    r = oc.solve(p).result
    assert r["cost"] == pytest.approx(r["prediction_error"], rel=1e-12)
    assert abs(r["continuous"]["cost"] - r["cost"]) <= 1e-4 * r["cost"]
    assert 0 < r["top"]["lower_bound"] <= r["lower_bound"] and r["top"]["relative_gap"] < 0.5


def test_where_one_step_is_exact_the_top_pair_is_a_number(tmp_path: Path) -> None:
    """A parameter that does not move: one step an interval is all that is needed, and its error was no number."""
    p = problem(
        tmp_path, (", substeps: 1}", "}"), ("A: [[0, 1], [-1, -0.4]]", "A: {diag: [0, 0]}"), ("0.0, 0.5]", "0, 0]"),
        more="constraints: {max_switches: 2}\n",
    )  # fmt: skip
    r = oc.solve(p).result
    assert r["integration_steps"] == r["intervals"]
    assert 0 < r["top"]["lower_bound"] <= r["top"]["cost"] == pytest.approx(r["cost"], rel=1e-9)


@pytest.mark.parametrize("limit", ["max_observation_cost: 0.8", "max_share: 0.5"])
def test_what_changes_cost_is_no_part_of_a_budget(tmp_path: Path, limit: str) -> None:
    """Two changes cost more than the budget holds; they are paid in the cost, not out of the budget."""
    changed = ("cost: 0.5}", "cost: 0.5, revisit: 2.0}"), ("cost: 0.2}", "cost: 0.2}\n  - idle")
    more = f"constraints: {{switch_cost: 5.0, {limit}}}\nmethod: {{name: schedule, exact: true}}\n"
    p = problem(tmp_path, *changed, more=more)
    r = oc.solve(p).result
    assert r["proven_optimal"] and r["observation_cost"] <= 0.8 + 0.4 * (limit != "max_observation_cost: 0.8")
    assert r["switching_cost"] in (5.0, 10.0)


def test_a_slew_that_saves_the_price_of_a_sensor_is_below_no_bound(tmp_path: Path) -> None:
    """Sensors are so dear that the best schedule turns as long as it may: the relaxation, which always measures, costs
    more, and its bound has to lose what slewing may save."""
    p = problem(
        tmp_path, ("cost: 0.5}", "cost: 500, max_time: 0.5}"), ("cost: 0.2}", "cost: 500, max_time: 0.5}"),
        more="constraints: {switch_delay: {radar: {sonar: 3.0}, sonar: {radar: 3.0}}}\n"
        "method: {name: schedule, exact: true}\n",
    )  # fmt: skip
    r = oc.solve(p).result
    assert r["proven_optimal"] and r["observation_cost"] == pytest.approx(500.0)
    costs = []
    for letters in ("r------s", "s------r"):
        weights = np.array([[c == "r", c == "s"] for c in letters], dtype=float)
        costs.append(oc.certify(p, oc.Schedule(p.edges, weights, ("radar", "sonar"))).cost)
    assert r["cost"] == pytest.approx(min(costs), rel=1e-9)
    assert r["relaxed_lower_bound"] <= r["cost"] and r["lower_bound"] <= r["cost"]
    assert r["continuous"]["lower_bound"] <= r["cost"]


def test_the_error_of_the_steps_counts_against_the_error_where_the_observation_is_minimised(tmp_path: Path) -> None:
    p = problem(
        tmp_path, (", substeps: 1}", "}"), ("cost: 0.5}", "cost: 5.0e+3}"), ("cost: 0.2}", "cost: 4.0e+3}"),
        ("{cost_weight: 0.1, ", "{minimise: observation, "), more="constraints: {max_error: 0.6}\n",
    )  # fmt: skip
    r = oc.solve(p).result
    assert r["integration_steps"] >= 4 * r["intervals"]

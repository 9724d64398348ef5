"""Criteria of readings from the file to the run: known answers, enumeration, methods, refusals."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import numpy as np
import pytest
from ruamel.yaml import YAML

import occontrol as oc
from occontrol.cli import run
from occontrol.core.errors import InfeasibleError, UsageError
from scripts.campaign_criterion_files import NAMES, judged
from tests.families.athans.problem_texts import written
from tests.plain_readings import PlainReadings, random_document

VOLUME = """\
family: athans
name: volume
horizon: {steps: 6}
plant:
  F: [[1, 0.5, 0], [-0.3, 0.9, 0.2], [0, 0, "0.95+0.05*cos(0.7*k)"]]
  Q: {diag: [0, 0.04, 0.09]}
  initial: {mean: [0, 0, 0], covariance: {diag: [4, 1, 2]}}
sensors:
  - {name: one, H: [[1, 0, 0]], R: [[0.25]], cost: 0.02}
  - {name: two, H: [[0, 1, 0]], R: [[0.1]], cost: 0.01}
  - {name: three, H: [[0, 0, 1], [1, 0, 0]], R: [[0.5, 0.1], [0.1, 1.0]], cost: 0.05}
  - idle
select: 1
objective: {cost_weight: 1, output: [[1, 0, 0], [0, 1, 1]], criterion: {name: logdet}}
"""
FREE = (("cost_weight: 1", "cost_weight: 0"), ("  - idle\n", ""))
PEAK = ("output: [[1, 0, 0], [0, 1, 1]], criterion: {name: logdet}", "criterion: {name: peak, from: 2}")


def below(limit: float) -> tuple[str, str]:
    return PEAK[0], f"output: {{identity: 3}}, criterion: {{name: peak, from: 2, limit: {limit}}}"


def plain_of(text: str) -> PlainReadings:
    """The textbook filter on the document of a text."""
    document = YAML(typ="safe").load(text)
    n = 3
    document["plant"] |= {"Q": np.diag(document["plant"]["Q"]["diag"]).tolist()}
    document["plant"]["initial"] = {"covariance": np.diag(document["plant"]["initial"]["covariance"]["diag"]).tolist()}
    document["objective"].setdefault("output", np.eye(n).tolist())
    if isinstance(document["objective"]["output"], dict):
        document["objective"]["output"] = np.eye(n).tolist()
    return PlainReadings(document)


def test_the_volume_after_six_readings(tmp_path: Path) -> None:
    p = written(tmp_path, VOLUME, *FREE)
    s = oc.solve(p)
    r = s.result
    assert r["cost"] == pytest.approx(-2.3721411177032845, abs=1e-12)
    assert r["criterion"] == pytest.approx(r["cost"], rel=1e-14)  # by the independent check, to the last digit but one
    chosen = [entry["sensors"][0] for entry in r["schedule"]]
    assert chosen == ["two", "three", "two", "three", "two", "one"]
    assert r["relaxed_lower_bound"] <= -2.45197917 and r["relaxed_lower_bound"] >= -2.45197917 - 1.1e-4
    assert r["relaxed_lower_bound"] <= r["lower_bound"] <= r["cost"] + 1e-12
    assert r["relative_gap"] == r["cost"] - r["lower_bound"] and r["top"]["gap"] == "difference"
    assert r["prediction_error"] == pytest.approx(0.853522, abs=1e-6)  # which stays the trace
    # beside another schedule the bound is no more than the best one: nothing is raised to 0
    worst = oc.certify(p, p.make_schedule(p.edges, np.eye(3)[[0, 0, 0, 0, 0, 0]]))
    assert worst.result["cost"] > -1.2 and worst.result["lower_bound"] <= r["cost"] + 1e-9
    assert worst.result["relative_gap"] == pytest.approx(worst.result["cost"] - worst.result["lower_bound"], rel=1e-12)


@pytest.mark.parametrize(("limit", "cost", "bound"), [(0.9, 0.10, 0.06739), (1.2, 0.08, 0.04244), (2.0, 0.04, 0.01786)])
def test_the_cheapest_schedule_below_a_peak(tmp_path: Path, limit: float, cost: float, bound: float) -> None:
    s = oc.solve(written(tmp_path, VOLUME, below(limit)))
    r = s.result
    assert r["cost"] == pytest.approx(cost, abs=1e-12) and r["criterion"] <= limit
    assert r["relaxed_lower_bound"] == pytest.approx(bound, abs=2e-5) and r["relaxed_lower_bound"] <= bound + 5e-6
    assert bound - 1e-5 <= r["lower_bound"] <= cost
    traces = np.trace(s.arrays["covariance"], axis1=1, axis2=2)
    assert r["criterion"] == pytest.approx(np.max(traces[2:]), rel=1e-12)
    assert f"whose peak is at most {limit:g} costs less than" in s.message


def test_the_least_peak_is_that_of_enumeration_and_named_where_a_limit_is_below(tmp_path: Path, capsys) -> None:
    text = VOLUME.replace(*PEAK)
    plain = plain_of(text.replace("cost_weight: 1", "cost_weight: 0"))
    least = min(plain.cost(w) for w in plain.schedules())
    found = oc.solve(written(tmp_path, text, ("cost_weight: 1", "cost_weight: 0")))
    assert found.result["cost"] == pytest.approx(least, rel=1e-12) and found.result["lower_bound"] <= least
    path = tmp_path / "low.yaml"
    path.write_text(VOLUME.replace(*below(0.8)))
    assert run(["solve", str(path), "--out", str(tmp_path / "run")]) == 4
    words = capsys.readouterr().err
    assert "no schedule keeps the peak at or below 0.8" in words and f"the least peak is {least:.8g}" in words
    assert run(["solve", str(path), "--method", "relaxed", "--out", str(tmp_path / "run")]) == 0  # shares keep it
    path.write_text(VOLUME.replace(*below(0.6)))
    assert run(["solve", str(path), "--method", "relaxed", "--out", str(tmp_path / "run")]) == 4
    assert "no schedule has a peak below 0.6" in capsys.readouterr().err


def test_a_schedule_above_the_limit_is_refused_by_certify(tmp_path: Path) -> None:
    p = written(tmp_path, VOLUME, below(0.9))
    with pytest.raises(oc.ProblemError, match=r"the peak of the schedule is .*, the limit is 0.9"):
        oc.certify(p, p.make_schedule(p.edges, np.eye(4)[[0, 0, 0, 0, 0, 3]]))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seed", range(3))
def test_every_criterion_of_random_files_against_enumeration(name: str, seed: int) -> None:
    rng, found = np.random.default_rng(40 + seed), None
    while found is None:
        found = judged(random_document(rng, 4, budget=seed == 2), name, rng)
    assert found["off"] <= 1e-12 and found["above"] <= 1e-10 and found["excess"] <= 1e-9 and found["right"], found


CRITERIA = [
    "{name: log-trace}", "{name: logdet}", "{name: largest-eigenvalue}", "{name: schatten, p: 3}",
    "{name: peak, at: prior}",
]  # fmt: skip


@pytest.mark.parametrize("criterion", CRITERIA)
def test_every_method_tells_the_true_cost_and_a_true_bound(tmp_path: Path, criterion: str) -> None:
    text = VOLUME.replace("{name: logdet}", criterion).replace("steps: 6", "steps: 5")
    problem, plain = written(tmp_path, text, more="method: {name: schedule, relative_gap: 1.0e-2}\n"), plain_of(text)
    best = min(plain.cost(w) for w in plain.schedules())
    for name in ("schedule", "hminimal", "greedy", "best-single", "round-robin", "random", "relaxed"):
        r = oc.solve(problem, name).result
        assert max(r["lower_bound"], r["relaxed_lower_bound"]) <= best + 1e-10 * (1 + abs(best))
        if name != "relaxed":
            names = problem.listed
            word = [tuple(names.index(x) for x in e["sensors"] if x != "idle") for e in r["schedule"]]
            assert r["cost"] == pytest.approx(plain.cost(word), rel=1e-11, abs=1e-12)
    with pytest.raises(UsageError, match="collocation does not do"):
        oc.solve(problem, "collocation")
    with pytest.raises(UsageError, match="tradeoff does not do the criterion"):
        oc.tradeoff(problem, [0.1, 1.0])


def test_greedy_weighs_by_the_criterion(tmp_path: Path) -> None:
    """Place by place the choice with the least criterion if nothing more is read, all words tried."""
    for criterion in ("{name: logdet}", "{name: largest-eigenvalue}"):
        text = VOLUME.replace("{name: logdet}", criterion)
        problem, plain = written(tmp_path, text), plain_of(text)
        word: list[tuple[int, ...]] = []
        for k in range(6):
            ways = [(), (0,), (1,), (2,)]
            word.append(min(ways, key=lambda way, k=k: plain.cost([*word, way, *[()] * (5 - k)])))
        r = oc.solve(problem, "greedy").result
        chosen = [tuple(problem.listed.index(x) for x in e["sensors"] if x != "idle") for e in r["schedule"]]
        assert chosen == word


def test_dependent_outputs_are_projected_and_that_is_said(tmp_path: Path) -> None:
    doubled = ("output: [[1, 0, 0], [0, 1, 1]]", "output: [[1, 0, 0], [0, 1, 1], [0, 2, 2]]")
    r = oc.solve(written(tmp_path, VOLUME, *FREE, doubled))
    assert "3 outputs have only 2 independent errors" in r.message
    assert r.result["cost"] == pytest.approx(-2.3721411177032845 + np.log(5), abs=1e-10)  # |(1, 2)|^2 = 5


def test_a_document_is_read_back(tmp_path: Path) -> None:
    for change in (below(0.9), PEAK, ("{name: logdet}", "{name: schatten, p: 3}")):
        p = written(tmp_path, VOLUME, change)
        path = tmp_path / "again.json"
        path.write_text(json.dumps(oc.document(p)))
        again = oc.read_problem(path)
        assert again.criterion == p.criterion and oc.document(again) == oc.document(p)


REFUSED = [
    ("{name: logdet}", "{name: lambda-min}", "the criterion 'lambda-min' is not offered: it is not convex"),
    ("{name: logdet}", "{name: logdte}", "unknown criterion 'logdte'\n  hint: did you mean 'logdet'?"),
    ("{name: logdet}", "{name: logdet, p: 2}", "p belongs to the criterion schatten"),
    ("{name: logdet}", "{name: schatten, p: 0.5}", "p of schatten is 0.5\n  hint: a number of at least 1"),
    ("{name: logdet}", "{name: logdet, at: prior}", "at belongs to the criterion peak"),
    ("{name: logdet}", "{name: peak, at: later}", "at is 'later'\n  hint: one of: posterior, prior"),
    ("{name: logdet}", "{name: peak, from: 9}", "from is 9, the last time at which the peak could count is 5"),
    ("{name: logdet}", "{name: peak, limit: -1}", "limit is -1\n  hint: a variance above 0"),
    ("{name: logdet}}", "{name: logdet}, minimise: observation}", "minimise: observation leaves the criterion out"),
]


@pytest.mark.parametrize(("old", "new", "words"), REFUSED, ids=itertools.count())
def test_refusals_name_the_place(tmp_path: Path, old: str, new: str, words: str) -> None:
    with pytest.raises(oc.ProblemError) as error:
        written(tmp_path, VOLUME, (old, new))
    assert words in str(error.value) and "x.yaml:14:" in str(error.value)


def test_a_criterion_without_any_output_is_refused(tmp_path: Path) -> None:
    with pytest.raises(oc.ProblemError, match="neither 'output' nor 'running'"):
        written(tmp_path, VOLUME, ("output: [[1, 0, 0], [0, 1, 1]], ", ""))


def test_a_peak_beyond_every_limit_is_infeasible_from_python(tmp_path: Path) -> None:
    with pytest.raises(InfeasibleError, match="least peak"):
        oc.solve(written(tmp_path, VOLUME, below(0.5)))

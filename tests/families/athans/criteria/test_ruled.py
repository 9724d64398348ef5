"""Criteria beside rules: against the enumeration of all schedules that keep them."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import occontrol as oc
from occontrol.cli import run
from occontrol.core.errors import InfeasibleError
from scripts.campaign_criterion_files import NAMES
from scripts.campaign_ruled_readings import judged, with_criterion, wrong
from tests.families.athans.criteria.test_rate import PRICE, TEXT, VALUES, along
from tests.families.athans.criteria.test_readings import PEAK, VOLUME, below, plain_of
from tests.families.athans.problem_texts import written

RULES = "constraints: {max_switches: 2, switch_cost: 0.01}\n"
USES = ("R: [[0.1]], cost: 0.01", "R: [[0.1]], cost: 0.01, min_on: 2")


@pytest.mark.parametrize("name", NAMES[1:])
def test_the_optimum_of_enumeration_is_found_and_proven(name: str) -> None:
    rng, found = np.random.default_rng(70), None
    while found is None:
        document = with_criterion(rng, name, 4)
        found = judged(document, most=150) if "criterion" in document["objective"] else None
    assert not wrong(found), found


def kept(word: list[tuple[int, ...]]) -> bool:
    """At most two changes, and sensor two at least twice in a row but at the end."""
    text = "".join("i123"[c[0] + 1 if c else 0] for c in word)
    changes = sum(a != b for a, b in pairwise(text))
    good = re.search("(^|[^2])2[^2]", text) is None
    return changes <= 2 and good


def with_changes(plain, word: list[tuple[int, ...]]) -> float:
    changes = sum(a != b for a, b in pairwise(word))
    return plain.cost(word) + 0.01 * changes


@pytest.mark.parametrize("criterion", ["{name: logdet}", "{name: largest-eigenvalue}"])
def test_every_method_keeps_the_rules_and_tells_a_true_bound(tmp_path: Path, criterion: str) -> None:
    text = VOLUME.replace("{name: logdet}", criterion)
    problem, plain = written(tmp_path, text, USES, more=RULES), plain_of(text)
    costs = {tuple(w): with_changes(plain, w) for w in plain.schedules() if kept(w)}
    best = min(costs.values())
    for name in ("schedule", "greedy", "relaxed"):
        r = oc.solve(problem, name).result
        assert max(r["lower_bound"], r["relaxed_lower_bound"]) <= best + 1e-9
        assert r["lower_bound"] >= best - 0.35
        if name != "relaxed":
            word = tuple(tuple(problem.listed.index(x) for x in e["sensors"] if x != "idle") for e in r["schedule"])
            assert r["cost"] == pytest.approx(costs[word], rel=1e-11)
        if name == "schedule":
            assert r["cost"] == pytest.approx(best, rel=1e-11) and r["constraints"]["satisfied"]


def test_a_peak_that_rules_make_unreachable_is_named(tmp_path: Path, capsys) -> None:
    """.9 is kept without rules (test_readings.py); with one change alone the least peak is above it."""
    text = VOLUME.replace(*below(0.9))
    plain = plain_of(VOLUME.replace(*PEAK).replace("cost_weight: 1", "cost_weight: 0"))
    least = min(plain.cost(w) for w in plain.schedules() if sum(a != b for a, b in pairwise(w)) <= 1)
    assert least > 0.9
    path = tmp_path / "few.yaml"
    path.write_text(text + "constraints: {max_switches: 1}\n")
    assert run(["solve", str(path), "--out", str(tmp_path / "run")]) == 4
    words = capsys.readouterr().err
    assert "no schedule that keeps the rules keeps the peak at or below 0.9" in words
    assert f"the least peak is {least:.8g}" in words
    path.write_text(text.replace("limit: 0.9", f"limit: {least * 1.000001}") + "constraints: {max_switches: 1}\n")
    p = oc.read_problem(path)
    r = oc.solve(p).result
    limited = plain_of(text.replace("limit: 0.9", f"limit: {least * 1.000001}"))
    one = [w for w in plain.schedules() if sum(a != b for a, b in pairwise(w)) <= 1]
    assert r["cost"] == pytest.approx(min(limited.cost(w) for w in one), abs=1e-12)
    with pytest.raises(oc.ProblemError, match="the peak of the schedule is"):
        oc.certify(p, p.make_schedule(p.edges, np.eye(4)[[3, 3, 3, 3, 3, 3]]))


RATE_RULES = "constraints: {max_switches: 1, switch_cost: 0.03}\n"


@pytest.fixture(scope="module")
def every() -> dict[tuple[int, ...], list[np.ndarray]]:
    """The covariances of all schedules of continuous sensing that change once at most."""
    words = [(a,) * k + (b,) * (4 - k) for a in range(3) for b in range(3) for k in range(4)]
    return {word: along(word) for word in words}


@pytest.mark.parametrize("name", ["logdet", "largest-eigenvalue", "peak, from: 1"])
def test_rules_in_continuous_sensing(tmp_path: Path, every: dict, name: str) -> None:
    p = written(tmp_path, TEXT, ("logdet", name), more=RATE_RULES)
    s = oc.solve(p)
    r = s.result
    costs = {w: 0.5 * sum(PRICE[j] for j in w) + VALUES[name](X) + 0.03 * (len(set(w)) - 1) for w, X in every.items()}
    word = tuple(int(j) for j in np.argmax(s.arrays["weights"], axis=1))
    best = min(costs.values())
    assert str(s.status) in ("certified", "feasible") and r["switches"] == len(set(word)) - 1
    assert r["switching_cost"] == pytest.approx(0.03 * (len(set(word)) - 1))
    assert r["continuous"]["cost"] == pytest.approx(costs[word], rel=1e-7, abs=1e-7)
    assert r["cost"] == pytest.approx(best, rel=3e-4, abs=3e-4)
    assert max(r["lower_bound"], r["relaxed_lower_bound"]) <= best + 3e-4 * (1 + abs(best))
    assert r["lower_bound"] >= best - 0.2 and r["top"]["of"] == "grid"
    judged = oc.certify(p, s.schedule)
    assert judged.cost == pytest.approx(s.cost, rel=1e-10) and judged.result["lower_bound"] <= best + 3e-4
    other = np.eye(3)[[0, 1, 0, 1]]
    with pytest.raises(oc.ProblemError, match="max_switches is 1"):
        oc.certify(p, oc.Schedule(p.edges, other, tuple(p.sensors.names)))


def test_a_limit_and_a_longest_use_in_continuous_sensing(tmp_path: Path, every: dict) -> None:
    """Doppler at most half the time, whatever it saves; a limit that few schedules keep."""
    peaks = {w: VALUES["peak, from: 1"](X) for w, X in every.items() if w.count(1) <= 2}
    limit = float(np.quantile(list(peaks.values()), 0.4)) * 1.001
    change = ("criterion: {name: logdet}", f"criterion: {{name: peak, from: 1, limit: {limit}}}")
    cost = ("cost: 0.5}", "cost: 0.5, max_time: 1.0}")
    r = oc.solve(written(tmp_path, TEXT, change, cost, more="constraints: {max_switches: 1}\n")).result
    best = min(0.5 * sum(PRICE[j] for j in w) for w, peak in peaks.items() if peak <= limit)
    assert r["cost"] == pytest.approx(best, abs=1e-12) and r["criterion"] <= limit * (1 + 1e-9)
    assert r["lower_bound"] <= best
    low = ("criterion: {name: logdet}", "criterion: {name: peak, from: 1, limit: 0.1}")
    with pytest.raises(InfeasibleError, match=r"least peak|has a peak below"):
        oc.solve(written(tmp_path, TEXT, low, more="constraints: {max_switches: 1}\n"))

"""What every rule means, word by word: all schedules of a small problem against a sentence on their letters.

A schedule is a word: r radar, s sonar, i idle, - nothing (a slew). Checker and dynamic program must allow exactly the
words that the sentence allows; where a sentence is about cost, the cost of words is compared.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from itertools import pairwise, product
from pathlib import Path

import numpy as np
import pytest

import occontrol as oc
from occontrol.families.athans.rules.setting import frame_of, rules_of
from occontrol.scheduling.rules.check import changes, keeps, switching_cost

STEP = 0.5
TEXT = """\
family: athans
name: words
horizon: {{start: 0, end: {end}, intervals: {count}, substeps: 1}}
plant: {{A: [[0, 1], [-1, -0.4]], noise: {{diag: [0.0, 0.5]}}, initial: {{covariance: {{diag: [5, 5]}}}}}}
sensors:
  - {{name: radar, C: [[1, 0]], noise: [[0.1]], cost: 0.5{radar}}}
  - {{name: sonar, C: [[0, 1]], noise: [[0.2]], cost: 0.2{sonar}}}
{idle}select: {select}
constraints: {limits}
objective: {{cost_weight: 0.1, output: [[1, 0]]}}
method: {{name: schedule, exact: true}}
"""
LETTERS = {"r": (1, 0, 0), "s": (0, 1, 0), "i": (0, 0, 1), "-": (0, 0, 0), "b": (1, 1, 0)}


def problem(tmp_path: Path, limits: str = "{}", radar: str = "", sonar: str = "", count: int = 6, idle: bool = False,
            select: int = 1) -> oc.athans.SchedulingProblem:  # fmt: skip
    path = tmp_path / "words.yaml"
    path.write_text(
        TEXT.format(
            end=STEP * count, count=count, limits=limits, select=select,
            radar=radar and f", {radar}", sonar=sonar and f", {sonar}", idle="  - idle\n" if idle else "",
        )
    )  # fmt: skip
    return oc.read_problem(path)


def matrix(p: oc.athans.SchedulingProblem, word: str) -> np.ndarray:
    return np.array([LETTERS[c][: len(p.sensors)] for c in word], dtype=bool)


def check_words(p: oc.athans.SchedulingProblem, allowed: Callable[[str], object], letters: str = "rs") -> set[str]:
    """All words against a sentence, by the checker and by the dynamic program; the words that are allowed."""
    rules, oracle = rules_of(p), frame_of(p).oracle()
    names = {"max_uses", "max_time", "duty_time", "revisit"}  # prices keep these where the states do not
    wanted = {name.replace("duty_time", "duty") for name in names if np.any(np.isfinite(getattr(rules, name)))}
    wanted |= {"min_off"} if np.any(rules.min_off > 0) else set()
    whole = wanted <= oracle.automaton.tracked
    found = set()
    for each in product(letters, repeat=len(p.edges) - 1):
        word = "".join(each)
        on = matrix(p, word)
        assert keeps(rules, p.edges, on) == bool(allowed(word)), word
        if whole or allowed(word):
            assert (oracle.follow(on) is not None) == bool(allowed(word)), word
        if allowed(word):
            found.add(word)
    assert found and len(found) < len(letters) ** (len(p.edges) - 1)
    return found


def runs(word: str, letter: str) -> list[int]:
    """Lengths of the maximal runs of a letter."""
    return [len(run) for run in re.findall(f"{letter}+", word)]


def changed(word: str) -> int:
    return sum(a != b for a, b in pairwise(word))


def cost(p: oc.athans.SchedulingProblem, word: str) -> dict:
    schedule = oc.Schedule(p.edges, matrix(p, word).astype(float), tuple(p.sensors.names))
    return oc.certify(p, schedule).result


def refused(p: oc.athans.SchedulingProblem, word: str) -> str:
    with pytest.raises(oc.OccontrolError) as error:
        cost(p, word)
    assert error.value.exit_code == 3
    return str(error.value)


def test_1_a_segment_is_a_maximal_run_and_a_multiple_of_the_step_is_met_exactly(tmp_path: Path) -> None:
    p = problem(tmp_path, "{after: enforce}", radar="min_on: 1.0")
    check_words(p, lambda w: all(n >= 2 for n in runs(w, "r")))


def test_2_times_round_up_and_the_longest_use_rounds_down(tmp_path: Path) -> None:
    p = problem(tmp_path, "{after: enforce}", radar="min_on: 0.6", sonar="max_on: 1.4")
    check_words(p, lambda w: all(n >= 2 for n in runs(w, "r")) and all(n <= 2 for n in runs(w, "s")))
    p = problem(tmp_path, "{}", radar="min_off: 0.6")
    check_words(p, lambda w: all(len(gap) >= 2 for gap in re.findall("(?<=r)s+(?=r)", w)))
    # real times: two intervals in three of 0.5 are more than 0.9
    p = problem(tmp_path, "{}", radar="duty: {window: 1.5, time: 0.9}")
    check_words(p, lambda w: all(w[k : k + 3].count("r") <= 1 for k in range(len(w))))
    p = problem(tmp_path, "{}", radar="max_time: 1.4")
    check_words(p, lambda w: w.count("r") <= 2)


def test_3_the_start_without_history_is_a_new_use_and_no_change(tmp_path: Path) -> None:
    p = problem(tmp_path, "{min_on: 1.0, max_uses: 1, after: enforce, max_switches: 1, switch_cost: 0.25}")
    for word in check_words(p, lambda w: all(n >= 2 for c in "rs" for n in runs(w, c)) and len(runs(w, "r")) <= 1
                            and len(runs(w, "s")) <= 1):  # fmt: skip
        assert cost(p, word)["switching_cost"] == 0.25 * (len(set(word)) - 1)


def test_3_a_history_goes_on_or_ends_with_a_change(tmp_path: Path) -> None:
    # on for 0.5 of 1.5: it must stay for two more intervals, is not a new use, and leaving it is a change
    before = "{before: {sensor: radar, for: 0.5}, min_on: 1.5, max_switches: 1, switch_cost: 0.25}"
    p = problem(tmp_path, before)
    found = check_words(p, lambda w: w[:2] == "rr" and changed(w) <= 1)
    assert "rrrrrr" in found and cost(p, "rrssss")["switching_cost"] == 0.25
    p = problem(tmp_path, "{before: {sensor: radar, for: 1.5}, max_uses: 0, max_switches: 1}", sonar="max_uses: 1")
    check_words(p, lambda w: changed("r" + w) <= 1)
    # the longest use counts from before the start; the other is off as if for ever
    p = problem(tmp_path, "{before: {sensor: radar, for: 0.5}}", radar="max_on: 1.5", sonar="min_off: 2.0")
    check_words(
        p,
        lambda w: all(n <= 3 for n in runs("r" + w, "r")) and all(len(g) >= 4 for g in re.findall("(?<=s)r+(?=s)", w)),
    )


def test_4_the_end_may_cut_the_last_use_unless_enforced(tmp_path: Path) -> None:
    p = problem(tmp_path, "{after: free}", radar="min_on: 1.5, max_uses: 1", sonar="min_off: 2.0")
    check_words(
        p,
        lambda w: all(len(run) >= 3 for run in re.findall("r+(?=s)", w)) and len(runs(w, "r")) <= 1
        and all(len(gap) >= 4 for gap in re.findall("(?<=s)r+(?=s)", w)),
    )  # fmt: skip
    p = problem(tmp_path, "{after: enforce}", radar="min_on: 1.5")
    check_words(p, lambda w: all(n >= 3 for n in runs(w, "r")))


def test_5_a_slew_is_an_empty_entry_and_may_not_reach_past_the_end(tmp_path: Path) -> None:
    p = problem(tmp_path, "{switch_delay: {radar: {sonar: 0.6}}}", count=5)
    check_words(p, lambda w: re.fullmatch("(r+--(?=s)|s+)*r*", w), "rs-")
    solution = oc.solve(problem(tmp_path, "{switch_delay: {radar: {sonar: 0.5}, sonar: {radar: 0.5}}, max_switches: 1}",
                                radar="max_time: 1.0", sonar="max_time: 2.0"))  # fmt: skip
    assert {"start": 1.0, "end": 1.5, "sensors": []} in solution.result["schedule"] or any(
        not segment["sensors"] for segment in solution.result["schedule"]
    )
    # idle is a segment of its own, a slew is not idle
    p = problem(tmp_path, "{switch_delay: {radar: {sonar: 0.5}, sonar: {radar: 0.5}}}", idle=True, count=4)
    check_words(p, lambda w: not re.search("rs|sr|^-|-$|--|i-|-i|r-r|s-s", w), "rsi-")


def test_6_a_slew_is_one_change_and_changes_to_idle_count_and_cost(tmp_path: Path) -> None:
    slew = "{switch_delay: {radar: {sonar: 0.5}, sonar: {radar: 0.5}}, max_switches: 1, switch_cost: 0.25}"
    p = problem(tmp_path, slew, count=4)
    check_words(p, lambda w: re.fullmatch("r+|s+|r+-s+|s+-r+", w), "rs-")
    assert cost(p, "r-ss")["switching_cost"] == 0.25
    p = problem(tmp_path, "{max_switches: 2, switch_cost: 0.25, min_on: 1.0, max_uses: 1, min_off: 1.0}", idle=True,
                count=4)  # fmt: skip
    assert len(changes(rules_of(p), matrix(p, "iriirr"[:4]))) == 2
    assert cost(p, "irri")["switching_cost"] == 0.5
    # dwell, uses and time off do not concern idle
    assert keeps(rules_of(p), p.edges, matrix(p, "irri")) and not keeps(rules_of(p), p.edges, matrix(p, "iriri"[:4]))
    p = problem(tmp_path, "{switch_cost: {radar: {sonar: 0.3, idle: 0}, sonar: {radar: 0.1}}}", idle=True, count=4)
    assert switching_cost(rules_of(p), matrix(p, "risr")) == pytest.approx(0.1)
    assert switching_cost(rules_of(p), matrix(p, "rsri")) == pytest.approx(0.4)


def test_7_with_several_at_a_time_rules_are_per_sensor_and_changes_of_the_set(tmp_path: Path) -> None:
    p = problem(tmp_path, "{max_switches: 1, switch_cost: 0.25}", radar="min_on: 1.0", idle=True, select=2, count=5)
    rules = rules_of(p)
    for each in product("rsb", repeat=5):
        word = "".join(each)
        on = np.array([[c in "rb", c in "sb", False] for c in word])
        short = [run for run in re.findall("[rb]+(?=s)", word) if len(run) < 2]
        assert keeps(rules, p.edges, on) == (not short and changed(word) <= 1), word
    # a set that grows by one starts one sensor; idle never
    assert switching_cost(rules, np.array([[1, 0, 0], [1, 1, 0], [1, 1, 0], [1, 1, 0], [1, 1, 0]], dtype=bool)) == 0.25
    assert switching_cost(rules, np.array([[1, 1, 0]] * 3 + [[1, 0, 0]] * 2, dtype=bool)) == 0.0
    for limits, words in [
        ("{switch_cost: {radar: {sonar: 0.1}}}", "switch_cost"),
        ("{switch_delay: {radar: {sonar: 0.5}}}", "switch_delay"),
        ("{before: {sensor: radar, for: 1.0}}", "before"),
    ]:
        with pytest.raises(oc.ProblemError) as error:
            problem(tmp_path, limits, idle=True, select=2)
        assert words in str(error.value)


def test_8_duty_holds_in_every_window_and_revisit_counts_both_ends(tmp_path: Path) -> None:
    # windows of 1.25 do not fit the steps of 0.5: three uses in a row overlap one by 1.25
    p = problem(tmp_path, "{}", radar="duty: {window: 1.25, time: 1.0}")
    check_words(p, lambda w: "rrr" not in w)
    p = problem(tmp_path, "{}", radar="duty: {window: 1.25, time: 0.75}")
    check_words(p, lambda w: "rr" not in w)
    p = problem(tmp_path, "{}", sonar="revisit: 1.0")
    check_words(p, lambda w: "rrr" not in w)
    with pytest.raises(oc.InfeasibleError):
        oc.solve(problem(tmp_path, "{}", sonar="revisit: 1.0, windows: [[1.5, 3]]"))


def test_9_no_change_is_one_sensor_throughout_and_windows_can_make_that_impossible(tmp_path: Path) -> None:
    p = problem(tmp_path, "{max_switches: 0}")
    assert check_words(p, lambda w: len(set(w)) == 1) == {"rrrrrr", "sssssss"[:6]}
    p = problem(tmp_path, "{max_switches: 0}", radar="windows: [[0, 1]]", sonar="windows: [[1, 3]]")
    with pytest.raises(oc.InfeasibleError) as error:
        oc.solve(p)
    assert "beyond the interval from t = 1 to 1.5" in str(error.value) and error.value.exit_code == 4


def test_10_what_the_result_says(tmp_path: Path) -> None:
    p = problem(tmp_path, "{max_switches: 1, switch_cost: 0.01}", radar="max_time: 1.0")
    r = oc.solve(p).result
    assert r["constraints"]["satisfied"] and r["constraints"]["active"] == ["max_switches"]
    parts = 0.1 * r["observation_cost"] + r["running_cost"] + r["prediction_error"] + r["switching_cost"]
    assert r["cost"] == pytest.approx(parts, rel=1e-12) and r["switching_cost"] == 0.01 * r["switches"]
    assert r["relaxed_lower_bound"] <= r["lower_bound"] <= r["cost"] and r["proven_optimal"] and r["nodes"] >= 1
    assert set(r["multipliers"]) == {"max_time of sensor 'radar'"} and min(r["multipliers"].values()) >= 0
    assert r["continuous"]["lower_bound"] <= r["cost"]
    words = ("".join(w) for w in product("rs", repeat=6))
    best = min(cost(p, w)["cost"] for w in words if keeps(rules_of(p), p.edges, matrix(p, w)))
    assert r["cost"] == pytest.approx(best, rel=1e-9)


def test_11_a_use_is_written_whole_and_measures_after_its_warm_up(tmp_path: Path) -> None:
    p = problem(tmp_path, "{max_switches: 1, after: enforce, min_on: 1.0}", radar="warm_up: 0.6, max_time: 1.5")
    solution = oc.solve(p)
    weights, measuring = solution.arrays["weights"], solution.arrays["measuring"]
    on = np.flatnonzero(weights[:, 0])
    assert len(on) == 3 and measuring[on, 0].tolist() == [0, 0, 1]
    assert np.array_equal(weights[:, 1], measuring[:, 1])
    # also at the start without history, but not for a use that goes on
    p = problem(tmp_path, "{max_switches: 0}", radar="warm_up: 0.5", sonar="windows: [[0, 1]]")
    assert oc.solve(p).arrays["measuring"][:, 0].tolist() == [0, 1, 1, 1, 1, 1]
    limits = "{max_switches: 0, before: {sensor: radar, for: 1.0}}"
    p = problem(tmp_path, limits, radar="warm_up: 0.5", sonar="windows: [[0, 1]]")
    assert oc.solve(p).arrays["measuring"][:, 0].tolist() == [1] * 6


def test_12_defaults(tmp_path: Path) -> None:
    plain = problem(tmp_path, "{max_switches: 3}", radar="min_on: 1.5")
    said = problem(tmp_path, "{max_switches: 3, before: free, after: free}", radar="min_on: 1.5")
    assert check_words(plain, lambda w: keeps(rules_of(said), said.edges, matrix(said, w)))
    assert plain.minimise == "cost"


def test_certify_names_the_broken_rule_with_sensor_and_time(tmp_path: Path) -> None:
    p = problem(tmp_path, "{}", radar="min_on: 1.0")
    assert "sensor 'radar' is on from t = 0.5 to 1, min_on is 1" in refused(p, "srsrrr")

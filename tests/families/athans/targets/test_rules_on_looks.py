"""Dwell, slews and revisit of looks against the enumeration of all schedules, and where they are refused."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import occontrol as oc
from occontrol.families.athans.targets.fill import fill
from tests.target_problems import read

N, STEP = 7, 0.5
TWO = """\
family: athans
name: two targets
horizon: {start: 0, end: 3.5, intervals: 7, substeps: 1}
resources:
  - {name: radar, capacity: 1}
target_models:
  aircraft:
    A: [[0, 1], [0, -0.2]]
    noise: {diag: [0, q]}
    initial: {covariance: {diag: [2, 1]}}
    running: {diag: [1, 0]}
targets:
  - {table: {name: [a, b], q: [0.3, 1.0]}, model: aircraft}
looks:
  - {resource: radar, C: [[1, 0]], noise: [[0.2]], cost: 0.3}
method: {name: schedule, exact: true}
"""
PLAIN = TWO[: TWO.index("method")]


def words(dwell: int, slew: int, revisit: int) -> Iterator[str]:
    """All sequences of looks at a or b, rest (-) and slews (.) that keep the rules; the end may cut the last look."""

    def grow(word: str) -> Iterator[str]:
        if len(word) == N:
            yield word
            return
        last = word[-1] if word else ""
        run = len(word) - len(word.rstrip(last)) if last else 0
        for letter in "ab-":
            if last in ("a", "b") and letter != last and run < dwell:
                continue
            pause = slew if last and letter != "-" and letter != last else 0
            if len(word) + pause < N:
                yield from grow(word + "." * pause + letter)

    for word in grow(""):
        gaps = [g for who in "ab" for g in map(len, "".join(x if x == who else " " for x in word).split(who))]
        if not revisit or max(gaps) <= revisit:
            yield word


@pytest.mark.parametrize(("dwell", "slew", "revisit"), [(2, 0, 0), (1, 1, 0), (2, 1, 0), (1, 0, 2), (2, 1, 5)])
def test_the_best_of_all_schedules_that_keep_the_rules_is_found(
    dwell: int, slew: int, revisit: int, tmp_path: Path
) -> None:
    text = TWO.replace("cost: 0.3", f"cost: 0.3, dwell: {dwell}")
    text = text.replace("capacity: 1", f"capacity: 1, slew: {slew * STEP}") if slew else text
    text = text.replace("model: aircraft}", f"model: aircraft, revisit: {revisit * STEP}}}") if revisit else text
    filled = fill(read(PLAIN, tmp_path))
    sweep, costs = filled.sweep(threads=1), []
    for word in words(dwell, slew, revisit):
        looked = np.array([[who == "a", who == "b", who not in "ab"] for who in word], dtype=float)
        costs.append(sweep.cost(looked.reshape(-1, 1)))
    found = oc.solve(read(text, tmp_path))
    assert found.cost == pytest.approx(min(costs), rel=1e-9)
    assert found.result["lower_bound"] <= min(costs) * (1 + 1e-9)
    used = {name for segment in found.result["schedule"] for name in segment["sensors"]}
    assert used <= {"a@radar", "b@radar", "idle"}


@pytest.mark.parametrize(
    ("old", "new", "words_"),
    [
        ("capacity: 1}", "capacity: 2, slew: 0.5}", "a slew is from one target to the next"),
        ("start: 0, end: 3.5, intervals: 7, substeps: 1", "edges: [0, 1, 3.5]", "intervals of equal length"),
        ("  - {name: radar, capacity: 1}", "  - {name: radar}\n  - {name: other}", "are for one resource, there are 2"),
        ("[0, -0.2]]", '[0, "-0.2*t"]]', "models that do not change with time"),
        ("capacity: 1}", "capacity: '1+floor(t/2)'}", "capacity that stays the same"),
    ],
)
def test_rules_that_make_no_sense_are_refused(old: str, new: str, words_: str, tmp_path: Path) -> None:
    text = TWO.replace("cost: 0.3", "cost: 0.3, dwell: 2")
    with pytest.raises(oc.ProblemError, match=words_):
        read(text.replace(old, new), tmp_path)

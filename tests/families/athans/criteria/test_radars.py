"""The shipped radars with criteria, against all their schedules by a filter of its own."""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import occontrol as oc
from occontrol.cli import run

HOME = Path(__file__).parents[4] / "problems"
CV = np.array([[1.0, 2.0], [0.0, 1.0]])
GUST = np.array([[8 / 3, 2.0], [2.0, 2.0]])


def read(S: np.ndarray, H: np.ndarray, R: np.ndarray) -> np.ndarray:
    """The covariance after a reading, through its information."""
    return np.linalg.inv(np.linalg.inv(S) + H.T @ np.linalg.solve(R, H))


def line_of_sight(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, s, 0], [-s, 0, c, 0]])


@cache
def volumes() -> dict[str, float]:
    """ln det of the position's covariance at the end, by words of w, s and i."""
    F, Q = np.kron(np.eye(2), CV), 4 * np.kron(np.eye(2), np.round(GUST, 8))
    looks = {"w": (line_of_sight(0.2), np.diag([100.0, 2500])), "s": (line_of_sight(1.5), np.diag([225.0, 1600]))}
    level = {"": np.diag([1e4, 1e2, 1e4, 1e2])}
    for _ in range(8):
        after = {w + x: read(S, *looks[x]) if x in looks else S for w, S in level.items() for x in "wsi"}
        level = {w: F @ S @ F.T + Q for w, S in after.items()}
    return {w: float(np.log(np.linalg.det(S[np.ix_([0, 2], [0, 2])]))) for w, S in level.items()}


def kept(word: str) -> bool:
    """No radar is on for a single scan but at the end."""
    return not any(a != x != b and x != "i" for a, x, b in zip("." + word, word, word[1:], strict=False))


def test_the_error_ellipse_of_two_radars() -> None:
    price = {"w": 0.05, "s": 0.06, "i": 0.0}
    costs = {
        w: sum(map(price.get, w)) + 0.05 * sum(a != b for a, b in pairwise(w)) + v  # type: ignore[arg-type]
        for w, v in volumes().items()
        if kept(w)
    }
    best = min(costs, key=lambda w: costs[w])
    solution = oc.solve(oc.read_problem(HOME / "radar_volume.yaml"))
    word = "".join(entry["sensors"][0][0] for entry in solution.result["schedule"])
    assert word == best and solution.result["proven_optimal"]
    assert solution.cost == pytest.approx(costs[best], rel=1e-7)  # Q has 8 digits in the file
    assert costs[best] - 1e-5 <= solution.result["lower_bound"] <= costs[best] + 1e-6
    assert solution.problem.expect["cost"] == pytest.approx(costs[best], rel=1e-8)
    assert min(volumes().values()) < volumes()[best] - 0.1  # prices and rules matter


@cache
def peaks() -> dict[str, float]:
    """The largest variance after scans 2 to 7, by words of n, f and i."""
    Q = 8 * GUST
    level = {"": (np.diag([1e4, 4e2]), 0.0)}
    for k in range(8):
        looks = {"n": (np.eye(2), np.diag([400.0, 25])), "f": (np.eye(2)[:1], np.array([[3000.0 + 300 * k]]))}
        pairs = [(w, x, S, top) for w, (S, top) in level.items() for x in "nfi"]
        after = {w + x: (read(S, *looks[x]) if x in looks else S, top) for w, x, S, top in pairs}
        level = {w: (CV @ S @ CV.T + Q, max(top, S[0, 0] if k >= 2 else 0.0)) for w, (S, top) in after.items()}
    return {w: float(top) for w, (_, top) in level.items()}


def test_the_cheapest_track_that_is_never_lost(tmp_path: Path, capsys) -> None:
    price = {"n": 3.0, "f": 1.0, "i": 0.0}
    costs = {w: sum(price[x] for x in w) for w, peak in peaks().items() if peak <= 900}
    solution = oc.solve(oc.read_problem(HOME / "radar_peak.yaml"))
    word = "".join(entry["sensors"][0][0] for entry in solution.result["schedule"])
    assert solution.cost == pytest.approx(min(costs.values()), abs=1e-12) and costs[word] == min(costs.values())
    assert solution.result["criterion"] == pytest.approx(peaks()[word], rel=1e-7)
    assert solution.problem.expect["cost"] == min(costs.values())
    assert solution.result["proven_optimal"] and solution.result["lower_bound"] <= solution.cost
    path = tmp_path / "low.yaml"
    path.write_text((HOME / "radar_peak.yaml").read_text().replace("limit: 900", "limit: 150"))
    assert run(["solve", str(path), "--out", str(tmp_path / "run")]) == 4
    words, least = capsys.readouterr().err, min(peaks().values())
    assert "no schedule keeps the peak at or below 150" in words
    named = float(words.split("the least peak is ")[1].split()[0])
    assert named == pytest.approx(least, rel=1e-6)

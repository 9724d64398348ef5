"""The shipped problems with rules: every schedule by enumeration, with rules and costs that share no code."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ruamel.yaml import YAML
from scipy.linalg import expm

import occontrol as oc
from occontrol.families.athans.rules.figures import draw_rules
from tests.scheduling.rules.enumeration import Small, allowed, spent

ROOT = Path(__file__).resolve().parents[4]
NAMES = ("laser_station", "battery_lidar", "laboratory_shift")


def matrix(value: Any) -> np.ndarray:
    if isinstance(value, dict) and "diag" in value:
        return np.diag(np.array(value["diag"], dtype=float))
    if isinstance(value, dict):
        return float(value.get("scale", 1.0)) * np.eye(int(value["identity"]))
    return np.array(value, dtype=float)


def noise_of(A: np.ndarray, Xi: np.ndarray, h: float) -> np.ndarray:
    """int_0^h e^(A t) Xi e^(A' t) dt (Van Loan)."""
    n = len(A)
    block = expm(np.block([[-A, Xi], [np.zeros((n, n)), A.T]]) * h)
    return block[n:, n:].T @ block[:n, n:]


class Enumerated:
    """All schedules of a problem file, segment by segment, with the covariance of what they have in common kept."""

    def __init__(self, data: dict):
        horizon, plant, limits = data["horizon"], data["plant"], data.get("constraints", {})
        self.N, self.parts = horizon["intervals"], horizon["substeps"]
        t = np.linspace(horizon["start"], horizon["end"], self.N + 1)
        sensors = [s if isinstance(s, dict) else {"name": s} for s in data["sensors"]]
        names = [s["name"] for s in sensors]
        idle = [name == "idle" for name in names]
        A, Xi, n = matrix(plant["A"]), matrix(plant["noise"]), len(plant["A"])
        h = float(t[1] - t[0]) / self.parts
        self.h, self.F, self.Q = h, expm(A * h / 2), noise_of(A, Xi, h / 2)
        self.L = [
            np.zeros((n, n)) if i else matrix(s["C"]).T @ np.linalg.inv(matrix(s["noise"])) @ matrix(s["C"])
            for s, i in zip(sensors, idle, strict=True)
        ]
        late = float(horizon.get("predict_at", horizon["end"])) - float(horizon["end"])
        D = matrix(data["objective"]["output"]) @ expm(A * late)
        self.W, self.R = D.T @ D, matrix(data["objective"]["running"])
        self.alpha = float(data["objective"].get("cost_weight", 1.0))
        if data["objective"].get("minimise") == "error":
            self.alpha = 0.0

        def each(key: str, default: float) -> list[float]:
            own = [s.get(key, limits.get(key, default)) for s in sensors]
            return [default if i else float(v) for v, i in zip(own, idle, strict=True)]

        delays = limits.get("switch_delay", {})
        rules = {
            "min_on": each("min_on", 0.0), "max_on": [np.inf] * len(names), "min_off": each("min_off", 0.0),
            "warm": [0.0] * len(names), "max_uses": each("max_uses", np.inf), "max_time": each("max_time", np.inf),
            "duty": [(s["duty"]["window"], s["duty"]["time"]) if "duty" in s else (np.inf, np.inf) for s in sensors],
            "revisit": [np.inf] * len(names), "max_switches": limits.get("max_switches"),
            "switch": np.zeros((len(names),) * 2), "before": None, "enforce": False, "max_error": np.inf,
            "delay": np.array([[delays.get(a, {}).get(b, 0.0) for b in names] for a in names]),
            "max_observation": float(limits.get("max_observation_cost", np.inf)),
        }  # fmt: skip
        rate = np.array([float(s.get("cost", 0.0)) for s in sensors])
        upper = np.ones((self.N, len(names)))
        start = matrix(plant["initial"]["covariance"])
        self.small = Small(t, np.empty(0), np.empty(0), start, self.W, self.R, self.L, rate, upper, idle, 1, rules)
        step = float(t[1] - t[0])
        self.need = [max(1, int(np.ceil(v / step - 1e-9))) for v in rules["min_on"]]
        self.slew = np.ceil(rules["delay"] / step - 1e-9).astype(int)
        self.count, self.best, self.word = 0, np.inf, ()

    def interval(self, S: np.ndarray, j: int | None) -> tuple[np.ndarray, float]:
        """One interval with sensor j, or none."""
        total = 0.0
        for _ in range(self.parts):
            S = self.F @ S @ self.F.T + self.Q
            total += 0.5 * self.h * float(np.vdot(self.R, S))
            if j is not None and np.any(self.L[j]):
                S = np.linalg.inv(np.linalg.inv(S) + self.h * self.L[j])
            total += 0.5 * self.h * float(np.vdot(self.R, S))
            S = self.F @ S @ self.F.T + self.Q
        return S, total

    def search(self, word: tuple, S: np.ndarray, total: float) -> None:
        """All ways on from a word that ends with a segment."""
        if len(word) == self.N:
            whole = [(j,) if j is not None else () for j in word]
            if allowed(self.small, whole):
                self.count += 1
                value = total + float(np.vdot(self.W, S)) + self.alpha * spent(self.small, whole)
                if value < self.best:
                    self.best, self.word = value, word
            return
        last = word[-1] if word else None
        for j in range(len(self.L)):
            if word and j == last:
                continue
            found, rest = (S, total), word
            slew = int(self.slew[last, j]) if word else 0
            if len(rest) + slew >= self.N or not self.room(word, j):
                continue
            for _ in range(slew):
                after, more = self.interval(found[0], None)
                found, rest = (after, found[1] + more), (*rest, None)
            for length in range(1, self.N - len(rest) + 1):
                after, more = self.interval(found[0], j)
                found, rest = (after, found[1] + more), (*rest, j)
                if self.over(rest, j):
                    break
                if length >= self.need[j] or len(rest) == self.N:
                    self.search(rest, *found)

    def room(self, word: tuple, j: int) -> bool:
        """Whether j may begin once more, as far as numbers of changes and uses say."""
        runs = [b for a, b in zip((None, *word), word, strict=False) if a != b and b is not None]
        most = self.small.rules["max_switches"]
        return (most is None or len(runs) <= most) and runs.count(j) < self.small.rules["max_uses"][j]

    def over(self, word: tuple, j: int) -> bool:
        """Whether j has been on for too long already."""
        step = self.h * self.parts
        return word.count(j) * step > self.small.rules["max_time"][j] + 1e-9


@pytest.mark.parametrize("name", [*NAMES[:2], pytest.param(NAMES[2], marks=pytest.mark.slow)])
def test_the_optimum_of_every_schedule_is_the_one_that_is_expected(name: str) -> None:
    path = ROOT / "problems" / f"{name}.yaml"
    data = YAML(typ="safe").load(path.read_text(encoding="utf-8"))
    every = Enumerated(data)
    every.search((), every.small.S0, 0.0)
    assert every.count >= 60
    assert every.best == pytest.approx(data["expect"]["cost"], rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_it_is_found_and_proven(name: str) -> None:
    p = oc.read_problem(ROOT / "problems" / f"{name}.yaml")
    solution = oc.solve(p)
    r = solution.result
    above, below = draw_rules(p, solution).axes  # type: ignore[arg-type]
    assert [label.get_text() for label in above.get_yticklabels()][:2] == list(p.sensors.names)[:2]
    said = " ".join(text.get_text() for text in below.texts)
    assert {"laser_station": "no budget", "battery_lidar": "890 of 900", "laboratory_shift": "2 of 2"}[name] in said
    assert r["cost"] == pytest.approx(p.expect["cost"], rel=1e-7)
    assert r["proven_optimal"] and r["constraints"]["satisfied"]
    assert r["lower_bound"] <= p.expect["cost"] * (1 + 1e-9)

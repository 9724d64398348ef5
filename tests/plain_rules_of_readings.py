"""Rules on readings in plain words, for enumeration: no code of the product.

A schedule is a list of tuples of sensors, one for every reading. Times count in steps k .. k+1 of discrete time.
"""

from __future__ import annotations

import copy
from itertools import islice, pairwise
from typing import Any

import numpy as np

from tests.plain_readings import PlainReadings, evaluated

IDLE = -1


def with_rules(rng: np.random.Generator, document: dict[str, Any]) -> dict[str, Any]:
    """The problem with a few random rules."""
    d = copy.deepcopy(document)
    d.pop("budget", None)
    plain = PlainReadings(d)
    N, limits = len(plain.times), {}
    places = plain.d["select"][1] if isinstance(d["select"], list) else d["select"]

    def some(share: float = 0.4) -> bool:
        return bool(rng.random() < share)

    for sensor in plain.sensors:
        if some():
            sensor["max_uses"] = int(rng.integers(0, N + 1))
        if plain.discrete:
            if some(0.3):
                sensor["min_on"] = int(rng.integers(1, 4))
            if some(0.2):
                sensor["min_off"] = int(rng.integers(1, 4))
            if some(0.2):
                sensor["max_on"] = int(rng.integers(max(1, sensor.get("min_on", 1)), 5))
            if some(0.2):
                sensor["max_time"] = int(rng.integers(1, N + 1))
    if some():
        limits["max_switches"] = int(rng.integers(0, N))
    if some():
        limits["switch_cost"] = float(np.round(rng.uniform(0, 0.3), 3))
    if plain.discrete and some():
        limits["after"] = "enforce"
    minimise = str(rng.choice(["cost", "cost", "error", "observation"]))
    if some(0.3) or minimise == "error":
        worst = sum(max(price(s, t, plain) for s in plain.sensors) for t in plain.times) * places
        limits["max_observation_cost"] = float(np.round(worst * rng.uniform(0.2, 0.9), 4))
    d["objective"]["minimise"] = minimise
    d["constraints"] = limits
    d["method"] = {"name": "schedule", "exact": {"max_nodes": 20000}}
    if minimise == "observation" or some(0.15):
        # an error that some schedules reach and others do not
        rules = PlainRules(d)
        reached = sorted(rules.error.cost(s) for s in islice(rules.plain.schedules(), 400))
        if reached:
            limits["max_error"] = reached[int(rng.integers(len(reached)))] * (1 + 1e-6)
    return d


def price(sensor: dict, t: float, plain: PlainReadings) -> float:
    return float(evaluated(sensor["cost"], "k" if plain.discrete else "t", t))


class PlainRules:
    """Which schedules keep the rules, and what they cost in terms of what is minimised.

    Parameters
    ----------
    document : of `with_rules`
    """

    def __init__(self, document: dict[str, Any]):
        self.d, self.plain = document, PlainReadings(document)
        free = copy.deepcopy(document)
        free["objective"]["cost_weight"] = 0.0
        self.error = PlainReadings(free)
        select = document["select"]
        self.places = select[1] if isinstance(select, list) else select
        self.limits = document["constraints"]
        self.epoch = document["horizon"].get("epoch", 1)

    def sets(self, chosen: list[tuple[int, ...]]) -> list[frozenset[int]]:
        """What is in use, with idle as a sensor of its own where one is used at a time."""
        return [frozenset(c) if c or self.places > 1 else frozenset({IDLE}) for c in chosen]

    def observation(self, chosen: list[tuple[int, ...]]) -> float:
        times, sensors = self.plain.times, self.plain.sensors
        return sum(price(sensors[j], t, self.plain) for t, c in zip(times, chosen, strict=True) for j in c)

    def switching(self, chosen: list[tuple[int, ...]]) -> float:
        each, sets, total = self.limits.get("switch_cost", 0.0), self.sets(chosen), 0.0
        for a, b in pairwise(sets):
            total += each * ((a != b) if self.places == 1 else len(b - a))
        return total

    def keeps(self, chosen: list[tuple[int, ...]]) -> bool:
        sets, limits = self.sets(chosen), self.limits
        changes = sum(a != b for a, b in pairwise(sets))
        if changes > limits.get("max_switches", len(sets)):
            return False
        if self.observation(chosen) > limits.get("max_observation_cost", np.inf) * (1 + 1e-9):
            return False
        if self.error.cost(chosen) > limits.get("max_error", np.inf) * (1 + 1e-9):
            return False
        if "limit" in self.d["objective"].get("criterion", {}) and np.isinf(self.plain.cost(chosen)):
            return False
        return all(self._own(j, s, chosen) for j, s in enumerate(self.plain.sensors))

    def _own(self, j: int, sensor: dict, chosen: list[tuple[int, ...]]) -> bool:
        on = "".join("x" if j in c else "." for c in chosen)
        if on.count("x") > sensor.get("max_uses", len(on)) or on.count("x") > sensor.get("max_time", len(on)):
            return False
        at, enforce = 0, self.limits.get("after") == "enforce"
        while (first := on.find("x", at)) >= 0:
            end = len(on) if (stop := on.find(".", first)) < 0 else stop
            cut = end == len(on) and not enforce
            if end - first > sensor.get("max_on", len(on)) or (end - first < sensor.get("min_on", 0) and not cut):
                return False
            later = on.find("x", end)
            if later >= 0 and later - end < sensor.get("min_off", 0):
                return False
            at = end
        return True

    def value(self, chosen: list[tuple[int, ...]]) -> float:
        """F: what is minimised."""
        what = self.d["objective"]["minimise"]
        if what == "observation":
            return self.observation(chosen) + self.switching(chosen)
        return (self.plain if what == "cost" else self.error).cost(chosen) + self.switching(chosen)

"""Random small problems with rules of every kind, as plain data and as what the search takes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.linalg import expm

from occontrol.scheduling.recursion import Recursion
from occontrol.scheduling.rules.oracle import Oracle
from occontrol.scheduling.rules.rules import Rules
from occontrol.scheduling.rules.task import Goal, Task
from occontrol.scheduling.sweep import Sweep
from tests.scheduling.rules.enumeration import Small

GOALS = {"cost": Goal(1.0, 1.0), "error": Goal(0.0, 1.0), "observation": Goal(1.0, 0.0)}


def small(seed: int, most: int = 7) -> tuple[Small, float, str]:
    """A problem, alpha and what is minimised."""
    rng = np.random.default_rng(seed)
    select = int(rng.choice([1, 1, 1, 2]))
    M = int(rng.integers(2, 4)) if select == 1 else 3
    with_idle = bool(rng.random() < 0.5)
    idle = [False] * M + [True] * with_idle
    M += with_idle
    letters = M if select == 1 else (7 if with_idle else 3)
    N = int(min(most, np.floor(np.log(6000) / np.log(letters + 1))))
    n = int(rng.integers(1, 4))
    h = np.full(N, 0.5) if rng.random() < 0.5 else rng.choice([0.2, 0.3, 0.5, 0.7], N)
    t = np.concatenate([[0.0], np.cumsum(h)]) + rng.choice([0.0, 10.0])
    A = rng.normal(size=(n, n)) * 0.5
    halves = np.concatenate([[h[0] / 2], (h[1:] + h[:-1]) / 2, [h[-1] / 2]])
    F = np.array([expm(A * x) for x in halves])
    G = rng.normal(size=(n, n))
    Q = np.array([0.3 * x * G @ G.T + 0.01 * np.eye(n) for x in halves])
    L = []
    for j in range(M):
        C = rng.normal(size=(int(rng.integers(1, 3)), n))
        L.append(np.zeros((n, n)) if idle[j] else 10 ** rng.uniform(-0.5, 1) * C.T @ C)
    D = rng.normal(size=(1, n))
    R = np.eye(n) * 0.2 if rng.random() < 0.3 else None
    rate = np.where(idle, 0.0, rng.uniform(0.0, 2.0, M))
    upper = np.ones((N, M))
    if rng.random() < 0.3 and select == 1:
        j = int(rng.integers(M))
        if not idle[j]:
            upper[: int(rng.integers(N)), j] = 0.0
    for j in range(M):
        if idle[j]:
            upper[:, j] = select
    real = [j for j in range(M) if not idle[j]]

    def some(chance: float, values, default: float) -> list[float]:
        return [float(rng.choice(values)) if j in real and rng.random() < chance else default for j in range(M)]

    T = t[-1] - t[0]
    strong = rng.random() < 0.5
    many = 0.5 if strong else 0.2
    rules: dict = {
        "min_on": some(many, [0.5, 0.8, 1.0, 1.5], 0.0),
        "max_on": some(many / 2, [0.7, 1.0, 1.5, 2.0], np.inf),
        "min_off": some(many, [0.5, 0.9, 1.0], 0.0),
        "warm": some(many / 2, [0.3, 0.5, 1.0], 0.0),
        "max_uses": some(many / 2, [1, 2], np.inf),
        "max_time": some(many / 2, [0.4 * T, 0.5, 1.5], np.inf),
        "duty": [(float(rng.choice([1.0, 1.4])), float(rng.choice([0.5, 0.7]))) if x else (np.inf, np.inf)
                 for x in some(many / 3, [1.0], 0.0)],
        "revisit": some(many / 4, [1.0, 1.4, 2.0], np.inf),
        "max_switches": int(rng.integers(0, 4)) if rng.random() < 0.3 else None,
        "switch": np.zeros((M, M)),
        "start": 0.0,
        "delay": np.zeros((M, M)),
        "before": None,
        "enforce": bool(rng.random() < 0.4),
        "max_observation": np.inf,
        "max_error": np.inf,
    }  # fmt: skip
    if rng.random() < 0.4:
        if select == 1:
            rules["switch"] = rng.uniform(0, 0.1, (M, M)) * (1 - np.eye(M))
        else:
            rules["start"] = float(rng.uniform(0, 0.1))
    if select == 1 and rng.random() < 0.3:
        rules["delay"] = rng.choice([0.0, 0.3, 0.5, 0.6], (M, M)) * (1 - np.eye(M))
    if select == 1 and rng.random() < 0.3:
        rules["before"] = (int(rng.integers(M)), float(rng.choice([0.2, 0.5, 1.0])))
    goal = "cost"
    if rng.random() < 0.3:
        rules["max_observation"] = float(rng.uniform(0.3, 0.8) * T * np.mean(rate) * select)
        goal = str(rng.choice(["cost", "error"]))
    elif rng.random() < 0.25:
        goal = "observation"
    p = Small(t, F, Q, 2.0 * np.eye(n), D.T @ D, R, L, rate, upper, idle, select, rules)
    return p, float(rng.uniform(0.02, 0.3)), goal


def task_of(p: Small, alpha: float, goal: str) -> Task:
    """The same for the search."""
    N, M = p.upper.shape
    h, r = np.diff(p.times), p.rules
    rules = Rules.none(tuple(f"s{j}" for j in range(M)), np.array(p.idle), p.select)
    same = {"min_on": "min_on", "max_on": "max_on", "min_off": "min_off", "warm_up": "warm", "max_uses": "max_uses",
            "max_time": "max_time", "revisit": "revisit", "switch_cost": "switch", "switch_delay": "delay"}  # fmt: skip
    rules = replace(
        rules,
        **{key: np.array(r[name], dtype=float) for key, name in same.items()},
        duty_window=np.array([w for w, _ in r["duty"]]),
        duty_time=np.array([d for _, d in r["duty"]]),
        start_cost=r["start"],
        max_switches=r["max_switches"],
        before=r["before"],
        enforce=r["enforce"],
        max_observation=r["max_observation"],
        max_error=r["max_error"],
    )
    warm = [j for j in range(M) if r["warm"][j] > 0]
    blocks = [np.zeros((0, len(p.S0))) if p.idle[j] else root(p.L[j]) for j in range(M)]
    sizes = [len(b) for b in blocks] + [0] * len(warm)
    spend = h[:, None] * p.rate
    factor = 1.0 if goal == "observation" else alpha
    cost = factor * np.concatenate([spend, spend[:, warm]], axis=1)
    recursion = Recursion(
        initial=p.S0,
        transition=p.F,
        noise=p.Q,
        predict=np.arange(N + 1),
        rows=np.concatenate(blocks)[None],
        row_set=np.zeros(N, dtype=np.int64),
        offsets=np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
        steps=h,
        cost=np.ascontiguousarray(cost),
        running=np.zeros((0, *p.S0.shape)) if p.R is None else p.R[None],
        running_set=np.zeros(N, dtype=np.int64),
        terminal=p.W,
        available=np.concatenate([p.upper, p.upper[:, warm]], axis=1),
    )
    return Task(rules, p.times, Oracle(rules, p.times, p.upper), Sweep(recursion), spend, GOALS[goal])


def root(L: np.ndarray) -> np.ndarray:
    values, vectors = np.linalg.eigh(L)
    kept = values > 1e-12 * max(values[-1], 1e-300)
    return np.ascontiguousarray((vectors[:, kept] * np.sqrt(values[kept])).T)

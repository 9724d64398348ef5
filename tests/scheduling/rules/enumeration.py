"""Every schedule of a small problem, its rules and its cost: written from the words of the rules, shares no code."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

TOL = 1e-9


@dataclass
class Small:
    """A small problem as plain data: rules is a dict of what a user would write."""

    times: np.ndarray
    F: np.ndarray
    Q: np.ndarray
    S0: np.ndarray
    W: np.ndarray
    R: np.ndarray | None
    L: list[np.ndarray]
    rate: np.ndarray
    upper: np.ndarray
    idle: list[bool]
    select: int
    rules: dict


def length_ok(value: float, limit: float, tol: float) -> bool:
    return value >= limit - tol


def runs_of(use: list[bool]) -> list[tuple[int, int]]:
    found, k = [], 0
    for on, group in itertools.groupby(use):
        size = len(list(group))
        if on:
            found.append((k, k + size))
        k += size
    return found


def allowed(p: Small, word: list[tuple[int, ...]]) -> bool:
    """Whether a word (the set of sensors of every interval, () while slewing) keeps every rule but the error cap."""
    t, r, T = p.times, p.rules, p.times[-1]
    tol, N, M = TOL * (T - t[0]), len(word), len(p.L)
    before = r.get("before")
    for j in range(M):
        if p.idle[j] and p.select > 1:
            continue
        use = runs_of([j in s for s in word])
        past = before[1] if before and before[0] == j else None
        goes_on = past is not None and bool(use) and use[0][0] == 0
        on, off = r["min_on"][j], r["min_off"][j]
        if past is not None and not goes_on and past < on - tol:
            return False
        for a, b in use:
            span = t[b] - t[a] + (past if goes_on and a == 0 else 0.0)
            if span < on - tol and (b < N or r.get("enforce")):
                return False
            if span > r["max_on"][j] + tol:
                return False
        stops = [t[b] for _, b in use]
        starts = [t[a] for a, _ in use]
        if past is not None and not goes_on:
            stops = [t[0], *stops]
        else:
            starts = starts[1:]
        if any(b - a < off - tol for a, b in zip(stops, starts, strict=False)):
            return False
        if len(use) - goes_on > r["max_uses"][j]:
            return False
        if sum(t[b] - t[a] for a, b in use) > r["max_time"][j] + tol:
            return False
        window, most = r["duty"][j]
        if np.isfinite(window):
            corners = sorted({x + d for a, b in use for x in (t[a], t[b]) for d in (0.0, -window)} | {t[0], T - window})
            for s in corners:
                if s >= t[0] - tol and s + window <= T + tol:
                    on_time = sum(max(0.0, min(t[b], s + window) - max(t[a], s)) for a, b in use)
                    if on_time > most + tol:
                        return False
        pauses = zip([t[0], *(t[b] for _, b in use)], [*(t[a] for a, _ in use), T], strict=True)
        if any(b - a > r["revisit"][j] + tol for a, b in pauses):
            return False
    sequence: list[tuple[int, int, tuple[int, ...]]] = [(0, 0, (before[0],))] if before else []
    k = 0
    for s, group in itertools.groupby(word):
        size = len(list(group))
        if s or p.select > 1:
            sequence.append((k, k + size, s))
        elif k + size == N or (k == 0 and not before):
            return False
        k += size
    changes = 0
    for (_, end, old), (start, _, new) in itertools.pairwise(sequence):
        if old == new:
            if start != end:
                return False
            continue
        changes += 1
        if p.select == 1:
            delay = r["delay"][old[0]][new[0]]
            first = end
            while first < N and t[first] - t[end] < delay - tol:
                first += 1
            if t[first] - t[end] < delay - tol or start != first:
                return False
    if r["max_switches"] is not None and changes > r["max_switches"]:
        return False
    return spent(p, word) <= r["max_observation"] * (1 + 1e-9)


def spent(p: Small, word: list[tuple[int, ...]]) -> float:
    h = np.diff(p.times)
    return sum(h[k] * p.rate[j] for k, s in enumerate(word) for j in s)


def switching(p: Small, word: list[tuple[int, ...]]) -> float:
    before = p.rules.get("before")
    chain = [s for s in word if s or p.select > 1]
    chain = [(before[0],), *chain] if before else chain
    total = 0.0
    for old, new in itertools.pairwise(chain):
        if old != new:
            total += p.rules["switch"][old[0]][new[0]] if p.select == 1 else p.rules["start"] * len(set(new) - set(old))
    return total


def measures(p: Small, word: list[tuple[int, ...]], k: int, j: int) -> bool:
    """Whether a sensor that is on has warmed up."""
    a = k
    while a > 0 and j in word[a - 1]:
        a -= 1
    before = p.rules.get("before")
    if a == 0 and before and before[0] == j:
        return True
    return p.times[k] - p.times[a] >= p.rules["warm"][j] - TOL * (p.times[-1] - p.times[0])


def error(p: Small, word: list[tuple[int, ...]]) -> float:
    """tr(W S) at the end and the running part; the order is predict, update, .., predict."""
    S, total = p.S0, 0.0
    h = np.diff(p.times)
    for k, s in enumerate(word):
        S = p.F[k] @ S @ p.F[k].T + p.Q[k]
        total += 0.0 if p.R is None else 0.5 * h[k] * np.trace(p.R @ S)
        info = sum((p.L[j] for j in s if measures(p, word, k, j)), np.zeros_like(S))
        S = np.linalg.inv(np.linalg.inv(S) + h[k] * info)
        total += 0.0 if p.R is None else 0.5 * h[k] * np.trace(p.R @ S)
    S = p.F[-1] @ S @ p.F[-1].T + p.Q[-1]
    return total + float(np.trace(p.W @ S))


def words(p: Small):
    N, M = p.upper.shape
    real = [j for j in range(M) if not p.idle[j]]
    if p.select == 1:
        letters = [(j,) for j in range(M)]
        if np.any(np.array(p.rules["delay"]) > 0):
            letters.append(())
    else:
        sizes = range(0, p.select + 1) if any(p.idle) else [p.select]
        letters = [s for size in sizes for s in itertools.combinations(real, size)]
    options = [[s for s in letters if all(p.upper[k, j] > 0 for j in s)] for k in range(N)]
    yield from itertools.product(*options)


def optimum(p: Small, alpha: float, goal: str = "cost") -> tuple[float, int]:
    """The least cost of all words that keep the rules, and their number; inf and 0 where there are none."""
    best, count = np.inf, 0
    for word in words(p):
        if not allowed(p, list(word)):
            continue
        e = error(p, list(word))
        if e > p.rules["max_error"] * (1 + 1e-9):
            continue
        count += 1
        q = spent(p, list(word))
        value = {"cost": alpha * q + e, "error": e, "observation": q}[goal] + switching(p, list(word))
        best = min(best, value)
    return best, count

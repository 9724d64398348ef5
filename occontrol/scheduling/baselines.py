"""The simple policies that every clever one has to beat: best single, round robin, random, greedy."""

from __future__ import annotations

import numpy as np

from occontrol.families.athans.discretise import Recursion
from occontrol.scheduling.polytope import vertex
from occontrol.scheduling.sweep import Sweep


def _by_priority(recursion: Recursion, priority: np.ndarray) -> np.ndarray:
    """On every interval the available sensors with the smallest priority (N, M) or (M,)."""
    return vertex(np.broadcast_to(priority, recursion.upper.shape).astype(float), recursion.upper, recursion.select)


def best_single(sweep: Sweep) -> np.ndarray:
    """The best fixed set of sensors, built one sensor at a time; a sensor out of its window is replaced by the next.

    Parameters
    ----------
    sweep : Sweep

    Returns (N, M) integral policy.
    """
    r, M = sweep.recursion, sweep.recursion.sensors
    rank = np.arange(M) + float(M)
    # idle sensors (no rows) stand in first where a chosen one is not available
    rank[np.diff(r.offsets) == 0] -= M
    best, cost = _by_priority(r, rank), np.inf
    for place in range(r.select):
        candidates = []
        for j in range(M):
            if rank[j] < 0:
                continue
            trial = rank.copy()
            trial[j] = place - 2.0 * r.select
            weights = _by_priority(r, trial)
            candidates.append((sweep.cost(weights), j, weights, trial))
        lowest = min(candidates, key=lambda c: c[0])
        if lowest[0] < cost:
            cost, _, best, rank = lowest
        else:
            break
    return best


def round_robin(recursion: Recursion, dwell: int = 1) -> np.ndarray:
    """The sensors in turn, `dwell` intervals each, those out of their windows skipped; idle only as a last resort.

    Parameters
    ----------
    recursion : Recursion
    dwell : intervals between switches

    Returns (N, M) integral policy.
    """
    r, M = recursion, recursion.sensors
    idle = np.diff(r.offsets) == 0
    result = np.zeros_like(r.upper)
    last_used = np.full(M, -1.0) - np.arange(M)[::-1] * 1e-3
    for k in range(r.intervals):
        if k % dwell == 0 or np.any(result[k - 1] > r.upper[k]):
            priority = np.where(idle, np.inf, last_used)
            priority[idle] = 1e18
            result[k] = vertex(priority[None], r.upper[k : k + 1], r.select)[0]
        else:
            result[k] = result[k - 1]
        used = result[k] > 0
        last_used[used] = k + np.arange(M)[used] * 1e-6
    return result


def random_policy(recursion: Recursion, seed: int = 1) -> np.ndarray:
    """An independent random available choice on every interval.

    Parameters
    ----------
    recursion : Recursion
    seed : of numpy's default generator

    Returns (N, M) integral policy.
    """
    return vertex(np.random.default_rng(seed).random(recursion.upper.shape), recursion.upper, recursion.select)


def greedy(recursion: Recursion) -> np.ndarray:
    """On every interval the choice that would be best if no measurement followed it.

    It minimises alpha q h + tr(W_k S+), W_k = Phi(Tp, t_k)'D'D Phi(Tp, t_k), place by place.

    Parameters
    ----------
    recursion : Recursion

    Returns (N, M) integral policy.
    """
    r, N, M = recursion, recursion.intervals, recursion.sensors
    weight = np.empty((N, *r.initial.shape))
    W = r.terminal
    for k in range(N, 0, -1):
        F = r.transition[r.predict[k]]
        W = F.T @ W @ F
        if len(r.running):
            W = W + r.steps[k - 1] * r.running[r.running_set[k - 1]]
        weight[k - 1] = W
    result = np.zeros((N, M))
    S = r.initial
    for k in range(N):
        F = r.transition[r.predict[k]]
        S = F @ S @ F.T + r.noise[r.predict[k]]
        rows, h = r.rows[r.row_set[k]], r.steps[k]
        room = r.upper[k].copy()
        for _ in range(r.select):
            best, best_value, best_S = -1, np.inf, S
            for j in np.flatnonzero(room > 0.5):
                C = rows[r.offsets[j] : r.offsets[j + 1]] * np.sqrt(h)
                B = C @ S
                after = S - B.T @ np.linalg.solve(np.eye(len(C)) + B @ C.T, B) if len(C) else S
                value = r.cost[k, j] + float(np.sum(weight[k] * after))
                if value < best_value:
                    best, best_value, best_S = int(j), value, after
            result[k, best] += 1.0
            room[best] -= 1.0
            S = (best_S + best_S.T) / 2
    return result

"""The simple policies that every clever one has to beat: best single, round robin, random, greedy."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from occontrol.scheduling.feasible_set import FeasibleSet
from occontrol.scheduling.objective import RecursiveObjective
from occontrol.scheduling.recursion import Recursion


def _by_priority(feasible_set: FeasibleSet, priority: np.ndarray) -> np.ndarray:
    """On every interval the available sensors with the smallest priority (N, M) or (M,)."""
    return feasible_set.vertex(np.broadcast_to(priority, feasible_set.shape).astype(float))


def best_single(sweep: RecursiveObjective, feasible_set: FeasibleSet) -> np.ndarray:
    """The best fixed set of sensors, built one sensor at a time; a sensor out of its window is replaced by the next.

    Parameters
    ----------
    sweep : Sweep, or another objective on a recursion
    feasible_set : FeasibleSet of the policies

    Returns (N, M) integral policy.
    """
    r, M = sweep.recursion, sweep.recursion.sensors
    rank = np.arange(M) + float(M)
    # idle sensors (no rows) stand in first where a chosen one is not available
    rank[np.diff(r.offsets) == 0] -= M
    best, cost = _by_priority(feasible_set, rank), np.inf
    for place in range(feasible_set.places):
        candidates = []
        for j in range(M):
            if rank[j] < 0:
                continue
            trial = rank.copy()
            trial[j] = place - 2.0 * feasible_set.places
            weights = _by_priority(feasible_set, trial)
            candidates.append((sweep.cost(weights), j, weights, trial))
        lowest = min(candidates, key=lambda c: c[0])
        if lowest[0] < cost:
            cost, _, best, rank = lowest
        else:
            break
    return best


def round_robin(recursion: Recursion, feasible_set: FeasibleSet, dwell: int = 1) -> np.ndarray:
    """The sensors in turn, `dwell` intervals each, those out of their windows skipped; idle only as a last resort.

    Parameters
    ----------
    recursion : Recursion
    feasible_set : FeasibleSet of the policies
    dwell : intervals between switches

    Returns (N, M) integral policy.
    """
    M = recursion.sensors
    idle = np.diff(recursion.offsets) == 0
    result = np.zeros(feasible_set.shape)
    last_used = np.full(M, -1.0) - np.arange(M)[::-1] * 1e-3
    for k in range(len(result)):
        here = feasible_set.part(k, k + 1)
        if k % dwell == 0 or not here.contains(result[k - 1 : k]):
            priority = np.where(idle, np.inf, last_used)
            priority[idle] = 1e18
            result[k] = here.vertex(priority[None])[0]
        else:
            result[k] = result[k - 1]
        used = result[k] > 0
        last_used[used] = k + np.arange(M)[used] * 1e-6
    return result


def random_policy(feasible_set: FeasibleSet, seed: int = 1) -> np.ndarray:
    """An independent random available choice on every interval.

    Parameters
    ----------
    feasible_set : FeasibleSet of the policies
    seed : of numpy's default generator

    Returns (N, M) integral policy.
    """
    return feasible_set.vertex(np.random.default_rng(seed).random(feasible_set.shape))


def greedy(
    recursion: Recursion, feasible_set: FeasibleSet, later: Callable[[int, np.ndarray], float] | None = None
) -> np.ndarray:
    """On every interval the choice that would be best if no measurement followed it.

    It minimises alpha q h + tr(W_k S+), W_k = Phi(Tp, t_k)'D'D Phi(Tp, t_k), place by place; where a decision has
    several steps, S+ is that after the last one, and the running charge of the earlier ones is added.

    Parameters
    ----------
    recursion : Recursion
    feasible_set : FeasibleSet of the policies
    later : (k, S+ (n, n)) -> what is minimised in the place of tr(W_k S+), for another criterion than the trace

    Returns (N, M) integral policy.
    """
    r, price = recursion, recursion.decision_cost
    value_later = later or _least_trace(r)
    ends = np.append(r.first_steps, len(r.steps))
    result = np.zeros(feasible_set.shape)
    S = r.initial
    for k in range(len(result)):
        steps, here = range(ends[k], ends[k + 1]), feasible_set.part(k, k + 1)
        chosen: list[int] = []
        best_S = S
        for _ in range(feasible_set.places):
            best, best_value = -1, np.inf
            for j in np.flatnonzero(_open(here, result[k])):
                after, running = _follow(r, S, steps, [*chosen, int(j)])
                value = price[k, j] + running + value_later(steps[-1], after)
                if value < best_value:
                    best, best_value, best_S = int(j), value, after
            result[k, best] += 1.0
            chosen.append(best)
        S = (best_S + best_S.T) / 2
    return result


def _least_trace(r: Recursion) -> Callable[[int, np.ndarray], float]:
    """tr(W_k S+)."""
    weight = later_weights(r)
    return lambda k, S: float(np.sum(weight[k] * S))


def _open(here: FeasibleSet, chosen: np.ndarray) -> np.ndarray:
    """(M,) which sensors one interval may use besides those `chosen` (M,)."""
    return here.exchange_masks(chosen[None])[1][0]


def later_weights(recursion: Recursion) -> np.ndarray:
    """(K, n, n): the cost of S+ after each step of a `recursion` if nothing is measured later."""
    r = recursion
    weight = np.empty((len(r.steps), *r.initial.shape))
    W = r.terminal
    for k in range(len(r.steps), 0, -1):
        F = r.transition[r.predict[k]]
        W = F.T @ W @ F
        if len(r.running):
            before, after = _charged_at(r, k - 1)
            W = W + after * r.running[r.running_set[k - 1]]
        weight[k - 1] = W
        if len(r.running):
            W = W + before * r.running[r.running_set[k - 1]]
    return weight


def _charged_at(r: Recursion, k: int) -> tuple[float, float]:
    """How much of the running weight is charged before and after update k; continuous time charges all of it after."""
    if r.charge is None:
        return 0.0, float(r.steps[k])
    return float(r.charge[k, 0]), float(r.charge[k, 1])


def _follow(r: Recursion, S: np.ndarray, steps: range, used: list[int]) -> tuple[np.ndarray, float]:
    """S+ after the steps of one decision with the sensors `used`, and the running charge of all steps but the last."""
    running = 0.0
    for k in steps:
        F = r.transition[r.predict[k]]
        S = F @ S @ F.T + r.noise[r.predict[k]]
        before, after = _charged_at(r, k)
        if len(r.running) and k > steps[0]:
            running += before * float(np.sum(r.running[r.running_set[k]] * S))
        for j in used:
            C = r.rows[r.row_set[k]][r.offsets[j] : r.offsets[j + 1]] * np.sqrt(r.steps[k])
            B = C @ S
            S = S - B.T @ np.linalg.solve(np.eye(len(C)) + B @ C.T, B) if len(C) else S
        if len(r.running) and k < steps[-1]:
            running += after * float(np.sum(r.running[r.running_set[k]] * S))
    return S, running

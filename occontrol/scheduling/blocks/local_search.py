"""Whole looks improved by exact single changes: exchanges on one interval, and looks that trade places in time.

A change touches one or two targets. Its effect is exact (single.py), and only changes that lower the cost are made, so
the schedule stays allowed and the cost falls. Kinds: a look goes from one target to another on the same interval, a
look is added where a resource has room, a look is dropped where it costs more than it gains, and two targets of one
resource trade looks on intervals at most REACH apart.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from occontrol.core.monitor import Monitor
from occontrol.scheduling.blocks.resources import ResourceSet
from occontrol.scheduling.blocks.single import Singles, all_costs, target_cost, work_space

_OPTIONS = {"cache": True, "nogil": True, "error_model": "numpy"}
REACH = 12
SHARE_OF_TRADES = 0.75
BATCH = 2.0e7  # steps of one block between two looks at the clock
LEAST = 1e-12  # of the cost: a smaller gain is rounding


@njit(**_OPTIONS)
def _draw(state, below):
    """A random number 0 .. below - 1; `state` (1,) of 64 bits moves on."""
    state[0] = state[0] * np.uint64(6364136223846793005) + np.uint64(1442695040888963407)
    return int((state[0] >> np.uint64(33)) % np.uint64(below))


@njit(**_OPTIONS)
def _find(target, a, z, wanted):
    """The place of a target among those listed from a to z, in ascending order; -1 where it is not."""
    low, high = a, z
    while low < high:
        middle = (low + high) // 2
        if target[middle] < wanted:
            low = middle + 1
        else:
            high = middle
    return low if low < z and target[low] == wanted else -1


@njit(**_OPTIONS)
def _used(x, a, z, state, but):
    """A random look from a to z that is taken, not `but`; -1 where there is none."""
    start = _draw(state, z - a)
    for shift in range(z - a):
        o = a + (start + shift) % (z - a)
        if x[o] > 0.5 and o != but:
            return o
    return -1


@njit(**_OPTIONS)
def _trade(e, o, to_e, to_o, x, target, price, costs, data, work, least):
    """Two targets trade looks e and o for to_o and to_e; the gain, 0 where it was undone."""
    x[e], x[o], x[to_e], x[to_o] = 0.0, 0.0, 1.0, 1.0
    i, j = target[e], target[o]
    one, two = target_cost(i, x, data, work), target_cost(j, x, data, work)
    change = one + two - costs[i] - costs[j] + price[to_o] + price[to_e] - price[e] - price[o]
    if change < -least:
        costs[i], costs[j] = one, two
        return -change
    x[e], x[o], x[to_e], x[to_o] = 1.0, 1.0, 0.0, 0.0
    return 0.0


@njit(**_OPTIONS)
def _drop(e, rest, x, target, price, costs, data, work, least):
    """Look e is left out; the gain, 0 where it was undone."""
    i = target[e]
    x[e] = 0.0
    one = target_cost(i, x, data, work)
    change = one - costs[i] - price[e]
    if change < -least:
        costs[i] = one
        x[rest] += 1.0
        return -change
    x[e] = 1.0
    return 0.0


@njit(**_OPTIONS)
def _add(e, o, rest, x, target, price, costs, data, work, least):
    """Look e is taken, in the place of o (-1: of room that is left); the gain, 0 where it was undone."""
    j = target[e]
    x[e] = 1.0
    two = target_cost(j, x, data, work)
    change, one, i = two - costs[j] + price[e], 0.0, -1
    if o >= 0 and change < 0.0:
        i = target[o]
        x[o] = 0.0
        one = target_cost(i, x, data, work)
        change += one - costs[i] - price[o]
    if change < -least:
        costs[j] = two
        if o >= 0:
            costs[i] = one
        else:
            x[rest] -= 1.0
        return -change
    x[e] = 0.0
    if o >= 0:
        x[o] = 1.0
    return 0.0


@njit(**_OPTIONS)
def _search(tries, state, x, target, starts, near, reach, price, costs, data, trades, least):
    """At most `tries` random changes of x (E,), in place; returns how much the cost fell and how many were made."""
    work = work_space(data)
    gained, made = 0.0, 0
    for _ in range(tries):
        s = _draw(state, len(starts) - 1)
        a, z = starts[s], starts[s + 1] - 1
        if z <= a:
            continue
        e = a + _draw(state, z - a)
        gain = 0.0
        if _draw(state, 1_000_000) < trades:
            other = near[s, _draw(state, 2 * reach + 1)]
            if x[e] < 0.5 or other < 0 or other == s:
                continue
            oa, oz = starts[other], starts[other + 1] - 1
            o = _used(x, oa, oz, state, -1) if oz > oa else -1
            if o < 0 or target[o] == target[e]:
                continue
            to_o, to_e = _find(target, oa, oz, target[e]), _find(target, a, z, target[o])
            if to_o >= 0 and to_e >= 0 and x[to_o] < 0.5 and x[to_e] < 0.5:
                gain = _trade(e, o, to_e, to_o, x, target, price, costs, data, work, least)
        elif x[e] > 0.5:
            if price[e] > 0.0:
                gain = _drop(e, z, x, target, price, costs, data, work, least)
        elif x[z] > 0.5:
            gain = _add(e, -1, z, x, target, price, costs, data, work, least)
        else:
            o = _used(x, a, z, state, e)
            if o >= 0:
                gain = _add(e, o, z, x, target, price, costs, data, work, least)
        gained += gain
        made += gain > 0.0
    return gained, made


def improve(
    weights: np.ndarray,
    allowed: ResourceSet,
    target: np.ndarray,
    resource: np.ndarray,
    price: np.ndarray,
    data: Singles,
    work: float,
    monitor: Monitor,
    seed: int = 1,
) -> tuple[np.ndarray, int]:
    """A schedule that costs no more, (E, 1), and how many changes led to it.

    Parameters
    ----------
    weights : (E, 1) whole looks
    allowed : ResourceSet
    target, resource, price : (E,) of every look; target is -1 for what is left over
    data : Singles
    work : steps of a block of two states that may be spent; larger ones count by the square of their size
    monitor : Monitor
    seed : of the random changes
    """
    x = np.ascontiguousarray(weights[:, 0]).copy()
    costs = np.empty(len(data.blocks) - 1)
    all_costs(x, data.arrays, costs)
    value = float(np.sum(costs) + price @ x)
    size = np.add.reduceat(data.sizes[:, 0] ** 2, data.blocks[:-1]) if len(data.blocks) > 1 else np.ones(1)
    steps = 2.0 * len(data.steps) * max(1.0, float(np.mean(size)) / 4)
    near = _near(allowed.interval, resource[allowed.starts[:-1]], REACH)
    state = np.array([seed], dtype=np.uint64)
    left, made = work / steps, 0
    while left >= 1 and not monitor.stop:
        tries = int(min(max(100.0, BATCH / steps), left))
        gained, count = _search(
            tries, state, x, target, allowed.starts, near, REACH, price, costs, data.arrays,
            int(1_000_000 * SHARE_OF_TRADES), LEAST * abs(value),
        )  # fmt: skip
        made, left, value = made + count, left - tries, value - gained
    return x[:, None], made


def _near(interval: np.ndarray, resource: np.ndarray, reach: int) -> np.ndarray:
    """(S, 2 reach + 1) the stretch of the same resource so many intervals on; -1 where there is none."""
    R = int(np.max(resource, initial=0)) + 1
    where = np.full((int(np.max(interval, initial=0)) + 1 + 2 * reach, R), -1, dtype=np.int64)
    where[interval + reach, resource] = np.arange(len(interval))
    return where[interval[:, None] + np.arange(2 * reach + 1), resource[:, None]]

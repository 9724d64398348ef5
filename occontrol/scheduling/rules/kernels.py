"""Compiled loops over the transitions of an automaton: the cheapest path, and what can be reached."""

from __future__ import annotations

import numpy as np
from numba import njit

OPTIONS = {"cache": True, "nogil": True}


@njit(**OPTIONS)
def cheapest(table, first, tail, head, action, event, price, entry, value, before):
    """value[k+1, q] = min over transitions of value[k, tail] + price[k, action] + entry[k, event]; which one it was.

    table (N,), first (T+1,), tail .. event (E,), price (N, A), entry (N, V); value (N+1, Q) holds inf but for the
    first state, before (N+1, Q)
    """
    N = table.shape[0]
    for k in range(N):
        t = table[k]
        for e in range(first[t], first[t + 1]):
            known = value[k, tail[e]]
            if known < 1e300:
                x = known + price[k, action[e]] + entry[k, event[e]]
                if x < value[k + 1, head[e]]:
                    value[k + 1, head[e]] = x
                    before[k + 1, head[e]] = e


@njit(**OPTIONS)
def least_through(table, first, tail, head, action, event, price, entry, value, rest, least):
    """least[k, a] = the cheapest path whose action on interval k is a, for all k and a.

    Arrays as in `cheapest`, whose `value` (N+1, Q) is complete; rest (N+1, Q) holds 0 at the end where a path may end
    and inf elsewhere, least (N, A) inf.
    """
    N = table.shape[0]
    for k in range(N - 1, -1, -1):
        t = table[k]
        for e in range(first[t], first[t + 1]):
            onward = rest[k + 1, head[e]]
            if onward < 1e300:
                x = price[k, action[e]] + entry[k, event[e]] + onward
                if x < rest[k, tail[e]]:
                    rest[k, tail[e]] = x
                whole = value[k, tail[e]] + x
                if whole < least[k, action[e]]:
                    least[k, action[e]] = whole


@njit(**OPTIONS)
def along(before, tail, last, path):
    """The transitions (N,) of the path that ends in state `last`."""
    state = last
    for k in range(path.shape[0], 0, -1):
        path[k - 1] = before[k, state]
        state = tail[before[k, state]]


@njit(**OPTIONS)
def walk(table, begin, head, group, cost, labels, start, final):
    """What the changes of the one path cost whose actions belong to the groups `labels` (N,); inf where there is none.

    begin (T, Q+1) where the transitions of a state begin, head, group, cost (E,); NaN where groups do not tell paths
    apart
    """
    state, total = start, 0.0
    for k in range(labels.shape[0]):
        t, taken = table[k], -1
        for e in range(begin[t, state], begin[t, state + 1]):
            if group[e] == labels[k]:
                if taken >= 0:
                    return np.nan
                taken = e
        if taken < 0:
            return np.inf
        total += cost[taken]
        state = head[taken]
    return total if final[state] else np.inf

"""Compiled: what one target costs that is looked at now and then, from below: a graph of gaps between looks.

Letter 0 is a step without a look, others are looks. S0 is the smallest covariance, below which nothing stays. What
a look leaves behind after a gap of g steps is at least what it leaves where the covariance was S0 when the gap began;
one gap more is remembered where there is room. So every schedule is a path in a graph whose nodes are the last gaps,
and whose edges are the next one: an edge (gap g, look a) costs what its steps charge at least. With a price for looks
the least mean cost a step is the least ratio of cost and length of a cycle, and for any potential v of the nodes
    rho >= min over edges [cost + price + v(to) - v(from)] / g.
Gaps beyond the table: from S0 without a look the covariance only grows, so each further step costs at least as much as
step G there, and the look after it leaves at least what it leaves after G steps from S0.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from occontrol.scheduling.periodic.kernels import HUGE, charge_of, predict, update
from occontrol.scheduling.periodic.matrices import OPTIONS, trace

UNREACHED, ON_PATH, DONE = 0, 1, 2
ROUNDS = 500  # of improving a policy


@njit(**OPTIONS)
def _step(F, Q, L, seen, weight, constant, a, S):
    """The covariance (n, n) after letter a from S (n, n), and its charge; letters as in `Letters`."""
    charge = charge_of(S, seen[a], weight[a], constant[a])
    return predict(F[a], Q[a], update(S, L[a])), charge


@njit(**OPTIONS)
def first_gaps(F, Q, L, seen, weight, constant, most):
    """After gaps of 1 .. `most` steps from S0 = 1: what each look leaves (most, A-1, n, n), and the charge of a step
    without a look after `most` of them. The gap ends with its look."""
    n, A = F.shape[1], F.shape[0]
    left = np.empty((most, A - 1, n, n))
    S = np.zeros((n, n))
    for i in range(n):
        S[i, i] = 1.0
    for g in range(most):
        for a in range(1, A):
            left[g, a - 1], _ = _step(F, Q, L, seen, weight, constant, a, S)
        S, _ = _step(F, Q, L, seen, weight, constant, 0, S)
    return left, charge_of(S, seen[0], weight[0], constant[0])


@njit(**OPTIONS)
def gap_costs(F, Q, L, seen, weight, constant, S, costs, left, keep):
    """Fills `costs` (most, A-1) of gaps from S (n, n) that end with a look, and, with `keep`, `left` behind it.

    Returns the charge of `most` steps without a look. Where the covariance leaves all bounds the rest is inf.
    """
    most, looks = costs.shape
    idle = 0.0
    for g in range(most):
        if not trace(S) < HUGE:
            costs[g:] = np.inf
            return np.inf
        for a in range(1, looks + 1):
            after, charge = _step(F, Q, L, seen, weight, constant, a, S)
            costs[g, a - 1] = idle + charge
            if keep:
                left[g, a - 1] = after
        S, charge = _step(F, Q, L, seen, weight, constant, 0, S)
        idle += charge
    return idle


@njit(**OPTIONS)
def gap_graph(F, Q, L, seen, weight, constant, most, deep):
    """The graph of gaps up to `most` steps: costs and last of its edges, and the charge of a step beyond it.

    With M = most (A-1) pairs of gap and look, nodes are the last pair, 0 .. M-1, with `deep` after them the last two,
    M + M (pair before) + pair. costs (nodes, M) of the next pair; last (nodes, A-1) of a gap of most+1 steps.
    """
    n, looks = F.shape[1], F.shape[0] - 1
    first, further = first_gaps(F, Q, L, seen, weight, constant, most)
    M = most * looks
    nodes = M + (M * M if deep else 0)
    costs, last = np.empty((nodes, M)), np.empty((nodes, looks))
    beyond = np.empty(looks)  # least charges of a look after more than `most` steps
    S = np.zeros((n, n))
    for i in range(n):
        S[i, i] = 1.0
    for _ in range(most):
        S, _ = _step(F, Q, L, seen, weight, constant, 0, S)
    for a in range(looks):
        beyond[a] = charge_of(S, seen[a + 1], weight[a + 1], constant[a + 1])
    row, left = np.empty((most, looks)), np.empty((most, looks, n, n))
    nothing = np.empty((1, looks, n, n))
    for i in range(M):
        idle = gap_costs(F, Q, L, seen, weight, constant, first[i // looks, i % looks], row, left, deep)
        costs[i] = row.ravel()
        last[i] = idle + beyond
        if deep:
            before = left.copy()
            for j in range(M):
                node = M + M * i + j
                idle = gap_costs(F, Q, L, seen, weight, constant, before[j // looks, j % looks], row, nothing, False)
                costs[node] = row.ravel()
                last[node] = idle + beyond
    return costs, last, further


@njit(**OPTIONS)
def _edge(costs, last, price, looks, node, e):
    """Cost with its price, length and end of edge e of a node; the last `looks` edges are those beyond the table."""
    M = costs.shape[1]
    most = M // looks
    a = e % looks
    if e >= M:
        return last[node, a] + price[a], most + 1, (most - 1) * looks + a
    to = e
    if costs.shape[0] > M:  # the last two pairs; a node of the last pair alone forgets
        mine = node if node < M else (node - M) % M
        to = M + M * mine + e
    return costs[node, e] + price[a], e // looks + 1, to


@njit(**OPTIONS)
def least_ratio(costs, last, further, price, looks, policy, v):
    """The least ratio of a cycle by improving a policy: (proven, reached, start) with `policy` and `v` (nodes,) filled.

    `proven` is the bound that v proves for every path, `reached` the ratio of the cycle of the policy through node
    `start` (inf and -1 where to look at nothing costs least); `price` (A-1,) of the looks.
    """
    nodes, E = costs.shape[0], costs.shape[1] + looks
    best, start = np.inf, -1
    state, order = np.empty(nodes, np.int64), np.empty(nodes, np.int64)
    for _ in range(ROUNDS):
        # the best cycle of the policy
        best, start = np.inf, -1
        state[:] = UNREACHED
        for first in range(nodes):
            count, node = 0, first
            while state[node] == UNREACHED:
                state[node] = ON_PATH
                order[count] = node
                count += 1
                _, _, node = _edge(costs, last, price, looks, node, policy[node])
            if state[node] == ON_PATH:
                cost, length, at = 0.0, 0.0, node
                while True:
                    c, g, to = _edge(costs, last, price, looks, at, policy[at])
                    cost += c
                    length += g
                    at = to
                    if at == node:
                        break
                if cost / length < best:
                    best, start = cost / length, node
            for k in range(count):
                state[order[k]] = DONE
        if start < 0:
            break
        # what the nodes that lead to it are worth under the policy
        state[:] = UNREACHED
        state[start] = DONE
        v[start] = 0.0
        for first in range(nodes):
            count, node = 0, first
            while state[node] == UNREACHED:
                state[node] = ON_PATH
                order[count] = node
                count += 1
                _, _, node = _edge(costs, last, price, looks, node, policy[node])
            elsewhere = state[node] == ON_PATH  # they lead to another cycle and keep what they have
            for k in range(count - 1, -1, -1):
                c, g, to = _edge(costs, last, price, looks, order[k], policy[order[k]])
                if not elsewhere:
                    v[order[k]] = c - best * g + v[to]
                state[order[k]] = DONE
        improved = False
        for node in range(nodes):
            now, taken = v[node], -1
            for e in range(E):
                c, g, to = _edge(costs, last, price, looks, node, e)
                other = c - best * g + v[to]
                if other < now - 1e-12 * (abs(best) + abs(v[node])):
                    now, taken = other, e
            if taken >= 0:
                v[node] = now
                policy[node] = taken
                improved = True
        if not improved:
            break
    proven = further
    for node in range(nodes):
        for e in range(E):
            c, g, to = _edge(costs, last, price, looks, node, e)
            proven = min(proven, (c + v[to] - v[node]) / g)
    return proven, best, start


@njit(**OPTIONS)
def cycle_of_policy(costs, last, price, looks, policy, start, word):
    """Fills `word` with the letters of the cycle of a policy through a node; its length, 0 where it is too long."""
    node, length = start, 0
    while True:
        e = policy[node]
        _, g, to = _edge(costs, last, price, looks, node, e)
        if length + g > word.shape[0]:
            return 0
        word[length : length + g] = 0
        word[length + g - 1] = e % looks + 1
        length += g
        node = to
        if node == start:
            return length

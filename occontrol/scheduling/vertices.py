"""The relaxation over a set that is known by its cheapest schedules only: simplicial decomposition.

minimise J(sum_p lam_p w_p) over shares lam of known schedules, then add the schedule that is cheapest for the
gradient there; J(v) - v.g + min w.g bounds J over the whole set at every step (von Hohenbalken 1977).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.core.solution import Certificate, Status
from occontrol.scheduling.budget import BudgetSet
from occontrol.scheduling.feasible_set import FeasibleSet, IntervalPolytopes
from occontrol.scheduling.objective import Objective
from occontrol.scheduling.relaxation import RelaxedOptions, RelaxedOutcome, minimise_relaxed

SMALL = 1e-10  # a share below which a schedule is dropped
STEPS = 100  # of one master
SHARE = 0.2  # of the gap that the master may leave
LEAST = 1e-13  # of the cost: what a move must save
PAIRED = 40  # moves of which two are tried at once
MANY_MOVES, SPARE = 200_000, 4  # moves that are no longer all ranked, and times those tried that are ranked then


@dataclass
class _Shares:
    """J on the shares (1, P) of known schedules (P, N, M)."""

    objective: Objective
    columns: np.ndarray
    forward_count: int = 0
    backward_count: int = 0

    @property
    def shape(self) -> tuple[int, int]:
        return 1, len(self.columns)

    @property
    def states(self) -> int:
        return self.objective.states

    def policy(self, shares: np.ndarray) -> np.ndarray:
        return np.tensordot(shares[0], self.columns, 1)

    def cost(self, weights: np.ndarray) -> float:
        self.forward_count += 1
        return self.objective.cost(self.policy(weights))

    def cost_and_gradient(self, weights: np.ndarray) -> tuple[float, np.ndarray]:
        self.forward_count += 1
        self.backward_count += 1
        J, g = self.objective.cost_and_gradient(self.policy(weights))
        return J, np.tensordot(self.columns, g, 2)[None]


@dataclass
class _Flat:
    """J on the readings of all instants as one row (1, N (M-1)), idle filling up."""

    objective: Objective
    allowed: BudgetSet
    forward_count: int = 0
    backward_count: int = 0

    @property
    def shape(self) -> tuple[int, int]:
        return 1, self.allowed.shape[0] * len(self.allowed.real)

    @property
    def states(self) -> int:
        return self.objective.states

    def policy(self, row: np.ndarray) -> np.ndarray:
        """(N, M) from the row."""
        result = np.zeros(self.allowed.shape)
        result[:, self.allowed.real] = row.reshape(len(result), -1)
        result[:, self.allowed.idle] = self.allowed.select - np.sum(result, axis=1)
        return result

    def flat(self, values: np.ndarray) -> np.ndarray:
        """The row of (N, M)."""
        return np.ascontiguousarray(values[:, self.allowed.real].reshape(1, -1))

    def cost(self, weights: np.ndarray) -> float:
        self.forward_count += 1
        return self.objective.cost(self.policy(weights))

    def cost_and_gradient(self, weights: np.ndarray) -> tuple[float, np.ndarray]:
        self.forward_count += 1
        self.backward_count += 1
        J, g = self.objective.cost_and_gradient(self.policy(weights))
        return J, self.flat(g - g[:, [self.allowed.idle]])


def minimise_with_budget(
    objective: Objective,
    allowed: BudgetSet,
    options: RelaxedOptions,
    monitor: Monitor,
    start: np.ndarray | None = None,
) -> tuple[RelaxedOutcome, np.ndarray]:
    """The relaxed optimum under a budget, and schedules (P, N, M) near it to begin a search from.

    Parameters
    ----------
    objective : convex J on policies (N, M)
    allowed : BudgetSet
    options : of the relaxation
    monitor : Monitor
    start : (N, M) shares to begin with, or None

    Where one number is all that binds, the readings of all instants are one group, and the quasi-Newton method of
    `minimise_relaxed` does it; otherwise the schedules of `minimise_by_vertices` do.
    """
    if not allowed.one_group or int(next(iter(allowed.budget.values()))) < 1:
        whole = allowed.uniform() if start is None else start
        return minimise_by_vertices(objective, allowed, whole, options, monitor)
    flat = _Flat(objective, allowed)
    room = flat.flat(allowed.upper)
    group = IntervalPolytopes(room, int(next(iter(allowed.budget.values()))))
    first = None if start is None else group.project(flat.flat(start))
    found = minimise_relaxed(flat, group, first, options, monitor)
    found.weights = flat.policy(found.weights)
    found.gradient = objective.cost_and_gradient(found.weights)[1]
    return found, allowed.round(found.weights)[None]


def minimise_by_vertices(
    objective: Objective,
    feasible_set: FeasibleSet,
    start: np.ndarray,
    options: RelaxedOptions,
    monitor: Monitor,
) -> tuple[RelaxedOutcome, np.ndarray]:
    """The relaxed optimum and the schedules that it is a mixture of.

    Parameters
    ----------
    objective : convex J on policies (N, M)
    feasible_set : whose `vertex` is exact
    start : (N, M) a schedule of the set
    options : of the relaxation; max_iterations counts schedules
    monitor : Monitor

    Returns RelaxedOutcome, and the schedules (P, N, M) of positive share.
    """
    columns, shares = start[None], np.ones((1, 1))
    before = objective.backward_count, objective.forward_count
    J, g = objective.cost_and_gradient(start)
    v, bound, iteration, stalled = start, -np.inf, 0, 0
    while True:
        new = feasible_set.vertex(g)
        own = J + float(np.vdot(g, new - v))
        better, bound = own > bound, max(bound, own)
        monitor.report(iteration, J, bound)
        target = options.relative_gap * abs(J) if options.absolute_gap is None else options.absolute_gap
        if J - bound <= target:
            status = Status.CERTIFIED
            break
        if monitor.interrupted:
            status = Status.INTERRUPTED
            break
        known = bool(np.any(np.all(columns == new, axis=(1, 2))))
        stalled = stalled + 1 if known and not better else 0
        if iteration >= options.max_iterations or monitor.timed_out or stalled > 3:
            status = Status.LIMIT
            break
        iteration += 1
        if not known:
            columns, shares = np.concatenate([columns, new[None]]), np.append(shares, [[0.0]], axis=1)
        master = _Shares(objective, columns)
        allowed = IntervalPolytopes(np.ones((1, len(columns))), 1)
        goal = max((SHARE if stalled == 0 else 0.02) * (J - bound), 1e-14 * abs(J))
        limits = RelaxedOptions(max_iterations=STEPS, absolute_gap=goal)
        found = minimise_relaxed(master, allowed, allowed.project(shares), limits, monitor.silent())
        kept = found.weights[0] > SMALL
        columns, shares = columns[kept], allowed_shares(found.weights[:, kept])
        v = np.tensordot(shares[0], columns, 1)
        J, g = objective.cost_and_gradient(v)
    certificate = Certificate(J, bound)
    spent = {"gradients": objective.backward_count - before[0], "costs": objective.forward_count - before[1]}
    status = Status.DISAGREES if certificate.contradicts else status
    return RelaxedOutcome(v, J, certificate.lower_bound, g, iteration, status, spent, stalled > 3), columns


def allowed_shares(shares: np.ndarray) -> np.ndarray:
    """Shares (1, P) scaled to the sum 1. `shares` (1, P)."""
    return shares / np.sum(shares)


def by_moves(
    sweep: Objective, feasible_set: BudgetSet, start: np.ndarray, tried: int, monitor: Monitor, rounds: int = 10**9
) -> tuple[np.ndarray, float]:
    """Local search: one reading moves to another instant or sensor, the best first by the gradient, on the true cost.

    Parameters
    ----------
    sweep : J
    feasible_set : which moves are allowed: `check` of the whole schedule decides
    start : (N, M) schedule of the set
    tried : moves that are tried from one schedule
    monitor : Monitor
    rounds : moves that are made at most

    Returns the schedule (N, M) and its J. Unless the rounds end it, no tried move improves it, nor two likely ones.
    """
    v = start.copy()
    J, (_, g) = sweep.cost(v), sweep.cost_and_gradient(v)  # the second may lie below, where a criterion is smoothed
    for _ in range(rounds):
        if monitor.stop:
            break
        singles = [(sweep.cost(w), w) for w in _moves(feasible_set, v, g, tried)]
        best = min(singles, key=lambda each: each[0], default=(np.inf, v))
        if not best[0] < J - LEAST * abs(J):
            best = _best_pair(sweep, feasible_set, v, singles)
        if not best[0] < J - LEAST * abs(J):
            break
        J, v = best
        _, g = sweep.cost_and_gradient(v)
    return v, J


def _best_pair(
    sweep: Objective, feasible_set: BudgetSet, v: np.ndarray, singles: list[tuple[float, np.ndarray]]
) -> tuple[float, np.ndarray]:
    """The best of two moves at once, among those that are the least bad alone."""
    near = [w for _, w in sorted(singles, key=lambda each: each[0])[:PAIRED]]
    best = (np.inf, v)
    for first, second in combinations(near, 2):
        both = first + second - v
        if np.min(both) < -LEAST or np.any(both > feasible_set.upper + LEAST) or not feasible_set.contains(both):
            continue
        cost = sweep.cost(both)
        if cost < best[0]:
            best = (cost, both)
    return best


def _moves(feasible_set: BudgetSet, v: np.ndarray, g: np.ndarray, tried: int) -> Iterator[np.ndarray]:
    """Schedules that differ by one reading, idle filling up, the most promising first.

    A reading moves from (k, j) to (k', j'); one of a sensor that no number binds may also be dropped or added.
    """
    idle, free = feasible_set.idle, feasible_set.free
    leaves = v > 0.5
    leaves[:, idle] = False
    price = g - g[:, [idle]]
    used = [(int(k), int(j)) for k, j in np.argwhere(leaves)]
    # no sensor is entered twice; whether the instant has room is seen below
    room = [(int(k), int(j)) for k, j in np.argwhere((feasible_set.upper > 0.5) & (v < 0.5)) if j != idle]
    moves: list[tuple[float, tuple[int, int] | None, tuple[int, int] | None]] = []
    for source, to in _promising(price, used, room, tried):
        moves.append((price[to] - price[source], source, to))
    moves += [(-price[source], source, None) for source in used if free[source[1]]]
    moves += [(price[to], None, to) for to in room if free[to[1]]]
    moves.sort(key=lambda move: move[0])
    count = 0
    for _, source, to in moves:
        w = v.copy()
        for place, sign in ((source, -1.0), (to, 1.0)):
            if place is not None:
                w[place] += sign
                w[place[0], idle] -= sign
        if np.min(w[:, idle]) < -1e-9 or not feasible_set.contains(w):
            continue
        yield w
        count += 1
        if count >= tried:
            return


def _promising(
    price: np.ndarray, used: list[tuple[int, int]], room: list[tuple[int, int]], tried: int
) -> Iterator[tuple[tuple[int, int], tuple[int, int]]]:
    """Pairs of a reading and a place for it: all where they are few, otherwise the best from each sensor to each.

    The r-th best sum of two sorted lists takes neither member from beyond place r of its list.
    """
    if len(used) * len(room) <= MANY_MOVES:
        yield from product(used, room)
        return
    sensors = range(price.shape[1])
    for a in sensors:
        out = sorted((place for place in used if place[1] == a), key=lambda place: -price[place])
        for b in sensors:
            into = sorted((place for place in room if place[1] == b), key=lambda place: price[place])
            for i, source in enumerate(out[: SPARE * tried]):
                yield from ((source, to) for to in into[: SPARE * tried // (i + 1)])

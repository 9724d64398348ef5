"""Kelley's H-minimal sweep on integral policies, convergent by partial steps (Athans 1971, section 6 and figure 7).

(1) guess v; (2) covariance forward; (3) costate backward; (4) switching functions; (5) candidate w = argmin_j s_j on
every interval; (6) stop if the predicted decrease sum_k h (s_v - s_w) is below tolerance; (7) replace v by w on the
intervals with the largest predicted decrease, a fraction epsilon of them, halving epsilon until J falls, growing it
after success; back to (2). With epsilon = 1 always it is the plain method, which can cycle.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.scheduling.exchange import best_exchanges
from occontrol.scheduling.feasible_set import FeasibleSet
from occontrol.scheduling.objective import Objective
from occontrol.scheduling.sweep import Sweep

MOST_FLOPS = 2e10  # floating-point operations that trying exchanges one at a time may take


@dataclass
class SweepOutcome:
    """Where an iteration on integral policies ended.

    Parameters
    ----------
    weights : (N, M) the best policy met
    cost : its J
    lower_bound : the best bound that any policy on the way gave
    iterations : sweeps
    end : "stationary", "no-descent", "cycle", "limit" or "interrupted"
    """

    weights: np.ndarray
    cost: float
    lower_bound: float
    iterations: int
    end: str


def h_minimal(
    sweep: Objective,
    feasible_set: FeasibleSet,
    start: np.ndarray,
    max_iterations: int = 500,
    tolerance: float = 1e-9,
    full_step: bool = False,
    monitor: Monitor | None = None,
) -> SweepOutcome:
    """Kelley's sweep from `start`.

    Parameters
    ----------
    sweep : Sweep
    feasible_set : FeasibleSet of the policies
    start : (N, M) integral policy
    max_iterations : sweeps
    tolerance : stop when the predicted decrease is below this share of |J|
    full_step : epsilon = 1 always (the plain method)
    monitor : Monitor

    Returns SweepOutcome.
    """
    monitor = monitor or Monitor()
    v = start.copy()
    J, g = sweep.cost_and_gradient(v)
    best, best_J, bound = v, J, -np.inf
    epsilon, iteration = 1.0, 0
    seen = {v.tobytes(): 0}
    while True:
        predicted = feasible_set.excess(v, g)
        total = float(np.sum(predicted))
        bound = max(bound, J - total)
        monitor.report(iteration, best_J, bound, stage="H-minimal sweep")
        if total <= tolerance * abs(J):
            return SweepOutcome(best, best_J, bound, iteration, "stationary")
        if monitor.stop:
            return SweepOutcome(best, best_J, bound, iteration, "interrupted" if monitor.interrupted else "limit")
        if iteration >= max_iterations:
            return SweepOutcome(best, best_J, bound, iteration, "limit")
        iteration += 1
        w = feasible_set.vertex(g)
        if full_step:
            v = w
            J, g = sweep.cost_and_gradient(v)
            if J < best_J:
                best, best_J = v, J
            key = v.tobytes()
            if key in seen:
                return SweepOutcome(best, best_J, bound, iteration, "cycle")
            seen[key] = iteration
            continue
        order = np.argsort(-predicted, kind="stable")
        order = order[predicted[order] > 0]
        epsilon = min(1.0, 2.0 * epsilon)
        while True:
            count = max(1, round(epsilon * len(order)))
            trial = v.copy()
            trial[order[:count]] = w[order[:count]]
            J_new, g_new = sweep.cost_and_gradient(trial)
            if J_new < J:
                v, J, g = trial, J_new, g_new
                best, best_J = v, J
                break
            if count == 1:
                return SweepOutcome(best, best_J, bound, iteration, "no-descent")
            epsilon = 0.5 * count / len(order)


def polish(
    sweep: Sweep,
    feasible_set: FeasibleSet,
    start: np.ndarray,
    max_rounds: int = 200,
    monitor: Monitor | None = None,
) -> SweepOutcome:
    """H-minimal steps whose predicted decrease is exact: the best single exchange of every interval, on the true cost.

    As many of the best exchanges at once as still lower J, halved until they do; ends when no single exchange does,
    so the result cannot be improved by changing one interval. With a running weight the prediction is only the least
    that an exchange saves; exchanges that it cannot decide are then tried one at a time, in the order of the switching
    functions, up to MOST_FLOPS.

    Parameters
    ----------
    sweep : Sweep
    feasible_set : FeasibleSet of the policies
    start : (N, M) integral policy
    max_rounds : sweeps that compute exchanges
    monitor : Monitor

    Returns SweepOutcome; `lower_bound` is -inf (polishing proves nothing).
    """
    monitor = monitor or Monitor()
    if not sweep.foresees_exchanges:
        watch = monitor.child(silent=True)
        found = h_minimal(sweep, feasible_set, start, max_iterations=max_rounds, monitor=watch)
        # what is minimised may lie a little below the cost, where a criterion is smoothed
        return _polish_by_trial(sweep, feasible_set, found.weights, sweep.cost(found.weights), monitor)
    found = _polish_by_exchange(sweep, feasible_set, start, max_rounds, monitor)
    if not sweep.exact_exchanges and found.end == "stationary":
        tried = _polish_by_trial(sweep, feasible_set, found.weights, found.cost, monitor)
        found = replace(tried, iterations=found.iterations + tried.iterations)
    return found


def _polish_by_exchange(
    sweep: Sweep, feasible_set: FeasibleSet, start: np.ndarray, max_rounds: int, monitor: Monitor
) -> SweepOutcome:
    sweep.remember_products()
    v = start.copy()
    J, _ = sweep.cost_and_gradient(v)
    share = 1.0
    refused = np.zeros(len(v), dtype=bool)
    for rounds in range(max_rounds):
        gain, leaving, entering = best_exchanges(sweep, feasible_set, v)
        gain[refused] = 0.0
        order = np.argsort(gain, kind="stable")
        order = order[gain[order] < -1e-12 * abs(J)]
        if not len(order):
            return SweepOutcome(v, J, -np.inf, rounds, "stationary")
        if monitor.stop:
            return SweepOutcome(v, J, -np.inf, rounds, "interrupted" if monitor.interrupted else "limit")
        share = min(1.0, 4.0 * share)
        while True:
            count = max(1, round(share * len(order)))
            chosen = order[:count]
            trial = v.copy()
            trial[chosen, leaving[chosen]] -= 1.0
            trial[chosen, entering[chosen]] += 1.0
            J_new, _ = sweep.cost_and_gradient(trial)
            if J_new < J:
                v, J = trial, J_new
                refused[:] = False
                break
            if count == 1:
                # the gain drowned in rounding (a start many orders above the rest): leave this interval alone for now
                refused[chosen] = True
                sweep.cost_and_gradient(v)
                break
            share = 0.5 * count / len(order)
        monitor.report(rounds, J, -np.inf, stage="polish")
    return SweepOutcome(v, J, -np.inf, max_rounds, "limit")


def _polish_by_trial(
    sweep: Sweep, feasible_set: FeasibleSet, start: np.ndarray, J: float, monitor: Monitor
) -> SweepOutcome:
    r = sweep.recursion
    v = start.copy()
    budget = min(4 * r.intervals + 200, int(MOST_FLOPS / (len(r.steps) * (4 * r.states**3 + 500))))
    improved, rounds = True, 0
    while improved and budget > 0 and not monitor.stop:
        improved = False
        rounds += 1
        _, g = sweep.cost_and_gradient(v)
        leaves, enters = feasible_set.exchange_masks(v)
        moves = []
        for k in range(r.intervals):
            for j in np.flatnonzero(leaves[k]):
                for e in np.flatnonzero(enters[k]):
                    if e != j:
                        moves.append((g[k, e] - g[k, j], k, j, e))
        moves.sort()
        for _, k, j, e in moves[: max(10, r.intervals)]:
            if budget <= 0 or monitor.stop or not (leaves[k, j] and enters[k, e]):
                continue
            trial = v.copy()
            trial[k, j] -= 1.0
            trial[k, e] += 1.0
            budget -= 1
            value = sweep.cost(trial)
            if value < J * (1 - 1e-13) if J > 0 else value < J:
                v, J, improved = trial, value, True
                leaves, enters = feasible_set.exchange_masks(v)
        monitor.report(rounds, J, -np.inf, stage="polish")
    end = "interrupted" if monitor.interrupted else ("limit" if improved else "stationary")
    return SweepOutcome(v, J, -np.inf, rounds, end)

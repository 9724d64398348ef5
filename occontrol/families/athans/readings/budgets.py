"""Methods for exact numbers of readings: the relaxation by cheapest schedules, and a search that keeps the numbers."""

from __future__ import annotations

import numpy as np

from occontrol.core.errors import UsageError
from occontrol.core.method import Method
from occontrol.core.monitor import Monitor
from occontrol.families.athans.found import STEPS_FOR_BOUND, Found
from occontrol.families.athans.methods import Greedy, Random, Relaxed, RelaxRoundPolish, RoundRobin
from occontrol.families.athans.readings.bounds import operations
from occontrol.scheduling.baselines import random_policy
from occontrol.scheduling.budget import BudgetSet
from occontrol.scheduling.budget_baselines import greedy_with_budget, in_turn_with_budget
from occontrol.scheduling.enumeration import cheapest, schedule_count
from occontrol.scheduling.extraction import ExtractedSweep, extraction
from occontrol.scheduling.relaxation import RelaxedOptions
from occontrol.scheduling.sweep import Sweep
from occontrol.scheduling.vertices import by_moves, minimise_with_budget

PAYS = 1e-3  # of the cost: a gap below which nothing more is tried
TRIED = 400  # moves from one schedule
STARTS = 6  # near the relaxation, and as many moved at random
NOISE = 0.3  # of a reading
MOST_FLOPS = 1.5e9  # of trying all schedules
FEWEST, GREEDY_FLOPS = 40, 1e9  # of weighing the candidates for one reading of a greedy schedule
MOST = 400  # schedules of the relaxation


def with_budget(sweep: Sweep, allowed: BudgetSet, method: Method, monitor: Monitor, bound: bool = False) -> Found:
    """The method's policy of readings that keeps the budget, with the relaxation beside it.

    Parameters
    ----------
    sweep : of the recursion
    allowed : with the budget
    method : schedule, relaxed, greedy, round-robin, or random
    monitor : Monitor
    bound : whether the tighter bound is wanted for a relaxed method, too

    Raises UsageError for the methods that do not count readings.
    """
    if not isinstance(method, RelaxRoundPolish | Relaxed | Greedy | RoundRobin | Random):
        hint = "hint: method: schedule, relaxed, greedy, round-robin, or random"
        raise UsageError(f"{method.name} does not do budgets of readings\n  {hint}")
    monitor = monitor.child(getattr(method, "time_limit", None))
    monitor.stage = "relaxation"
    steps = getattr(method, "max_iterations", STEPS_FOR_BOUND)
    most = steps if allowed.one_group else min(steps, MOST)
    options = RelaxedOptions(method.relative_gap, most)
    relaxed, columns = minimise_with_budget(sweep, allowed, options, monitor)
    found = Found(relaxed.weights, relaxed.iterations, relaxed.status, "", relaxed, target=method.relative_gap)
    found.proves = isinstance(method, RelaxRoundPolish | Relaxed)
    if isinstance(method, Greedy | RoundRobin | Random):
        found.weights = _simple(sweep, allowed, method)
        return found
    few = schedule_count(allowed) * operations(sweep) <= MOST_FLOPS
    if few and (bound or isinstance(method, RelaxRoundPolish)) and getattr(method, "branch_first", None) is not False:
        monitor.stage = "all schedules"
        known = cheapest(sweep, allowed, monitor)
        if known is not None:
            found.weights, _, found.bound = known
            found.extra["schedules"] = schedule_count(allowed)
            if getattr(method, "exact_options", None) is not None:
                found.extra["proven_optimal"] = True
            return found
    if getattr(method, "exact_options", None) is not None:
        found.extra["proven_optimal"] = False  # too many schedules to try all of them
    if isinstance(method, RelaxRoundPolish):
        monitor.stage = "moves"
        shares = np.array([float(np.vdot(column, relaxed.weights)) for column in columns])
        likely = [columns[i] for i in np.argsort(-shares, kind="stable")[:STARTS]]
        rng = np.random.default_rng(0)
        moved = [allowed.vertex(-relaxed.weights - NOISE * rng.random(allowed.shape)) for _ in range(STARTS)]
        starts = {s.tobytes(): s for s in (allowed.round(relaxed.weights), *likely, *moved)}
        done = [by_moves(sweep, allowed, start, TRIED, monitor) for start in starts.values()]
        found.weights, cost = min(done, key=lambda each: each[1])
    elif bound:
        cost = sweep.cost(relaxed.weights)
    else:
        return found
    if getattr(method, "strengthen", None) is not False and cost - relaxed.lower_bound > PAYS * abs(cost):
        rho = extraction(sweep.recursion)
        if rho > 1.0 and not monitor.stop:
            bent = ExtractedSweep(sweep, rho)
            tighter, _ = minimise_with_budget(bent, allowed, options, monitor.silent())
            found.bound, found.extra["extraction"] = tighter.lower_bound, rho
    return found


def _simple(sweep: Sweep, allowed: BudgetSet, method: Greedy | RoundRobin | Random) -> np.ndarray:
    """The policy (N, M) of a baseline."""
    if isinstance(method, Greedy):
        return greedy_with_budget(sweep, allowed, max(FEWEST, int(GREEDY_FLOPS / operations(sweep))))
    return in_turn_with_budget(allowed) if isinstance(method, RoundRobin) else random_policy(allowed, method.seed)

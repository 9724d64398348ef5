"""Schedules whose peak stays below a limit: the least peak, the cheapest of those that keep it, and bounds of both.

With the price rho of exceeding the limit,  J = cost + rho mu log(1 + sum_i exp((f_i - e)/mu)),  and from any policy

    cost(w) >= cost.w + sum_i l_i (f_i(w) - e)      for every schedule w that keeps the limit,

whatever rho is. rho grows until the relaxed policy keeps the limit; the best bound on the way counts. Schedules are
improved with a rho so large that no saving is worth exceeding the limit.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from occontrol.core.errors import InfeasibleError, SolveFailed
from occontrol.core.method import Method
from occontrol.core.monitor import Monitor
from occontrol.core.printed import rounded_down
from occontrol.core.solution import Status
from occontrol.families.athans.criteria.every import every_schedule
from occontrol.families.athans.criteria.search import WORK, Doable, Hunted, hunt, improved, relax, require_method
from occontrol.families.athans.found import STEPS_FOR_BOUND, Found
from occontrol.families.athans.methods import Exact, Relaxed, RelaxRoundPolish
from occontrol.scheduling.budget import BudgetSet
from occontrol.scheduling.criterion_sweep import LowerModel
from occontrol.scheduling.feasible_set import IntervalPolytopes
from occontrol.scheduling.peak import PeakSweep
from occontrol.scheduling.proof import Judged
from occontrol.scheduling.relaxation import RelaxedOutcome
from occontrol.scheduling.rules.model import KEEPS

GROWTH, ROUNDS = 4.0, 14  # of rho
ROUGH, ROUGH_STEPS = 1e-2, 150  # gap and steps of the relaxations on the way to it
SEARCHED, SECONDS = 200_000, 20  # nodes and time for a schedule that keeps the limit
EXCESS = 100.0  # times what all readings may cost: the price of exceeding the limit by the whole of it


def hunt_below(
    objective: PeakSweep, limit: float, allowed: IntervalPolytopes, method: Method, monitor: Monitor
) -> Hunted:
    """What a method finds among the schedules that keep a limit of the peak.

    Parameters
    ----------
    objective : the peak, without the limit
    limit : e
    allowed : IntervalPolytopes, perhaps with a budget
    method : of the family
    monitor : Monitor

    Raises InfeasibleError with the least peak where no schedule keeps the limit, SolveFailed where none was found.
    """
    method = require_method(method, isinstance(allowed, BudgetSet))
    monitor = monitor.child(getattr(method, "time_limit", None))
    monitor.stage = "least peak"
    free = unpriced(objective)
    peak, tangents = relax(free, allowed, monitor, 1e-3, getattr(method, "max_iterations", STEPS_FOR_BOUND))
    del tangents
    if peak.lower_bound > limit * (1 + KEEPS):
        if not isinstance(method, RelaxRoundPolish):
            raise unreachable(limit, peak.lower_bound, None)
        best = hunt(free, allowed, RelaxRoundPolish(exact=method.exact), monitor).found
        free.cost(best.weights)
        raise unreachable(limit, max(best.bound, peak.lower_bound), free.criterion_value)
    capped, relaxed, bounding = relaxed_below(objective, limit, allowed, peak.weights, method, monitor)
    found = Found(relaxed.weights, relaxed.iterations, relaxed.status, "", relaxed, target=method.relative_gap)
    hunted = Hunted(found, bounding)
    if isinstance(method, Relaxed):
        found.proves = True
        return hunted
    sure = capped.with_limit(limit, _price(objective, limit))
    if isinstance(method, RelaxRoundPolish):
        found.proves = True
        _cheapest(objective, sure, limit, allowed, peak.weights, method, hunted, monitor)
    else:
        found.weights = hunt(sure, allowed, method, monitor).found.weights
    sure.cost(found.weights)
    if sure.criterion_value > limit * (1 + KEEPS):
        if isinstance(method, RelaxRoundPolish):
            raise SolveFailed(
                f"no schedule was found whose peak is at most {limit:g}: the best has {sure.criterion_value:.8g}, none "
                f"can have less than {rounded_down(peak.lower_bound, 8)}\n"
                f"  hint: a larger limit, or exact: true of method schedule"
            )
        found.message = (
            f"The schedule of {method.name} does not keep the limit: its peak is {sure.criterion_value:.8g}, "
            f"the limit {limit:g}."
        )
        found.status = Status.INFEASIBLE
    return hunted


def relaxed_below(
    objective: PeakSweep, limit: float, allowed: IntervalPolytopes, start: np.ndarray, method: Doable, monitor: Monitor
) -> tuple[PeakSweep, RelaxedOutcome, list[Judged]]:
    """The objective with the rho found, the relaxation with the best bound, and the tangents that prove it.

    Parameters
    ----------
    objective : the peak, without the limit
    limit : e
    allowed : IntervalPolytopes, perhaps with a budget
    start : (N, M) policy of a small peak
    method : of the family
    monitor : Monitor
    """
    objective.cost(start)
    rho = max(_most(objective), 1e-6 * limit) / limit
    best, tangents, kept, rough = None, [], None, max(ROUGH, method.relative_gap)
    for _ in range(ROUNDS):
        capped = objective.with_limit(limit, rho)
        found, proofs = relax(capped, allowed, monitor, rough, ROUGH_STEPS, start)
        capped.cost(found.weights)
        inside = capped.criterion_value <= limit * (1 + max(method.relative_gap, KEEPS))
        if best is None or found.lower_bound > best.lower_bound:
            best, tangents = found, proofs[1:] or proofs
        kept, start = found if inside else kept, found.weights
        if inside or monitor.stop:
            break
        rho *= GROWTH
    assert best is not None
    if kept is not None and rough > method.relative_gap and not monitor.stop:
        capped = objective.with_limit(limit, rho)
        kept, proofs = relax(capped, allowed, monitor, method.relative_gap, STEPS_FOR_BOUND, start)
        if kept.lower_bound > best.lower_bound:
            best, tangents = kept, proofs[1:] or proofs
    if kept is not None and kept is not best:
        bound = max(best.lower_bound, kept.lower_bound)
        best = replace(kept, lower_bound=bound)
    return objective.with_limit(limit, rho), best, tangents


def _cheapest(
    objective: PeakSweep,
    sure: PeakSweep,
    limit: float,
    allowed: IntervalPolytopes,
    least: np.ndarray,
    method: RelaxRoundPolish,
    hunted: Hunted,
    monitor: Monitor,
) -> None:
    """The cheapest schedule that keeps the limit; InfeasibleError where the least peak is above it."""
    found = hunted.found
    relaxed = found.weights
    exact = method.exact_options is not None
    if every_schedule(sure, allowed, found, WORK, monitor, method.branch_first is not False or exact):
        sure.cost(found.weights)
        if sure.criterion_value > limit * (1 + KEEPS):  # the price is so high that the least peak is not missed
            every = Found(found.weights, 0, found.status)
            free = unpriced(objective)
            every_schedule(free, allowed, every, WORK, monitor, True)
            free.cost(every.weights)
            raise unreachable(limit, every.bound, free.criterion_value)
        return
    free = unpriced(objective)
    hard = RelaxRoundPolish(exact=True if exact else None, polish=max(method.polish, 50))
    lowest = hunt(free, allowed, hard, monitor)
    free.cost(lowest.found.weights)
    peak, bound = free.criterion_value, max(lowest.found.bound, -np.inf)
    if lowest.found.relaxed is not None:
        bound = max(bound, lowest.found.relaxed.lower_bound)
    if bound > limit * (1 + KEEPS):
        raise unreachable(limit, bound, peak)
    if peak > limit * (1 + KEEPS) and not exact:  # perhaps a tree knows better
        limits = {"relative_gap": Exact().relative_gap, "max_nodes": SEARCHED, "time_limit": SECONDS}
        lowest = hunt(free, allowed, RelaxRoundPolish(exact=limits), monitor)
        free.cost(lowest.found.weights)
        peak, bound = free.criterion_value, max(bound, lowest.found.bound)
        if bound > limit * (1 + KEEPS):
            raise unreachable(limit, bound, peak)
    starts = [lowest.found.weights]
    found.weights, _ = improved(sure, LowerModel(sure, relaxed), allowed, relaxed, method.polish, monitor, starts)


def unpriced(objective: PeakSweep) -> PeakSweep:
    """The peak alone, nothing else of `objective` being charged."""
    r = objective.recursion
    return PeakSweep(
        replace(r, cost=np.zeros_like(r.cost), running=np.zeros((0, r.states, r.states)), charge=None),
        objective.watched, objective.smoothing,
    )  # fmt: skip


def _most(objective: PeakSweep) -> float:
    """What a schedule may cost: prices of the dearest choices."""
    return float(np.sum(np.max(objective.recursion.decision_cost, axis=1, initial=0.0)))


def _price(objective: PeakSweep, limit: float) -> float:
    """rho for which no saving is worth exceeding the limit by more than a share KEEPS of it."""
    return EXCESS * max(_most(objective), limit, 1.0) / (limit * 1e-6)


def require_reachable(limit: float, bound: float) -> None:
    """Raise InfeasibleError where no schedule has a peak below a bound that lies above the limit.

    Parameters
    ----------
    limit : e
    bound : of the least peak
    """
    if bound > limit * (1 + KEEPS):
        raise unreachable(limit, bound, None)


def unreachable(limit: float, bound: float, peak: float | None, rules: bool = False) -> InfeasibleError:
    """The error that names the least peak.

    Parameters
    ----------
    limit : e
    bound : of the least peak
    peak : of the best schedule that is known, or None
    rules : whether schedules have to keep rules as well
    """
    who = "no schedule that keeps the rules" if rules else "no schedule"
    if peak is None:
        least = f"{who} has a peak below {rounded_down(bound, 8)}"
    elif peak - bound <= 1e-6 * peak:
        least = f"the least peak is {peak:.8g}"
    else:
        least = f"the least peak lies between {rounded_down(bound, 8)} and {peak:.8g}"
    hint = "a larger limit, fewer rules, or more or better readings" if rules else (
        "a larger limit, or more or better readings"
    )
    return InfeasibleError(f"{who} keeps the peak at or below {limit:g}: {least}\n  hint: {hint}")

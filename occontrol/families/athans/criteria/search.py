"""Methods for problems with another criterion than the trace: relaxation by smoothing, schedules by the true criterion.

What is minimised is convex and is bounded as any cost is; exact exchanges are not foreseen, so every change of a
schedule is accepted on its true cost alone.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import cast

import numpy as np

from occontrol.core.errors import UsageError
from occontrol.core.method import Method
from occontrol.core.monitor import Monitor
from occontrol.core.solution import Status
from occontrol.families.athans.criteria.every import every_schedule
from occontrol.families.athans.found import STEPS_FOR_BOUND, Found
from occontrol.families.athans.methods import (
    STARTS,
    BestSingle,
    Greedy,
    HMinimal,
    Random,
    Relaxed,
    RelaxRoundPolish,
    RoundRobin,
)
from occontrol.scheduling.baselines import best_single, random_policy, round_robin
from occontrol.scheduling.budget import BudgetSet
from occontrol.scheduling.budget_baselines import greedy_with_budget, in_turn_with_budget
from occontrol.scheduling.criterion_greedy import greedy_by_criterion
from occontrol.scheduling.criterion_sweep import CriterionObjective, CriterionSweep, LowerModel
from occontrol.scheduling.feasible_set import IntervalPolytopes
from occontrol.scheduling.first_choices import TreeLimits, branch, choices
from occontrol.scheduling.hminimal import h_minimal, polish
from occontrol.scheduling.objective import Objective
from occontrol.scheduling.peak import PeakSweep
from occontrol.scheduling.proof import Judged
from occontrol.scheduling.relaxation import RelaxedOptions, RelaxedOutcome, minimise_relaxed
from occontrol.scheduling.rounding import roundings
from occontrol.scheduling.shaking import kick
from occontrol.scheduling.single_readings import branch_singly
from occontrol.scheduling.smoothed import SmoothedOutcome, minimise_smoothed
from occontrol.scheduling.vertices import by_moves, minimise_with_budget

PAYS = 1e-3  # a gap below which no better bound is looked for
KICK_SWEEPS = 4  # times the sweeps of the first polish that kicks may take
WORK = 1.5e9  # operations that a tree of bounds, or trying all schedules, may take
NODE_GAP, PATIENCE = 1e-3, 12
WEIGHED = 40  # readings whose true cost is computed for each that greedy chooses
MOVED, NOISE, TRIED = 6, 0.3, 400  # starts near the relaxation under a budget, how near, and moves tried from each


Doable = RelaxRoundPolish | Relaxed | HMinimal | Greedy | RoundRobin | Random | BestSingle


@dataclass
class Hunted:
    """What a method found.

    Parameters
    ----------
    found : as every method hands it over
    tangents : policies whose tangents prove bounds, beside that of the schedule
    """

    found: Found
    tangents: list[Judged] = field(default_factory=list)


def relax(
    objective: CriterionObjective,
    allowed: IntervalPolytopes,
    monitor: Monitor,
    relative_gap: float,
    max_iterations: int = STEPS_FOR_BOUND,
    start: np.ndarray | None = None,
) -> tuple[RelaxedOutcome, list[Judged]]:
    """The relaxed optimum of the true criterion, and the policies whose tangents prove its bound.

    Parameters
    ----------
    objective : the true one
    allowed : IntervalPolytopes, perhaps with a budget
    monitor : Monitor
    relative_gap : target; of a logarithm the difference of cost and bound
    max_iterations : of all stages of smoothing together
    start : (N, M) policy to begin at, or None
    """
    monitor.stage = "relaxation"
    options = RelaxedOptions(relative_gap, max_iterations, absolute_gap=relative_gap if objective.signed else None)

    def inner(stage: Objective, at: np.ndarray, limits: RelaxedOptions, watch: Monitor) -> RelaxedOutcome:
        if isinstance(allowed, BudgetSet):
            return minimise_with_budget(stage, allowed, limits, watch, at)[0]
        return minimise_relaxed(stage, allowed, at, limits, watch)

    if not objective.corners:
        first = allowed.uniform() if start is None and not isinstance(allowed, BudgetSet) else start
        found = inner(objective, first, options, monitor)  # type: ignore[arg-type]
        return found, [objective.tangent(found.weights)]
    smooth: SmoothedOutcome = minimise_smoothed(objective, allowed, start, options, monitor, inner)
    tangents = [objective.tangent(smooth.weights)]
    if smooth.bounding is not None:
        weights, mu = smooth.bounding
        tangents.append(objective.with_smoothing(mu).tangent(weights))
    return smooth, tangents


def hunt(objective: CriterionObjective, allowed: IntervalPolytopes, method: Method, monitor: Monitor) -> Hunted:
    """What a method of the family, but collocation, finds.

    Parameters
    ----------
    objective : the true one
    allowed : IntervalPolytopes, perhaps with a budget
    method : of the family
    monitor : Monitor

    Raises UsageError for methods that do not do criteria, or not with a budget.
    """
    method = require_method(method, isinstance(allowed, BudgetSet))
    monitor = monitor.child(getattr(method, "time_limit", None))
    steps = getattr(method, "max_iterations", STEPS_FOR_BOUND)
    relaxed, tangents = relax(objective, allowed, monitor, method.relative_gap, steps)
    found = Found(relaxed.weights, relaxed.iterations, relaxed.status, "", relaxed, target=method.relative_gap)
    hunted, lower = Hunted(found, tangents), LowerModel(objective, relaxed.weights)
    if isinstance(method, Relaxed):
        found.proves = True
        return hunted
    if isinstance(method, RelaxRoundPolish):
        found.proves = True
        _schedule(objective, lower, allowed, method, hunted, monitor)
    elif isinstance(method, HMinimal):
        first = _baseline(STARTS[method.start](), objective, lower, allowed)
        done = h_minimal(lower, allowed, first, method.max_iterations, method.tolerance, method.full_step, monitor)
        found.weights, found.iterations, found.bound = done.weights, done.iterations, done.lower_bound
        found.extra["end"] = done.end
    else:
        found.weights = _baseline(method, objective, lower, allowed)
    return hunted


def require_method(method: Method, budget: bool) -> Doable:
    """The method; UsageError for one that does not do criteria, or not beside a budget.

    Parameters
    ----------
    method : of the family
    budget : whether there is one
    """
    if not isinstance(method, Doable):
        hint = "method: schedule, relaxed, hminimal, greedy, round-robin, random, or best-single"
        raise UsageError(f"{method.name} does not do criteria other than the trace\n  hint: {hint}")
    if budget and isinstance(method, HMinimal | BestSingle):
        hint = "hint: method: schedule, relaxed, greedy, round-robin, or random"
        raise UsageError(f"{method.name} does not do budgets of readings\n  {hint}")
    return method


def _baseline(
    method: Doable, objective: CriterionObjective, lower: LowerModel, allowed: IntervalPolytopes
) -> np.ndarray:
    """The policy (N, M) of a simple method."""
    seed = method.seed if isinstance(method, Random) else 1
    if isinstance(allowed, BudgetSet):
        if isinstance(method, Greedy):
            return greedy_with_budget(lower, allowed, WEIGHED)
        return in_turn_with_budget(allowed) if isinstance(method, RoundRobin) else random_policy(allowed, seed)
    if isinstance(method, Greedy):
        return greedy_by_criterion(swept(objective), allowed)
    if isinstance(method, BestSingle):
        return best_single(objective, allowed)
    if isinstance(method, RoundRobin):
        return round_robin(objective.recursion, allowed, method.dwell)
    return random_policy(allowed, seed)


def _schedule(
    objective: CriterionObjective,
    lower: LowerModel,
    allowed: IntervalPolytopes,
    method: RelaxRoundPolish,
    hunted: Hunted,
    monitor: Monitor,
) -> None:
    """Round and polish on the true criterion, then look for a better bound; `hunted` is filled in."""
    found, relaxed = hunted.found, hunted.found.relaxed
    assert relaxed is not None
    monitor.stage = "rounding"
    if every_schedule(objective, allowed, found, WORK, monitor, method.branch_first is not False):
        return
    found.weights, cost = improved(objective, lower, allowed, relaxed.weights, method.polish, monitor)
    if monitor.interrupted:
        found.status = Status.INTERRUPTED
    size = 1.0 if objective.signed else abs(cost)
    exact = method.exact_options
    target = max(PAYS, method.relative_gap) if exact is None else exact.relative_gap
    if exact is not None:
        found.extra["proven_optimal"] = cost - relaxed.lower_bound <= target * size
    wanted = exact is not None or method.branch_first is not False
    if cost - relaxed.lower_bound <= target * size or not wanted or monitor.stop or isinstance(allowed, BudgetSet):
        return
    monitor.stage = "first choices"
    limits = TreeLimits(method.relative_gap, _gradients(objective), NODE_GAP, PATIENCE, absolute=objective.signed)
    watch = monitor
    if exact is not None:
        limits = replace(limits, relative_gap=target, gradients=10**9, patience=None, nodes=exact.max_nodes)
        watch = monitor.child(exact.time_limit)
    many = choices(allowed.upper[0], allowed.places) is None
    tree = (branch_singly if many else branch)(lower, allowed, relaxed, cost, limits, watch)
    found.bound, found.extra["nodes"] = tree.lower_bound, tree.nodes
    if exact is not None:
        found.extra["proven_optimal"] = tree.closed
    if tree.weights is not None:
        found.weights = tree.weights


def improved(
    objective: CriterionObjective,
    lower: LowerModel,
    allowed: IntervalPolytopes,
    relaxed: np.ndarray,
    rounds: int,
    monitor: Monitor,
    further: list[np.ndarray] | None = None,
) -> tuple[np.ndarray, float]:
    """The best schedule (N, M) near a relaxed policy, and its true cost.

    Parameters
    ----------
    objective, lower : the true objective and the smooth one below it
    allowed : IntervalPolytopes, perhaps with a budget
    relaxed : (N, M)
    rounds : of every polish; 0 for none
    monitor : Monitor
    further : schedules (N, M) to begin at, too
    """
    if isinstance(allowed, BudgetSet):
        rng = np.random.default_rng(0)
        moved = [allowed.vertex(-relaxed - NOISE * rng.random(allowed.shape)) for _ in range(MOVED)]
        starts = [allowed.round(relaxed), *moved, *(further or [])]
        if not rounds:
            return min(((v, objective.cost(v)) for v in starts), key=lambda each: each[1])
        done = [by_moves(lower, allowed, start, TRIED, monitor) for start in starts]
        return min(done, key=lambda each: each[1])
    starts = [*roundings(relaxed, allowed), greedy_by_criterion(swept(objective), allowed), *(further or [])]
    starts.sort(key=objective.cost)
    if not rounds or monitor.stop:
        return starts[0], objective.cost(starts[0])
    before = lower.forward_count
    done = [polish(lower, allowed, start, rounds, monitor) for start in starts]  # type: ignore[arg-type]
    best = min(done, key=lambda o: o.cost)
    if best.end == "stationary":
        spent = KICK_SWEEPS * (lower.forward_count - before)
        best = kick(lower, allowed, best, -np.inf, spent, rounds, monitor)  # type: ignore[arg-type]
    return best.weights, best.cost


def swept(objective: CriterionObjective) -> CriterionSweep | PeakSweep:
    """The `objective` as one of the two that there are on a recursion."""
    return cast("CriterionSweep | PeakSweep", objective)


def _gradients(objective: CriterionObjective) -> int:
    """Gradients that a tree may take."""
    return int(np.clip(WORK / operations(objective), 20, 20_000))


def operations(objective: CriterionObjective) -> float:
    """Floating-point operations of one gradient, roughly."""
    r = objective.recursion
    n, rows = r.states, r.rows.shape[1]
    return len(r.steps) * (8.0 * n**3 + 8.0 * rows * n * n + 500.0) + 20_000.0



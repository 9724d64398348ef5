"""Methods for problems without a prior: Newton where the readings are few, quasi-Newton otherwise, exact designs.

A design for which a direction is unseen costs infinitely much; every search begins where all are seen.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from occontrol.core.errors import InfeasibleError
from occontrol.core.method import Method
from occontrol.core.monitor import Monitor
from occontrol.core.solution import Status
from occontrol.families.athans.criteria.every import every_schedule
from occontrol.families.athans.criteria.search import WEIGHED, WORK, Doable, require_method
from occontrol.families.athans.found import STEPS_FOR_BOUND, Found
from occontrol.families.athans.methods import STARTS, BestSingle, Greedy, HMinimal, Random, Relaxed, RoundRobin
from occontrol.families.athans.methods import RelaxRoundPolish as Schedule
from occontrol.scheduling.baselines import best_single, random_policy, round_robin
from occontrol.scheduling.budget import BudgetSet
from occontrol.scheduling.budget_baselines import greedy_with_budget, in_turn_with_budget
from occontrol.scheduling.criterion_sweep import LowerModel
from occontrol.scheduling.design import Design, minimise_design
from occontrol.scheduling.feasible_set import IntervalPolytopes
from occontrol.scheduling.grouping import Grouped, Grouping
from occontrol.scheduling.hminimal import h_minimal, polish
from occontrol.scheduling.information import InformationObjective
from occontrol.scheduling.objective import Objective
from occontrol.scheduling.relaxation import RelaxedOptions, RelaxedOutcome, minimise_relaxed
from occontrol.scheduling.rounding import roundings
from occontrol.scheduling.smoothed import minimise_smoothed
from occontrol.scheduling.vertices import by_moves, minimise_by_vertices

NEWTON = 400  # shares up to which Newton's method is used
VAGUE = 1e-6  # of the mean information: the prior of greedy choices, which begin with nothing
MIXED = 64  # schedules whose mean sees every direction
MOVED, NOISE, TRIED = 6, 0.3, 400
FEWER = 40  # moves and rounds for many shares
MANY = 400  # shares beyond which one start or two must do
SLOW, EXACT = 8.0, 1e10  # how much longer an inverse takes than a sweep, and the work that `exact` may take


@dataclass
class HuntedDesign:
    """What a method found.

    Parameters
    ----------
    found : as every method hands it over
    tangents : objectives and policies (N, M) whose tangents prove bounds
    """

    found: Found
    tangents: list[tuple[InformationObjective, np.ndarray]] = field(default_factory=list)


def hunt_design(
    objective: InformationObjective, allowed: IntervalPolytopes, method: Method, monitor: Monitor
) -> HuntedDesign:
    """What a method of the family, but collocation, finds.

    Parameters
    ----------
    objective : the true one
    allowed : IntervalPolytopes, perhaps with a budget
    method : of the family
    monitor : Monitor

    Raises UsageError for methods that do not do this, InfeasibleError where no schedule sees every direction.
    """
    own = require_method(method, isinstance(allowed, BudgetSet))
    monitor = monitor.child(getattr(method, "time_limit", None))
    steps = getattr(method, "max_iterations", STEPS_FOR_BOUND)
    relaxed, tangents = relax_design(objective, allowed, monitor, own.relative_gap, steps)
    found = Found(relaxed.weights, relaxed.iterations, relaxed.status, "", relaxed, target=own.relative_gap)
    hunted, lower = HuntedDesign(found, tangents), LowerModel(objective, relaxed.weights)
    found.proves = isinstance(own, Relaxed | Schedule)
    if isinstance(own, Schedule):
        monitor.stage = "exact design"
        exact = own.exact_options
        work = WORK / SLOW if exact is None else EXACT
        if not every_schedule(objective, allowed, found, work, monitor, own.branch_first is not False):
            found.weights = _exact(objective, lower, allowed, relaxed, own, monitor)
            if exact is not None:
                found.extra["proven_optimal"] = False  # too many designs to try all of them
        if monitor.interrupted:
            found.status = Status.INTERRUPTED
    elif isinstance(own, HMinimal):
        first = _simple(STARTS[own.start](), objective, allowed)
        if not np.isfinite(objective.cost(first)):
            first = allowed.round(relaxed.weights)
        if np.isfinite(objective.cost(first)):
            done = h_minimal(lower, allowed, first, own.max_iterations, own.tolerance, own.full_step, monitor)
            found.weights, found.iterations, found.extra["end"] = done.weights, done.iterations, done.end
            first = done.weights
        found.weights = first
    elif not isinstance(own, Relaxed):
        found.weights = _simple(own, objective, allowed)
    return hunted


def relax_design(
    objective: InformationObjective,
    allowed: IntervalPolytopes,
    monitor: Monitor,
    relative_gap: float,
    max_iterations: int = STEPS_FOR_BOUND,
) -> tuple[RelaxedOutcome, list[tuple[InformationObjective, np.ndarray]]]:
    """The best shares of the readings, and what proves their bound.

    Parameters
    ----------
    objective : the true one
    allowed : IntervalPolytopes, perhaps with a budget
    monitor : Monitor
    relative_gap : target; of a logarithm the difference of cost and bound
    max_iterations : of all stages of smoothing together

    Raises InfeasibleError where no mean of schedules sees every direction.
    """
    monitor.stage = "relaxation"
    options = RelaxedOptions(relative_gap, max_iterations, absolute_gap=relative_gap if objective.signed else None)
    start = _inside(objective, allowed)

    def inner(stage: Objective, at: np.ndarray, limits: RelaxedOptions, watch: Monitor) -> RelaxedOutcome:
        return _stage(stage, allowed, at, limits, watch)  # type: ignore[arg-type]

    if not objective.corners:
        found = inner(objective, start, options, monitor)
        return found, [(objective, found.weights)]
    smooth = minimise_smoothed(objective, allowed, start, options, monitor, inner)
    tangents = [(objective, smooth.weights)]
    if smooth.bounding is not None:
        tangents.append((objective.with_smoothing(smooth.bounding[1]), smooth.bounding[0]))
    return smooth, tangents


def _stage(
    stage: InformationObjective, allowed: IntervalPolytopes, at: np.ndarray, limits: RelaxedOptions, watch: Monitor
) -> RelaxedOutcome:
    """One minimisation from a policy that sees everything."""
    grouping = Grouping(allowed) if isinstance(allowed, BudgetSet) else None
    # with corners the quasi-Newton method creeps; mixtures of a few schedules lie on them
    many = stage.corners and allowed.upper.size > NEWTON
    if grouping is not None and (grouping.number is None or many):
        return minimise_by_vertices(stage, allowed, at, limits, watch)[0]
    rows = allowed if grouping is None else grouping.set()
    newton = stage.curved and rows.upper.size <= NEWTON
    if grouping is None:
        if newton:
            return minimise_design(stage.design, rows, _off_the_border(at, rows), limits, watch)
        return minimise_relaxed(stage, rows, at, limits, watch)
    first = grouping.rows(at)
    if newton:
        idle = stage.prices[:, [grouping.allowed.idle]]
        design = Design(grouping.rows(stage.design.information.reshape(*stage.shape, stage.states, stage.states)),
                        stage.criterion, None, grouping.rows(stage.prices - idle))  # type: ignore[arg-type]  # fmt: skip
        found = minimise_design(design, rows, _off_the_border(first, rows), limits, watch)
    else:
        found = minimise_relaxed(Grouped(stage, grouping), rows, rows.project(first), limits, watch)
    found.weights = grouping.policy(found.weights)
    found.gradient = stage.cost_and_gradient(found.weights)[1]
    constant = stage.cost(found.weights) - found.cost  # prices of idle, if it has any
    found.cost, found.lower_bound = found.cost + constant, found.lower_bound + constant
    return found


def _off_the_border(start: np.ndarray, rows: IntervalPolytopes) -> np.ndarray:
    """Shares strictly inside the limits, near `start` (G, K)."""
    return 0.9 * start + 0.1 * rows.uniform()


def _inside(objective: InformationObjective, allowed: IntervalPolytopes) -> np.ndarray:
    """A policy (N, M) that sees every direction."""
    if not isinstance(allowed, BudgetSet):
        start = allowed.uniform()
    elif Grouping(allowed).number is not None:
        grouping = Grouping(allowed)
        start = grouping.policy(grouping.set().uniform())
    else:
        rng = np.random.default_rng(0)
        start = np.mean([allowed.vertex(rng.standard_normal(allowed.shape)) for _ in range(MIXED)], axis=0)
    if not np.isfinite(objective.cost(start)):
        raise InfeasibleError(
            "no schedule of these readings determines every state that the outputs need\n"
            "  hint: more readings, or an initial covariance"
        )
    return start


def _exact(
    objective: InformationObjective,
    lower: LowerModel,
    allowed: IntervalPolytopes,
    relaxed: RelaxedOutcome,
    method: Schedule,
    monitor: Monitor,
) -> np.ndarray:
    """The best exact design (N, M) near the shares; a search ends where the bound is reached."""
    shares, size = relaxed.weights, 1.0 if objective.signed else abs(relaxed.cost)
    enough = relaxed.lower_bound + method.relative_gap * size
    if isinstance(allowed, BudgetSet):
        rng = np.random.default_rng(0)
        moved = MOVED if shares.size <= MANY else 1
        starts = [allowed.round(shares)]
        starts += [allowed.vertex(-shares - NOISE * rng.random(allowed.shape)) for _ in range(moved)]
    else:
        starts = roundings(shares, allowed)
    if shares.size <= MANY:
        starts.append(_simple(Greedy(), objective, allowed))
    ranked = sorted(((objective.cost(v), i) for i, v in enumerate(starts)), key=lambda each: each)
    best_cost, best = ranked[0][0], starts[ranked[0][1]]
    for cost, i in ranked:
        if best_cost <= enough or not np.isfinite(cost) or not method.polish or monitor.stop:
            break
        if isinstance(allowed, BudgetSet):
            some = (TRIED, method.polish) if shares.size <= MANY else (FEWER, min(FEWER, method.polish))
            v, value = by_moves(lower, allowed, starts[i], some[0], monitor, some[1])
        else:
            done = polish(lower, allowed, starts[i], method.polish, monitor)  # type: ignore[arg-type]
            v, value = done.weights, done.cost
        if value < best_cost:
            best_cost, best = value, v
    return best


def _simple(method: Doable, objective: InformationObjective, allowed: IntervalPolytopes) -> np.ndarray:
    """The policy (N, M) of a simple method."""
    seed = method.seed if isinstance(method, Random) else 1
    if isinstance(allowed, BudgetSet):
        if isinstance(method, Greedy):
            return greedy_with_budget(_vague(objective), allowed, WEIGHED)
        return in_turn_with_budget(allowed) if isinstance(method, RoundRobin) else random_policy(allowed, seed)
    if isinstance(method, Greedy):
        return _greedy(_vague(objective), allowed)
    if isinstance(method, BestSingle):
        return best_single(objective, allowed)
    if isinstance(method, RoundRobin):
        return round_robin(objective.recursion, allowed, method.dwell)
    return random_policy(allowed, seed)


def _vague(objective: InformationObjective) -> Design:
    """J with a prior that tells next to nothing, so that the first readings have a finite cost."""
    mean = np.mean(np.abs(objective.design.information), axis=0)
    prior = VAGUE * np.diag(np.maximum(np.diagonal(mean), 1e-300))
    information = objective.design.information.reshape(*objective.shape, objective.states, objective.states)
    return Design(information, objective.criterion, prior, objective.prices)  # type: ignore[arg-type]


def _greedy(vague: Design, allowed: IntervalPolytopes) -> np.ndarray:
    """Decision after decision the reading that is best if none follows."""
    v = np.zeros(allowed.shape)
    for k in range(len(v)):
        here = allowed.part(k, k + 1)
        for _ in range(allowed.places):
            open_ = np.flatnonzero(here.exchange_masks(v[k : k + 1])[1][0])
            costs = []
            for j in open_:
                v[k, j] += 1.0
                costs.append(vague.cost(v))
                v[k, j] -= 1.0
            v[k, open_[int(np.argmin(costs))]] += 1.0
    return v

"""A lower bound over all schedules that keep the rules: F minimised over mixtures of such schedules.

For any policy v and any prices mu >= 0 of the rows, nu >= 0 of the error, with L = F + nu (E - max_error), g = dL/dv,

    F(w) >= L(v) - g.v + min over w of [ g.w + switching(w) + mu.u(w) ] - mu.b        for every schedule w

because L is convex in v. The minimum is the oracle's. Its schedule becomes a column of the master problem, whose
mixture is the next v: simplicial decomposition (von Hohenbalken 1977). At the end bound and mixture meet.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.scheduling.feasible_set import IntervalPolytopes
from occontrol.scheduling.relaxation import RelaxedOptions, minimise_relaxed
from occontrol.scheduling.rules.check import RELATIVE
from occontrol.scheduling.rules.master import Master, Multipliers, Tangent
from occontrol.scheduling.rules.oracle import Prices
from occontrol.scheduling.rules.plan import Plan
from occontrol.scheduling.rules.rows import Mean, Rows, priced
from occontrol.scheduling.rules.task import Task

MOST_PLANS = 150
SMALL_SHARE = 1e-9
ENOUGH = 0.1  # of what a node lacks to be left
STEPS = 60  # of one master


@dataclass
class Hull:
    """What the decomposition found.

    Parameters
    ----------
    lower_bound : proven for every schedule of the mask that keeps the rules; inf where there is none
    tangent : at the last policy
    proof : (policy (N, C), Multipliers, bound) of the best bound
    multipliers : of the last master
    plans : columns, with their `shares`
    rounds : calls of the oracle
    line : constant and gradient (N, C) of the linear function behind the bound, where it is no tangent's; or None
    """

    lower_bound: float
    tangent: Tangent
    proof: tuple[np.ndarray, Multipliers, float]
    multipliers: Multipliers
    plans: list[Plan] = field(default_factory=list)
    shares: np.ndarray = field(default_factory=lambda: np.empty(0))
    rounds: int = 0
    line: tuple[float, np.ndarray] | None = None


@dataclass(frozen=True)
class HullOptions:
    """When to stop.

    Parameters
    ----------
    gap : relative, of mixture and bound
    cutoff : called for the bound that is high enough; it may fall meanwhile
    most : calls of the oracle
    known : a bound that is known already, with the policy and the multipliers that prove it
    value : of a mixture that keeps all rows, where one is known already
    """

    gap: float
    cutoff: Callable[[], float]
    most: int = 200
    known: tuple[np.ndarray, Multipliers, float] | None = None
    value: float = np.inf


def bound_at(
    task: Task, rows: Rows, at: Tangent, multipliers: Multipliers, mask: np.ndarray | None
) -> tuple[float, Plan | None]:
    """The bound that a tangent and multipliers prove, and the schedule that attains the minimum in it.

    Parameters
    ----------
    task, rows : what is to be bounded
    at : Tangent, at any policy
    multipliers : Multipliers, not negative
    mask : (N, A) allowed actions, or None
    """
    constant, g, prices = _tangent_line(task, rows, at, multipliers)
    least, plan = task.oracle.minimise(g, prices, mask)
    return (np.inf, None) if plan is None else (constant + least, plan)


def bounds_at(task: Task, rows: Rows, at: Tangent, multipliers: Multipliers, mask: np.ndarray | None) -> np.ndarray:
    """(N, A) the bound that a tangent and multipliers prove for the schedules that do action a on interval k.

    Parameters
    ----------
    task, rows : what is to be bounded
    at : Tangent, at any policy
    multipliers : Multipliers, not negative
    mask : (N, A) allowed actions, or None
    """
    constant, g, prices = _tangent_line(task, rows, at, multipliers)
    return constant + task.oracle.least_through(g, prices, mask)


def _tangent_line(task: Task, rows: Rows, at: Tangent, multipliers: Multipliers) -> tuple[float, np.ndarray, Prices]:
    """Constant, gradient (N, C) and prices of the linear function below the Lagrangian."""
    goal = task.goal
    factor = goal.error + multipliers.error
    g = goal.observation * task.price + factor * at.slope
    prices, owed = priced(rows.known, multipliers.rows, *task.spend.shape)
    constant = goal.observation * at.linear + factor * at.error - float(np.vdot(g, at.weights)) - owed
    if multipliers.error > 0:
        constant -= multipliers.error * task.rules.max_error * (1 + RELATIVE)
    return constant, g, prices


def hull(
    task: Task,
    rows: Rows,
    start: tuple[np.ndarray, Multipliers, list[Plan]],
    mask: np.ndarray | None,
    options: HullOptions,
    seen: Callable[[Plan], None],
    monitor: Monitor,
    taken: Callable[[Tangent], None] = lambda at: None,
) -> Hull:
    """The decomposition, from a policy on.

    Parameters
    ----------
    task, rows : what is to be bounded
    start : policy (N, C), Multipliers and known plans to begin with
    mask : (N, A) allowed actions, or None
    options : HullOptions
    seen : called with every new plan of the oracle
    monitor : Monitor
    taken : called with the tangent of every mixture
    """
    v, multipliers, plans = start
    plans = list(plans)
    keys = {p.key for p in plans}
    at = Tangent.at(task, v)
    found = Hull(-np.inf, at, (v, multipliers, -np.inf), multipliers, plans)
    limited = bool(rows.known) or np.isfinite(task.rules.max_error) or not task.complete
    if options.known is not None:
        found.proof, found.lower_bound = options.known, options.known[2]
    value, last, idle = options.value, -np.inf, 0
    scale = max(task.size(abs(task.goal.observation * at.linear) + abs(task.goal.error * at.error)), 1e-300)
    while True:
        found.rounds += 1
        taken(at)
        multipliers = multipliers.padded(len(rows.known))
        bound, plan = bound_at(task, rows, at, multipliers, mask)
        if bound > found.lower_bound:
            found.lower_bound, found.proof = bound, (at.weights, multipliers, bound)
        if plan is None:
            found.lower_bound = np.inf
            return found
        fresh = plan.key not in keys
        if fresh:
            plans.append(plan)
            keys.add(plan.key)
            seen(plan)
        scale = max(task.size(value), 1e-300) if np.isfinite(value) else scale
        gap, cutoff = value - found.lower_bound, options.cutoff()
        # a mixture below the cutoff cannot be closed by any bound: branching helps more than digits
        enough = max(options.gap * scale, ENOUGH * min(cutoff - value, scale) if np.isfinite(value) else 0.0)
        if found.lower_bound >= cutoff or gap <= enough or monitor.stop:
            break
        idle = 0 if fresh or found.lower_bound > last + 0.1 * options.gap * scale else idle + 1
        last = found.lower_bound
        if found.rounds >= options.most or idle > (6 if limited else 2):
            break
        target = max(0.3 * enough, 0.2 * gap if np.isfinite(gap) and not limited else 0.0)
        if idle:
            target = 0.03 * options.gap * scale
        at, multipliers, shares, mixed = _mixture(task, rows, plans, found.shares, multipliers, target, scale, monitor)
        kept = np.flatnonzero((shares > SMALL_SHARE) | (np.arange(len(plans)) >= len(plans) - 10))
        if len(plans) > MOST_PLANS and len(kept) < len(plans):
            plans[:] = [plans[i] for i in kept]
            shares = shares[kept]
            keys = {p.key for p in plans}
        found.shares, found.tangent, found.multipliers = shares, at, multipliers
        if not limited:
            value = mixed
        else:
            value = _judged(task, rows, plans, shares, at, mixed)
    return found


def _mixture(
    task: Task,
    rows: Rows,
    plans: list[Plan],
    shares: np.ndarray,
    multipliers: Multipliers,
    target: float,
    scale: float,
    monitor: Monitor,
) -> tuple[Tangent, Multipliers, np.ndarray, float]:
    """The best mixture: the tangent there, new multipliers, shares (P,), and the value of the master."""
    master = Master(task, plans, rows.known, multipliers, scale)
    start = np.zeros((1, len(plans)))
    start[0, : len(shares)] = shares
    if not len(shares):
        start[:] = 1.0 / len(plans)
    else:
        start[0, len(shares) :] = 0.0
        start /= np.sum(start)
    if len(plans) > 1:
        allowed = IntervalPolytopes(np.ones((1, len(plans))), 1)
        limits = RelaxedOptions(max_iterations=STEPS, absolute_gap=max(target, 1e-14 * scale))
        outcome = minimise_relaxed(master, allowed, start, limits, monitor.child(silent=True))
        start, value = outcome.weights, outcome.cost
    else:
        value = master.cost(start)
    at = Tangent.at(task, master.policy(start))
    return at, master.updated(start, at.error), start.ravel(), value


def _judged(task: Task, rows: Rows, plans: list[Plan], shares: np.ndarray, at: Tangent, mixed: float) -> float:
    """The value of the mixture where it keeps all rows, those that are made now included; inf where it does not."""
    fresh = rows.separate(Mean.of(plans, shares))
    used = [(p, s) for p, s in zip(plans, shares, strict=True) if s > 0]
    excess = [sum(s * row.use(p) for p, s in used) - row.limit for row in rows.known]
    over = at.error - task.rules.max_error if np.isfinite(task.rules.max_error) else -1.0
    if fresh or any(x > 1e-5 for x in excess) or over > 1e-5 * abs(task.rules.max_error):
        return np.inf
    switching = float(sum(s * p.switching for p, s in zip(plans, shares, strict=True)))
    return max(task.goal.observation * at.linear + task.goal.error * at.error + switching, mixed)


def filled(found: Hull) -> np.ndarray:
    """Shares of all plans, zero for those that no master has seen."""
    return np.pad(found.shares, (0, len(found.plans) - len(found.shares)))


def inherited(found: Hull, mask: np.ndarray) -> tuple[np.ndarray, Multipliers, list[Plan]]:
    """Where the hull of a narrower mask (N, A) begins: at the mixture, without the schedules that are forbidden."""
    rows = np.arange(len(mask))
    kept = [(p, s) for p, s in zip(found.plans, filled(found), strict=True) if np.all(mask[rows, p.actions])]
    plans, shares, v = [p for p, _ in kept], np.array([s for _, s in kept]), found.tangent.weights
    if plans:
        shares = shares / np.sum(shares) if np.sum(shares) > 0 else np.full(len(plans), 1 / len(plans))
        v = np.einsum("p,pnc->nc", shares, np.array([p.weights for p in plans]))
    return v, found.multipliers, plans

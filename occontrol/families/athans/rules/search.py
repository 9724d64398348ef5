"""Schedules under rules on any clock: seeds, tree or mixture, and what other methods find, made to keep the rules."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from occontrol.core.errors import InfeasibleError, SolveFailed, UsageError
from occontrol.core.kinds import PlainDict
from occontrol.core.monitor import Monitor
from occontrol.core.solution import Status
from occontrol.families.athans.methods import Exact, HMinimal, Relaxed, RelaxRoundPolish
from occontrol.families.athans.rules.columns import on_of
from occontrol.families.athans.rules.diagnosis import blamed, refusal
from occontrol.families.athans.rules.frame import Frame
from occontrol.families.athans.rules.plain_bound import slewing_bound
from occontrol.scheduling.feasible_set import FeasibleSet
from occontrol.scheduling.proof import Proof
from occontrol.scheduling.relaxation import RelaxedOutcome
from occontrol.scheduling.rules.apart import Apart
from occontrol.scheduling.rules.capped import begun_at_price
from occontrol.scheduling.rules.caps import cap_of, only_cap
from occontrol.scheduling.rules.hull import Hull
from occontrol.scheduling.rules.plan import Plan
from occontrol.scheduling.rules.rows import Rows
from occontrol.scheduling.rules.task import Task
from occontrol.scheduling.rules.tree import Search, Tree, TreeOptions
from occontrol.scheduling.sweep import Sweep

NODES = 12  # of a search that is not asked to be exact
FIRST = 500  # nodes in which a first schedule must be found
MOVES = 1500  # evaluations of the true cost for the best schedule, where the tree is short
NONE = "no schedule keeps all rules together: the tree of all schedules was searched to its end"
UNSEEN = (
    "no schedule that keeps the rules determines every state that the outputs need: the tree of all schedules was "
    "searched to its end\n  hint: rules that leave room for more sensors, or an initial covariance"
)
_NOT_FOUND = (
    "no schedule that keeps the rules was found within the limits, though none of the rules is impossible by itself; "
    "method: {name: schedule, exact: {max_nodes: ..}} searches on, or relax a rule"
)


@dataclass
class Outcome:
    """What a method found under rules.

    Parameters
    ----------
    plan : the schedule; None for a mixture
    weights : (N, C) of the recursion's columns
    switching : what its changes cost
    lower_bound : proven by the search
    root : the first node's hull
    rows : Rows of the search
    nodes : of the tree
    on : (N, M) shares of use of a mixture
    relaxed : the relaxation without rules
    status : how it ended
    message : in words
    target : relative gap of the relaxation
    gap : relative gap at which a schedule counts as proven optimal
    exact : whether the search was to go on to the end
    steps_chosen : whether the steps of integration are ours and not the file's
    """

    plan: Plan | None
    weights: np.ndarray
    switching: float
    lower_bound: float
    root: Hull
    rows: Rows
    nodes: int
    on: np.ndarray | None = None
    relaxed: RelaxedOutcome | None = None
    status: Status = Status.FEASIBLE
    message: str = ""
    target: float = 1e-4
    gap: float = 1e-6
    exact: bool = False
    steps_chosen: bool = False
    extra: PlainDict = field(default_factory=dict)

    def concluded(self, proof: Proof) -> tuple[Status, bool]:
        """How it ended once the certificate is known, and whether the schedule is proven optimal.

        Parameters
        ----------
        proof : Proof of the outcome
        """
        proven = self.plan is not None and bool(proof.certificate.relative_gap <= self.gap)
        status = self.status
        if self.exact and status is Status.FEASIBLE and proven:
            status = Status.CERTIFIED
        if status is Status.CERTIFIED and not proof.resolved(max(self.target, self.gap)):
            status = Status.FEASIBLE
        return status, proven


@dataclass(frozen=True, eq=False)
class Work:
    """One solve.

    Parameters
    ----------
    task : Task
    frame : Frame of the problem as the user stated it
    sweep : J without columns for sensors that warm up; not looked at where there is a `policy`
    allowed : FeasibleSet without rules
    relaxed : the relaxation without rules
    monitor : Monitor
    known : (N, M) what is on in a schedule to begin with, or None
    policy : what a method finds without rules, (N, M), with its message; None where the method is asked for it
    """

    task: Task
    frame: Frame
    sweep: Sweep | None
    allowed: FeasibleSet
    relaxed: RelaxedOutcome
    monitor: Monitor
    known: np.ndarray | None = None
    policy: Callable[[Any], tuple[np.ndarray, str]] | None = None


def blind(task: Task) -> bool:
    """Whether nothing is known before the readings, so that a schedule of a `task` may cost infinitely much."""
    return task.model is not None and task.model.vague is not None


def start_of(task: Task, relaxed: RelaxedOutcome) -> np.ndarray:
    """(N, C) where the first bound is taken: the relaxed policy without warming."""
    N, C = task.oracle.shape
    start = np.zeros((N, C))
    start[:, : relaxed.weights.shape[1]] = relaxed.weights
    return start


def searched(
    task: Task,
    relaxed: RelaxedOutcome,
    options: TreeOptions,
    monitor: Monitor,
    seeds: list[Plan],
    allowed: FeasibleSet | None = None,
) -> tuple[Search, Tree]:
    """A search from the relaxed policy, or with one cap from its price.

    Parameters
    ----------
    task : Task
    relaxed : RelaxedOutcome
    options : TreeOptions
    monitor : Monitor
    seeds : plans to begin with
    allowed : FeasibleSet without rules; without it no price is looked for
    """
    monitor.stage = "rules"
    search = Search(task, options, monitor, seeds)
    start, cap = start_of(task, relaxed), cap_of(task)
    begun = None if cap is None or allowed is None else begun_at_price(search, cap, start, allowed)
    return search, search.run(start, begun, Apart if monitor.spread.count > 1 else None)


def run(work: Work, method: Any) -> Outcome:
    """What a method of the family, but collocation, finds under rules.

    Parameters
    ----------
    work : Work
    method : of the family

    Raises InfeasibleError where no schedule keeps the rules, SolveFailed where none was found, UsageError for a method
    that does not do them.
    """
    if isinstance(method, RelaxRoundPolish):
        outcome = _scheduled(work, method)
    elif isinstance(method, Relaxed):
        outcome = _relaxed(work)
    else:
        outcome = _obeying(work, method)
    outcome.relaxed, outcome.target = work.relaxed, method.relative_gap
    return outcome


def _scheduled(work: Work, method: RelaxRoundPolish) -> Outcome:
    exact = method.exact_options
    # where nothing but a cap binds the intervals together, a few nodes prove next to nothing
    most = 1 if only_cap(work.task) else NODES
    options = TreeOptions(Exact().relative_gap, most, MOVES if method.polish else 0, FIRST)
    watch = work.monitor.child()
    if exact is not None:
        options = TreeOptions(exact.relative_gap, exact.max_nodes, options.moves, exact.max_nodes)
        watch = work.monitor.child(exact.time_limit)
    search, tree = searched(work.task, work.relaxed, options, watch, seeds_of(work), work.allowed)
    if tree.best is None:
        if tree.complete and np.isinf(tree.lower_bound):
            if blind(work.task):
                raise InfeasibleError(UNSEEN)
            raise refusal(NONE, blamed(work.frame, work.task.rules))
        raise SolveFailed(_NOT_FOUND)
    plan = tree.best.plan
    bound = max(tree.lower_bound, _without_rules(work))
    outcome = Outcome(plan, plan.weights, plan.switching, bound, tree.root, search.rows, tree.nodes)
    outcome.gap = options.gap
    outcome.status = Status.FEASIBLE if exact is not None else work.relaxed.status
    outcome.exact = exact is not None
    if work.monitor.interrupted:
        outcome.status = Status.INTERRUPTED
    return outcome


def _without_rules(work: Work) -> float:
    """The relaxation's bound, which holds with rules too: the hull of the first node need not have reached it."""
    goal = work.task.goal
    if goal.observation != 1.0 or goal.error != 1.0:
        return -np.inf
    return slewing_bound(work.relaxed.lower_bound, work.task, work.frame.upper)


def seeds_of(work: Work) -> list[Plan]:
    """The schedule of an earlier solution, and what comes nearest to the rounded relaxation."""
    task = work.task
    plans = [nearest(task, work.allowed.round(work.relaxed.weights))]
    if work.known is not None:
        plans.append(task.oracle.follow(work.known))
    earlier = work.monitor.resume
    if earlier is not None and work.monitor.resumed and earlier.schedule is not None:
        weights = np.asarray(earlier.schedule.weights)
        if weights.shape == task.spend.shape and np.array_equal(earlier.schedule.edges, task.edges):
            plans.append(task.oracle.follow(on_of(weights, task.rules)))
    return [plan for plan in plans if plan is not None]


def nearest(task: Task, weights: np.ndarray) -> Plan | None:
    """The plan that differs from integral weights (N, M) for the shortest time.

    Parameters
    ----------
    task : Task
    weights : (N, M)
    """
    oracle, rules = task.oracle, task.rules
    wanted = on_of(weights, rules)
    differs = np.any(wanted[:, None, :] != oracle.automaton.on[None], axis=2)
    return oracle.nearest(differs * oracle.grid.steps[:, None])


def _relaxed(work: Work) -> Outcome:
    """The best mixture of schedules that keep the rules."""
    options = TreeOptions(Exact().relative_gap, 1, 0, 1)
    search, tree = searched(work.task, work.relaxed, options, work.monitor, [])
    root: Hull = tree.root
    if np.isinf(root.lower_bound):
        raise refusal(NONE, blamed(work.frame, work.task.rules))
    shares = np.pad(root.shares, (0, len(root.plans) - len(root.shares)))
    switching = float(sum(s * p.switching for s, p in zip(shares, root.plans, strict=True)))
    on = sum(s * p.on for s, p in zip(shares, root.plans, strict=True))
    outcome = Outcome(None, root.tangent.weights, switching, root.lower_bound, root, search.rows, 1)
    outcome.on, outcome.status = np.asarray(on, dtype=float), work.relaxed.status
    return outcome


def _obeying(work: Work, method: Any) -> Outcome:
    """What another method finds without rules, changed for as short a time as they ask for."""
    monitor = work.monitor
    if work.policy is not None:
        weights, message = work.policy(method)
    elif isinstance(method, HMinimal):
        found = method.run(None, work.sweep, work.allowed, monitor)  # type: ignore[arg-type]
        weights, message = found.weights, found.message
    else:
        weights, message = method.policy(work.sweep, work.allowed), ""
    plan = nearest(work.task, weights)
    if plan is None:
        raise InfeasibleError(NONE)
    if not np.isfinite(work.task.value(plan)):
        what = f"{method.name} does not do these rules: the nearest schedule that keeps the others breaks a budget"
        what += " or the limit" if work.task.model is not None and work.task.model.limit is not None else ""
        what += " or leaves a direction of the states unseen" if blind(work.task) else ""
        raise UsageError(f"{what}\n  hint: method: schedule")
    options = TreeOptions(Exact().relative_gap, 1, 0, 1)
    search, tree = searched(work.task, work.relaxed, options, monitor, [plan])
    outcome = Outcome(plan, plan.weights, plan.switching, tree.lower_bound, tree.root, search.rows, 1)
    outcome.status = Status.INTERRUPTED if monitor.interrupted else work.relaxed.status
    outcome.message = message
    return outcome

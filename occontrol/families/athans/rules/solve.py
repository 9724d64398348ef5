"""Solving with rules: relaxation, hull, block moves and, where wished, the tree to the end."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from occontrol.core import stopwatch
from occontrol.core.errors import InfeasibleError, SolveFailed, UsageError
from occontrol.core.monitor import Monitor
from occontrol.core.solution import Solution, Status
from occontrol.families.athans.balanced import balanced, restored
from occontrol.families.athans.discretise import feasible_set
from occontrol.families.athans.found import relax
from occontrol.families.athans.integration.refine import search_space
from occontrol.families.athans.methods import Exact, HMinimal, Relaxed, RelaxRoundPolish
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.families.athans.rules.assembly import Outcome, assemble_ruled, slewing_bound
from occontrol.families.athans.rules.diagnosis import blamed, refusal
from occontrol.families.athans.rules.setting import Setting, on_of, prepared, setting_of
from occontrol.scheduling.relaxation import RelaxedOutcome
from occontrol.scheduling.rules.hull import Hull
from occontrol.scheduling.rules.plan import Plan
from occontrol.scheduling.rules.tree import Search, Tree, TreeOptions
from occontrol.scheduling.sweep import Sweep

NODES = 12  # of a search that is not asked to be exact
FIRST = 500  # nodes in which a first schedule must be found
MOVES = 1500  # evaluations of the true cost for the best schedule, where the tree is short
_NONE = "no schedule keeps all rules together: the tree of all schedules was searched to its end"
_NOT_FOUND = (
    "no schedule that keeps the rules was found within the limits, though none of the rules is impossible by itself; "
    "method: {name: schedule, exact: {max_nodes: ..}} searches on, or relax a rule"
)


@dataclass
class _Work:
    """One solve."""

    setting: Setting
    sweep: Sweep
    relaxed: RelaxedOutcome
    monitor: Monitor


def solve_ruled(problem: SchedulingProblem, method: Any, monitor: Monitor) -> Solution:
    """The schedule that a method finds for a problem with rules, or without rules for the exact optimum.

    Parameters
    ----------
    problem : SchedulingProblem
    method : of the family
    monitor : Monitor

    Raises InfeasibleError where no schedule keeps the rules, SolveFailed where none was found, UsageError for a method
    that does not do rules.
    """
    if method.name == "collocation":
        raise UsageError(f"{method.name} does not do rules on schedules\n  hint: method: schedule")
    problem.require_feasible()
    began = stopwatch.seconds()
    inner, units = balanced(prepared(problem, method.relative_gap))
    integrator, sweep = search_space(inner, method, monitor)
    base = relax(sweep, feasible_set(inner), monitor, method.relative_gap)
    setting = setting_of(inner, integrator)
    work = _Work(setting, sweep, base.relaxed, monitor)  # type: ignore[arg-type]
    if isinstance(method, RelaxRoundPolish):
        outcome = _scheduled(work, problem, method)
    elif isinstance(method, Relaxed):
        outcome = _relaxed(work, problem)
    else:
        outcome = _obeying(work, problem, method)
    outcome.relaxed = base.relaxed
    outcome.target = method.relative_gap
    outcome.steps_chosen = problem.integration.substeps is None
    solution = assemble_ruled(setting, outcome, method.name, monitor, began)
    return restored(solution, problem, units)


def start_of(setting: Setting, relaxed: RelaxedOutcome) -> np.ndarray:
    """(N, C) where the first bound is taken: the relaxed policy without warming."""
    N, C = setting.task.oracle.shape
    start = np.zeros((N, C))
    start[:, : relaxed.weights.shape[1]] = relaxed.weights
    return start


def searched(
    setting: Setting, relaxed: RelaxedOutcome, options: TreeOptions, monitor: Monitor, seeds: list[Plan]
) -> tuple[Search, Tree]:
    """A search from the relaxed policy.

    Parameters
    ----------
    setting : Setting
    relaxed : RelaxedOutcome
    options : TreeOptions
    monitor : Monitor
    seeds : plans to begin with
    """
    monitor.stage = "rules"
    search = Search(setting.task, options, monitor, seeds)
    return search, search.run(start_of(setting, relaxed))


def _scheduled(work: _Work, problem: SchedulingProblem, method: RelaxRoundPolish) -> Outcome:
    setting, exact = work.setting, method.exact_options
    options = TreeOptions(Exact().relative_gap, NODES, MOVES if method.polish else 0, FIRST)
    watch = work.monitor.child()
    if exact is not None:
        options = TreeOptions(exact.relative_gap, exact.max_nodes, options.moves, exact.max_nodes)
        watch = work.monitor.child(exact.time_limit)
    search, tree = searched(setting, work.relaxed, options, watch, _seeds(work))
    if tree.best is None:
        if tree.complete and np.isinf(tree.lower_bound):
            raise refusal(problem, _NONE, blamed(problem, setting.task.rules))
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


def _without_rules(work: _Work) -> float:
    """The relaxation's bound, which holds with rules too: the hull of the first node need not have reached it."""
    goal, setting = work.setting.task.goal, work.setting
    if goal.observation != 1.0 or goal.error != 1.0:
        return -np.inf
    bound = work.relaxed.lower_bound
    return slewing_bound(bound, setting) if setting.problem.slews else bound


def _seeds(work: _Work) -> list[Plan]:
    """The schedule of an earlier solution, and what comes nearest to the rounded relaxation."""
    task, allowed = work.setting.task, feasible_set(work.setting.problem)
    plans = [nearest(work.setting, allowed.round(work.relaxed.weights))]
    earlier = work.monitor.resume
    if earlier is not None and work.monitor.resumed and earlier.schedule is not None:
        weights = np.asarray(earlier.schedule.weights)
        if weights.shape == task.spend.shape and np.array_equal(earlier.schedule.edges, work.setting.problem.edges):
            plans.append(task.oracle.follow(on_of(weights, task.rules)))
    return [plan for plan in plans if plan is not None]


def nearest(setting: Setting, weights: np.ndarray) -> Plan | None:
    """The plan that differs from integral weights (N, M) for the shortest time.

    Parameters
    ----------
    setting : Setting
    weights : (N, M)
    """
    oracle, rules = setting.task.oracle, setting.task.rules
    wanted = on_of(weights, rules)
    differs = np.any(wanted[:, None, :] != oracle.automaton.on[None], axis=2)
    return oracle.nearest(differs * oracle.grid.steps[:, None])


def _relaxed(work: _Work, problem: SchedulingProblem) -> Outcome:
    """The best mixture of schedules that keep the rules."""
    options = TreeOptions(Exact().relative_gap, 1, 0, 1)
    search, tree = searched(work.setting, work.relaxed, options, work.monitor, [])
    root: Hull = tree.root
    if np.isinf(root.lower_bound):
        raise refusal(problem, _NONE, blamed(problem, work.setting.task.rules))
    shares = np.pad(root.shares, (0, len(root.plans) - len(root.shares)))
    switching = float(sum(s * p.switching for s, p in zip(shares, root.plans, strict=True)))
    on = sum(s * p.on for s, p in zip(shares, root.plans, strict=True))
    outcome = Outcome(None, root.tangent.weights, switching, root.lower_bound, root, search.rows, 1)
    outcome.on, outcome.status = np.asarray(on, dtype=float), work.relaxed.status
    return outcome


def _obeying(work: _Work, problem: SchedulingProblem, method: Any) -> Outcome:
    """What another method finds without rules, changed for as short a time as they ask for."""
    setting, monitor = work.setting, work.monitor
    if isinstance(method, HMinimal):
        found = method.run(setting.problem, work.sweep, feasible_set(setting.problem), monitor)
        weights, message = found.weights, found.message
    else:
        weights, message = method.policy(work.sweep, feasible_set(setting.problem)), ""
    plan = nearest(setting, weights)
    if plan is None:
        raise InfeasibleError(_NONE)
    if not np.isfinite(setting.task.value(plan)):
        what = f"{method.name} does not do these rules: the nearest schedule that keeps the others breaks a budget"
        raise UsageError(f"{what}\n  hint: method: schedule")
    options = TreeOptions(Exact().relative_gap, 1, 0, 1)
    search, tree = searched(setting, work.relaxed, options, monitor, [plan])
    outcome = Outcome(plan, plan.weights, plan.switching, tree.lower_bound, tree.root, search.rows, 1)
    outcome.status = Status.INTERRUPTED if monitor.interrupted else work.relaxed.status
    outcome.message = message
    return outcome

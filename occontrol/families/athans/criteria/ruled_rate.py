"""Continuous sensing with a criterion and rules: the search for rules on the grid, the bound without them beyond it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occontrol.core import stopwatch
from occontrol.core.errors import Mistake, ProblemError, SolveFailed, UsageError
from occontrol.core.method import Method
from occontrol.core.monitor import Monitor
from occontrol.core.solution import Solution
from occontrol.families.athans.balanced import balanced, restored
from occontrol.families.athans.criteria.rate_assembly import UnderRules, assembled
from occontrol.families.athans.criteria.rate_objective import Measured, measured_of
from occontrol.families.athans.criteria.ruled import begun, work_of
from occontrol.families.athans.criteria.search import Hunted
from occontrol.families.athans.discretise import feasible_set
from occontrol.families.athans.found import Found
from occontrol.families.athans.methods import RelaxRoundPolish
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.families.athans.rules.binding import active_rules, multipliers_of
from occontrol.families.athans.rules.certify import require_rules
from occontrol.families.athans.rules.columns import on_of, user_weights
from occontrol.families.athans.rules.plain_bound import slewing_bound
from occontrol.families.athans.rules.search import Outcome, Work, run, searched
from occontrol.families.athans.rules.setting import frame_of, prepared, setting_of
from occontrol.scheduling.rules.check import changes
from occontrol.scheduling.rules.model import KEEPS
from occontrol.scheduling.rules.proof import Claim, prove_under_rules
from occontrol.scheduling.rules.tree import TreeOptions


@dataclass(frozen=True, eq=False)
class _Ready:
    measured: Measured
    work: Work


def solve_ruled_rate(problem: SchedulingProblem, method: Method, monitor: Monitor) -> Solution:
    """Run `method` on a problem of continuous sensing with a criterion and rules, and certify what it found.

    Parameters
    ----------
    problem : with a criterion that is not the trace, and rules
    method : of the family
    monitor : Monitor

    Raises UsageError for a method that does not do them, InfeasibleError where nothing keeps rules and limit.
    """
    for name, does in (("collocation", method.name != "collocation"), ("off_grid", not _off_grid(method))):
        if not does:
            raise UsageError(f"{name} does not do criteria other than the trace\n  hint: method: schedule")
    problem.require_feasible()
    began = stopwatch.seconds()
    inner, units = balanced(prepared(problem, getattr(method, "relative_gap", 1e-4)))
    ready = _ready(problem, inner, method, monitor)
    outcome = run(ready.work, method)
    outcome.steps_chosen = problem.integration.substeps is None
    return restored(_assembled(ready, outcome, method.name, monitor, began), problem, units)


def judge_ruled_rate(
    problem: SchedulingProblem, weights: np.ndarray
) -> tuple[Solution, float]:
    """The solution that a given schedule is, and the cost of the best one known beside it.

    Parameters
    ----------
    problem : with a criterion and rules
    weights : (N, M) on its edges

    Raises ProblemError naming every rule that the schedule breaks, and a limit that it does not keep, SolveFailed where
    rules and search disagree on it.
    """
    began, monitor = stopwatch.seconds(), Monitor()
    require_rules(problem, weights)
    problem.require_feasible()
    method = RelaxRoundPolish(getattr(problem.method, "relative_gap", 1e-4))
    inner, units = balanced(prepared(problem, method.relative_gap))
    measured = measured_of(inner)
    setting = setting_of(inner, measured.integrator)
    plan = setting.task.oracle.follow(on_of(weights, setting.task.rules))
    if plan is None:
        raise SolveFailed("the schedule keeps every rule by itself, but not as the search counts them on these edges")
    if measured.limit is not None:
        measured.objective.cost(plan.weights[:, : len(problem.sensors)])
        if (peak := measured.objective.criterion_value) > measured.limit * (1 + KEEPS):
            what = f"the peak of the schedule is {peak:.8g}, the limit is {measured.limit:g}"
            raise ProblemError(Mistake(("schedule",), what))
    ready = _ready(problem, inner, method, monitor)
    task, relaxed = ready.work.task, ready.work.relaxed
    search, tree = searched(task, relaxed, TreeOptions(most=1, moves=0), monitor, [plan], ready.work.allowed)
    found = Outcome(plan, plan.weights, plan.switching, tree.lower_bound, tree.root, search.rows, tree.nodes)
    found.relaxed, found.status, found.target = relaxed, relaxed.status, method.relative_gap
    found.steps_chosen = problem.integration.substeps is None
    solution = restored(_assembled(ready, found, "certify", monitor, began), problem, units)
    return solution, np.inf if search.best is None else search.best.value


def _off_grid(method: Method) -> bool:
    return bool(getattr(method, "off_grid", False))


def _ready(problem: SchedulingProblem, inner: SchedulingProblem, method: Method, monitor: Monitor) -> _Ready:
    measured, frame, allowed = measured_of(inner), frame_of(problem), feasible_set(inner)
    task = setting_of(inner, measured.integrator).task
    begin = begun(measured.objective, measured.limit, task, frame, allowed, method, monitor)
    return _Ready(measured, work_of(begin, measured.objective, frame, allowed, monitor))


def _assembled(ready: _Ready, found: Outcome, name: str, monitor: Monitor, began: float) -> Solution:
    """Certify what the search found."""
    measured, task, relaxed = ready.measured, ready.work.task, ready.work.relaxed
    rules, plan, problem = task.rules, found.plan, measured.problem
    claim = Claim(plan, found.weights, found.switching, found.lower_bound, found.root.proof)
    proof = prove_under_rules(task, found.rows, claim)
    certificate = proof.certificate
    monitor.report(found.nodes, certificate.cost, certificate.lower_bound, stage="check")
    status, proven = found.concluded(proof)
    on = user_weights(plan.on, rules) if plan is not None else np.asarray(found.on)
    measuring = np.ascontiguousarray(found.weights[:, : len(problem.sensors)])
    hunted = Hunted(Found(measuring, found.nodes, status, found.message, relaxed, target=found.target))
    hunted.found.proves = True
    further = {
        "switching_cost": found.switching,
        "proven_optimal": proven,
        "nodes": found.nodes,
        "observation_cost": float(np.vdot(task.spend, plan.on if plan is not None else on)),
        "constraints": {"satisfied": True, "active": active_rules(task, plan, 0.0)},
        "multipliers": multipliers_of(task, found.rows, found.root),
        "relaxed_lower_bound": slewing_bound(relaxed.lower_bound, task, problem.upper),
        **({} if plan is None else {"switches": len(changes(rules, plan.on))}),
    }
    saved = -slewing_bound(0.0, task, problem.upper)
    under = UnderRules(on, proof, saved, found.steps_chosen, further)
    return assembled(measured, name, hunted, monitor, began, under)

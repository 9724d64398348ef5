"""Solving and judging problems of readings with rules: their recursion, and the search that continuous sensing has.

F = observation alpha sum cost + error (running + output) + changes,     as `minimise` says
"""

from __future__ import annotations

import dataclasses

import numpy as np

from occontrol.core import stopwatch
from occontrol.core.claims import Claims, false_claims
from occontrol.core.errors import InfeasibleError, Mistake, ProblemError, SolveFailed
from occontrol.core.method import Method
from occontrol.core.monitor import Monitor
from occontrol.core.printed import rounded_down
from occontrol.core.solution import Solution, Status
from occontrol.families.athans.certify import parts_of
from occontrol.families.athans.criteria.objective import objective_of, require_below
from occontrol.families.athans.criteria.ruled import begun, work_of
from occontrol.families.athans.found import relax
from occontrol.families.athans.methods import RelaxRoundPolish
from occontrol.families.athans.readings.assembly import Verdict, checked, collect, raised, reading_prices
from occontrol.families.athans.readings.fill import Filled, feasible_set, fill
from occontrol.families.athans.readings.plain import plain_cost
from occontrol.families.athans.readings.problem import ReadingsProblem
from occontrol.families.athans.readings.rules import frame_of, require_kept
from occontrol.families.athans.rules.binding import active_rules, multipliers_of
from occontrol.families.athans.rules.certify import require_whole
from occontrol.families.athans.rules.columns import on_of, user_weights, with_warming
from occontrol.families.athans.rules.frame import Frame
from occontrol.families.athans.rules.plain_bound import plain_bound
from occontrol.families.athans.rules.search import Outcome, Work, run, searched
from occontrol.families.athans.rules.setting import GOALS
from occontrol.scheduling.recursion import Recursion
from occontrol.scheduling.rules.check import RELATIVE, changes, switching_cost
from occontrol.scheduling.rules.proof import Claim, prove_under_rules
from occontrol.scheduling.rules.task import Task
from occontrol.scheduling.rules.tree import TreeOptions
from occontrol.scheduling.sweep import Sweep

WEIGHTS = {"error": 0.0, "observation": 1.0}  # of the observation cost, where it is not the problem's own


def solve_ruled(problem: ReadingsProblem, method: Method, monitor: Monitor) -> Solution:
    """The schedule that a method finds for a problem of readings with rules.

    Parameters
    ----------
    problem : ReadingsProblem
    method : of the family, but Collocation
    monitor : Monitor

    Raises InfeasibleError where no schedule keeps the rules, SolveFailed where none was found, UsageError for a method
    that does not do them.
    """
    problem.require_feasible()
    began = stopwatch.seconds()
    filled, frame, task = _stated(problem)
    work, note = _work(problem, filled, frame, task, method, monitor)
    outcome = run(work, method)
    return _assembled(problem, filled, work.task, outcome, method.name, monitor, began, note)


def certify_ruled(problem: ReadingsProblem, weights: np.ndarray, claims: Claims | None) -> Solution:
    """Cost, lower bound and gap of a schedule of readings for a problem with rules.

    Parameters
    ----------
    problem : ReadingsProblem
    weights : (E, M) of every decision
    claims : what somebody says of it; refuted claims make the status `disagrees`

    Raises ProblemError naming every rule that the schedule breaks, SolveFailed where rules and search disagree on it.
    """
    began, monitor = stopwatch.seconds(), Monitor()
    padded, whole, allowed = require_kept(problem, weights), require_whole(weights), feasible_set(problem)
    filled, frame, task = _stated(problem)
    problem.require_feasible()
    plan = task.oracle.follow(on_of(whole, task.rules))
    if plan is None:
        raise SolveFailed("the schedule keeps every rule by itself, but not as the search counts them")
    _, error = task.parts(plan.weights)
    if error > task.rules.max_error * (1 + RELATIVE):
        what = f"the error of the schedule is {error + filled.constant:.8g}, max_error is {frame.rules.max_error:g}"
        raise ProblemError(Mistake(("schedule",), what))
    gap = getattr(problem.method, "relative_gap", 1e-4)
    if problem.capped:
        require_below(problem, filled, padded)
    work, note = _work(problem, filled, frame, task, RelaxRoundPolish(gap), monitor)
    task, relaxed = work.task, work.relaxed
    search, tree = searched(task, relaxed, TreeOptions(most=1, moves=0), monitor, [plan], allowed)  # type: ignore[arg-type]
    found = Outcome(plan, plan.weights, plan.switching, tree.lower_bound, tree.root, search.rows, tree.nodes)
    found.relaxed, found.target = relaxed, gap
    found.status = Status.FEASIBLE if relaxed is None else relaxed.status
    solution = _assembled(problem, filled, task, found, "certify", monitor, began, note)
    if claims is None or solution.certificate is None:
        return solution
    best = np.inf if search.best is None else search.best.value + task.goal.error * filled.constant
    lowest = min(solution.certificate.cost, best)
    refuted = false_claims(claims, solution.certificate.cost, lowest, None, parts_of(solution.numbers))  # type: ignore[arg-type]
    if refuted:
        return dataclasses.replace(solution, status=Status.DISAGREES, message="; ".join(refuted))
    return solution


def _stated(problem: ReadingsProblem) -> tuple[Filled, Frame, Task]:
    """The recursion in terms of what is minimised, the rules as stated, and the task of the search.

    Raises InfeasibleError where the running integral alone exceeds max_error.
    """
    inner = dataclasses.replace(problem, cost_weight=WEIGHTS.get(problem.minimise, problem.cost_weight))
    filled, frame = fill(inner), frame_of(problem)
    rest = frame.rules.max_error - filled.constant  # the constant of the running integral is part of the error
    if rest < 0:
        raise InfeasibleError(
            f"whatever is read, the error is above {filled.constant:.6g}, and max_error is {frame.rules.max_error:.6g}"
            "\n  hint: a larger max_error"
        )
    rules = dataclasses.replace(frame.rules, max_error=rest)
    recursion = with_warming(filled.recursion, np.flatnonzero(rules.warm_up > 0))
    task = Task(rules, frame.edges, frame.oracle(), Sweep(recursion), frame.spend, GOALS[problem.minimise])
    return filled, frame, task


def _work(
    problem: ReadingsProblem, filled: Filled, frame: Frame, task: Task, method: Method, monitor: Monitor
) -> tuple[Work, str]:
    """What a search under rules works on, and what is to be said about the criterion."""
    allowed = feasible_set(problem)
    if problem.measured:
        objective, note = objective_of(problem, filled)
        limit = None if problem.criterion is None else problem.criterion.limit
        begin = begun(objective, limit, task, frame, allowed, method, monitor)
        return work_of(begin, objective, frame, allowed, monitor), note
    sweep = Sweep(filled.recursion)
    relaxed = relax(sweep, allowed, monitor, getattr(method, "relative_gap", 1e-4)).relaxed
    return Work(task, frame, sweep, allowed, relaxed, monitor), ""  # type: ignore[arg-type]


def _assembled(
    problem: ReadingsProblem,
    filled: Filled,
    task: Task,
    found: Outcome,
    name: str,
    monitor: Monitor,
    began: float,
    note: str,
) -> Solution:
    """Certify what the search found, and check it with the plain filter."""
    rules, goal, M = task.rules, task.goal, len(problem.sensors)
    plan = found.plan
    on = user_weights(plan.on, rules) if plan is not None else np.asarray(found.on)
    measuring = np.ascontiguousarray(found.weights[:, :M])
    claim = Claim(plan, found.weights, found.switching, found.lower_bound, found.root.proof)
    proof = raised(prove_under_rules(task, found.rows, claim), goal.error * filled.constant)
    certificate = proof.certificate
    monitor.report(found.nodes, certificate.cost, certificate.lower_bound, stage="check")
    plain = plain_cost(problem, filled.recursion.on_steps(measuring))
    spent = float(np.sum(reading_prices(problem) * filled.recursion.on_steps(on)))
    weight = WEIGHTS.get(problem.minimise, problem.cost_weight)
    switching = found.switching if plan is None else switching_cost(rules, plan.on)
    charged = plain.running + (0.0 if problem.capped else plain.criterion)
    total = goal.observation * weight * spent + goal.error * charged + switching
    status, proven = found.concluded(proof)
    status, message = checked(proof, plain, total, status, found.message)
    if status is not Status.DISAGREES:
        limit = None if problem.criterion is None else problem.criterion.limit
        message = message or _message(certificate.lower_bound, proven, found, name, limit)
        message += proof.remark(found.target) + (f" The {note}" if note else "")
    error = charged - filled.constant
    further = {
        "switching_cost": found.switching,
        "proven_optimal": proven,
        "nodes": found.nodes,
        "constraints": {"satisfied": True, "active": active_rules(task, plan, error)},
        "multipliers": multipliers_of(task, found.rows, found.root),
    }
    constant = goal.error * filled.constant
    bound = plain_bound(task, problem.upper, found.relaxed, found.root, certificate.lower_bound - constant) + constant
    judged = task.judged(found.weights)
    verdict = Verdict(
        measuring, on, proof, judged.gradient[:, :M], found.nodes, status, message, found.relaxed, bound, further,
        dict(found.extra), None if task.model is None else _along(filled.recursion, judged.terms[0].recursion),
    )  # fmt: skip
    solution = collect(problem, name, filled, verdict, plain, monitor, began)
    if plan is None:
        return solution
    numbers = dataclasses.replace(solution.numbers, switches=len(changes(rules, plan.on)))  # type: ignore[type-var]
    return dataclasses.replace(solution, numbers=numbers)


def _along(plain: Recursion, tangent: Recursion) -> Recursion:
    """The recursion with the weights of a tangent that has further columns."""
    t = tangent
    return dataclasses.replace(
        plain, terminal=t.terminal, running=t.running, running_set=t.running_set, charge=t.charge
    )


def _message(bound: float, proven: bool, found: Outcome, name: str, limit: float | None) -> str:
    kept = "keeps the rules" if limit is None else f"keeps the rules and whose peak is at most {limit:g}"
    text = f"No schedule of these readings that {kept} costs less than {rounded_down(bound, 6)}."
    if proven:
        return text + " The schedule is proven optimal among them."
    if found.plan is None:
        return text + " The weights are a mixture of such schedules."
    if name == "certify":
        return text + " Whether a better one exists is for solve to find out."
    return text + f" With {'a larger max_nodes' if found.exact else 'exact: true'} the search goes on."

"""From what a search under rules found to a Solution: numbers, certificate, independent check, arrays."""

from __future__ import annotations

import numpy as np

from occontrol.core.errors import SolveFailed
from occontrol.core.monitor import Monitor
from occontrol.core.printed import rounded_down
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Certificate, Solution, Status, make_solution
from occontrol.families.athans.certificate import Judgement, judge
from occontrol.families.athans.discretise import feasible_set, prediction_weight
from occontrol.families.athans.filter.gains import filter_gains
from occontrol.families.athans.filter.planned import planned_gains
from occontrol.families.athans.integration.integrator import Integrator
from occontrol.families.athans.integration.path import finer_steps, parts_of
from occontrol.families.athans.result import AthansResult, ContinuousNumbers, TopNumbers
from occontrol.families.athans.rules.binding import active_rules, multipliers_of
from occontrol.families.athans.rules.columns import user_weights
from occontrol.families.athans.rules.plain_bound import plain_bound, slewing_bound
from occontrol.families.athans.rules.search import Outcome
from occontrol.families.athans.rules.setting import Setting
from occontrol.scheduling.proof import MESHES, Proof
from occontrol.scheduling.rounding import singular_intervals
from occontrol.scheduling.rules.check import changes
from occontrol.scheduling.rules.proof import Claim, prove_under_rules


def assemble_ruled(setting: Setting, found: Outcome, name: str, monitor: Monitor, started: float) -> Solution:
    """Certify a schedule under rules, check it in continuous time, and collect what a run folder holds.

    Parameters
    ----------
    setting : Setting
    found : Outcome
    name : of the method
    monitor : Monitor
    started : stopwatch.seconds() at the start
    """
    problem, task, integrator = setting.problem, setting.task, setting.integrator
    rules, M = task.rules, len(setting.problem.sensors)
    on = user_weights(found.plan.on, rules) if found.plan is not None else np.asarray(found.on)
    measuring = np.ascontiguousarray(found.weights[:, :M])
    claim = Claim(found.plan, found.weights, found.switching, found.lower_bound, found.root.proof)
    proof = prove_under_rules(task, found.rows, claim)
    certificate = proof.certificate
    monitor.report(found.nodes, certificate.cost, certificate.lower_bound, stage="check")
    evaluated = integrator.evaluate(measuring)
    better = None if monitor.interrupted or found.relaxed is None else found.relaxed.weights
    judged, unfinished = None, ""
    try:
        judged = judge(problem, measuring, evaluated.cost, better, evaluated.error)
    except SolveFailed as error:
        unfinished = str(error)
    parts = parts_of(integrator, evaluated)
    path, r = parts.path, integrator.recursion
    observation = float(np.vdot(setting.task.spend, found.plan.on if found.plan is not None else on))
    error = evaluated.cost - float(np.vdot(task.price[:, :M], measuring))
    running = error - parts.prediction if r.running.shape[0] else 0.0
    status, message, proven = _status(found, certificate, judged, proof)
    top = _top(integrator, found, certificate)
    continuous = _continuous(setting, certificate, evaluated.cost, judged, unfinished)
    schedule = Schedule(problem.edges, on, tuple(problem.sensors.names))
    relaxed = found.relaxed
    shares = relaxed.weights if relaxed is not None else measuring
    rounded = feasible_set(problem).round(shares)
    singular = float(problem.steps @ singular_intervals(shares, rounded) / np.sum(problem.steps))
    count = len(changes(rules, found.plan.on)) if found.plan is not None else schedule.switches
    satisfied = {"satisfied": True, "active": active_rules(task, found.plan, error)} if problem.ruled else None
    plain = plain_bound(task, problem.upper, found.relaxed, found.root, certificate.lower_bound)
    error_of_steps = evaluated.error if judged is None else judged.discretisation_error
    if status is not Status.DISAGREES:
        message = (message or _message(top, proven, found, problem.ruled, name)) + proof.remark(found.target)
        message += f" The check in continuous time is not computed: {unfinished}" if unfinished else ""
    numbers = AthansResult(
        name=problem.name,
        top=top,
        cost=certificate.cost,
        lower_bound=certificate.lower_bound,
        relative_gap=certificate.relative_gap,
        allowance=proof.allowance,
        observation_cost=observation,
        cost_weight=problem.cost_weight,
        running_cost=running,
        prediction_error=parts.prediction,
        predicted_mean_square_error=parts.prediction + prediction_weight(problem)[1],
        continuous=continuous,
        discretisation_error=error_of_steps,
        relaxed_cost=relaxed.cost if relaxed is not None else certificate.cost,
        relaxed_lower_bound=plain,
        singular_fraction=singular,
        intervals=problem.intervals,
        integration_steps=evaluated.steps,
        integration_error=error_of_steps,
        added_edges=[{"t": t, "why": why} for t, why in problem.added_edges],
        warnings=list(problem.warnings),
        readings=None,
        switches=count,
        sweeps=dict(relaxed.sweeps) if relaxed is not None else {},
        extra=dict(found.extra),
        schedule=schedule.segments(),
        switching_cost=found.switching,
        proven_optimal=proven,
        nodes=found.nodes,
        constraints=satisfied,
        multipliers=multipliers_of(task, found.rows, found.root) if problem.ruled else None,
    )
    # filter and simulation follow what is measured; a schedule may leave intervals to a slew
    measured = Schedule(problem.edges, measuring, tuple(problem.sensors.names))
    arrays = {
        "times": problem.edges,
        "edges": problem.edges,
        "weights": on,
        "measuring": measuring,
        "covariance": path.covariance,
        "costate": path.costate,
        "switching": path.switching,
        **filter_gains(problem, measuring, path),
        **(planned_gains(problem, measured) if finer_steps(evaluated) else {}),
    }
    if relaxed is not None:
        arrays["relaxed_weights"] = relaxed.weights
    return make_solution(
        problem=problem,
        method=name,
        status=status,
        message=message,
        iterations=found.nodes,
        numbers=numbers,
        monitor=monitor,
        began=started,
        arrays=arrays,
        schedule=schedule,
        certificate=certificate,
    )


def _status(
    found: Outcome, certificate: Certificate, judged: Judgement | None, proof: Proof
) -> tuple[Status, str, bool]:
    status, proven = found.concluded(proof)
    if certificate.contradicts:
        return Status.DISAGREES, certificate.text, proven
    if judged is not None and not judged.agrees:
        return Status.DISAGREES, judged.text, proven
    if status is Status.CERTIFIED and judged is None:
        status = Status.FEASIBLE
    return status, found.message, proven


def _continuous(
    setting: Setting, certificate: Certificate, cost: float, judged: Judgement | None, unfinished: str
) -> ContinuousNumbers:
    """The schedule in continuous time, its changes included, beside the bound without rules, which holds with them."""
    if judged is None:
        return ContinuousNumbers(None, None, None, unfinished)
    goal = setting.task.goal
    value = certificate.cost + goal.error * (judged.continuous.cost - cost)
    bound = judged.lower_bound
    if goal.error == 0.0:
        # nothing but the observation cost counts: no schedule spends less than the cheapest sensors
        bound = float(np.sum(setting.task.spend * feasible_set(setting.problem).vertex(setting.task.spend)))
        bound = 0.0 if setting.problem.slews else bound
    else:
        bound = slewing_bound(bound, setting.task, setting.problem.upper)
    c = Certificate(value, bound, max(1e-9, judged.continuous.error / abs(value)) if value else 0.0)
    return ContinuousNumbers(c.cost, c.lower_bound, c.relative_gap)


def _top(integrator: Integrator, found: Outcome, certificate: Certificate) -> TopNumbers:
    """The pair for the top: where the steps are ours, the recursion's error is taken off its bound."""
    shown = certificate
    if found.steps_chosen and np.isfinite(certificate.lower_bound):
        M = integrator.recursion.sensors
        proving = [found.root.proof[0]] if found.relaxed is None else [found.root.proof[0], found.relaxed.weights]
        policies = [np.ascontiguousarray(v[:, :M]) for v in (found.weights, *proving)]
        error = max(integrator.halving_error(v) for v in policies)
        shown = Certificate(certificate.cost, certificate.lower_bound - MESHES * error)
    return TopNumbers(float(shown.cost), float(shown.lower_bound), float(shown.relative_gap), "grid")


def _message(top: TopNumbers, proven: bool, found: Outcome, ruled: bool, name: str) -> str:
    which = "that keeps the rules and changes at these edges" if ruled else "that changes at these edges"
    text = f"No schedule {which} costs less than {rounded_down(top.lower_bound, 6)}."
    if proven:
        return text + " The schedule is proven optimal among them."
    if found.plan is None:
        return text + " The weights are a mixture of such schedules."
    if name == "certify":
        return text + " Whether a better one exists is for solve to find out."
    hint = "a larger max_nodes" if found.exact else "exact: true"
    return text + f" With {hint} the search goes on." if top.relative_gap > 1e-3 or found.exact else text

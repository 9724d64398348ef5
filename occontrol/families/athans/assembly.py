"""From a policy to a Solution of the athans family: its numbers, certificate, independent check, arrays."""

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
from occontrol.families.athans.found import Found
from occontrol.families.athans.integration.integrator import Evaluation, Integrator
from occontrol.families.athans.integration.mesh import MOST_IN_INTERVAL
from occontrol.families.athans.integration.path import finer_steps, parts_of
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.families.athans.result import AthansResult, ContinuousNumbers, TopNumbers
from occontrol.families.athans.warnings import lost_modes
from occontrol.scheduling.feasible_set import FeasibleSet
from occontrol.scheduling.hminimal import polish
from occontrol.scheduling.proof import prove
from occontrol.scheduling.rounding import singular_intervals
from occontrol.scheduling.sweep import Sweep


def assemble(
    problem: SchedulingProblem,
    name: str,
    integrator: Integrator,
    sweep: Sweep,
    found: Found,
    monitor: Monitor,
    started: float,
) -> Solution:
    """Certify a policy, check it in continuous time, and collect everything that a run folder holds.

    Parameters
    ----------
    problem : SchedulingProblem
    name : of the method
    integrator : of the problem
    sweep : the recursion that the method worked on, prices corrected
    found : what the method handed over
    monitor : Monitor
    started : stopwatch.seconds() at the start
    """
    r, v, allowed = integrator.recursion, found.weights, feasible_set(problem)
    relaxed = found.relaxed
    known = max(found.bound, relaxed.lower_bound if relaxed is not None else -np.inf)
    evaluated = integrator.evaluate(v)
    policies, ideal = [evaluated.judged(r)], evaluated
    if relaxed is not None and relaxed.weights is not v:
        ideal = integrator.evaluate(relaxed.weights)
        policies.append(ideal.judged(r))
    proof = prove(policies, allowed, known)
    certificate = proof.certificate
    monitor.report(found.iterations, certificate.cost, certificate.lower_bound, stage="check")
    # whoever interrupts waits for one re-integration, not for two
    better = relaxed.weights if relaxed is not None and not monitor.interrupted else None
    judged, unfinished = None, ""
    try:
        judged = judge(problem, v, certificate.cost, better, evaluated.error)
    except SolveFailed as error:  # schedule and certificate on the grid stand all the same
        unfinished = str(error)
    parts = parts_of(integrator, evaluated)
    path = parts.path
    status, message = found.status, found.message
    trusted = found.proves and proof.resolved(found.target)
    if status is Status.CERTIFIED and not trusted and certificate.relative_gap > found.target:
        status = Status.FEASIBLE
    schedule = Schedule(problem.edges, v, tuple(problem.sensors.names))
    singular = _singular_fraction(sweep, allowed, relaxed.weights if relaxed is not None else v, v, monitor)
    observation, error = parts.observation, parts.prediction
    if certificate.contradicts:
        status, message = Status.DISAGREES, certificate.text
    elif judged is not None and not judged.agrees:
        status, message = Status.DISAGREES, judged.text
    elif not _adds_up(certificate.cost + proof.below, observation, error, r.running.shape[0] > 0):
        status, message = Status.DISAGREES, _SPOILT
    top, continuous = _tops(certificate, judged, unfinished)
    if judged is None and status is Status.CERTIFIED:
        status = Status.FEASIBLE
    remarks = "" if status is Status.DISAGREES else _remark(certificate, top, unfinished) + proof.remark(found.target)
    for lost in lost_modes(problem, counted=True):
        remarks += f" It is {lost.what}: {lost.hint}."
    if status is not Status.DISAGREES and integrator.options.substeps is None:
        exact = top.cost if top.of == "continuous" else None
        remarks += _limited(evaluated, integrator.accuracy, exact)
    error_of_steps = evaluated.error if judged is None else judged.discretisation_error
    running = certificate.cost - observation - error if r.running.shape[0] else 0.0
    numbers = AthansResult(
        name=problem.name,
        top=top,
        cost=certificate.cost,
        lower_bound=certificate.lower_bound,
        relative_gap=certificate.relative_gap,
        allowance=proof.allowance,
        observation_cost=observation / problem.cost_weight if problem.cost_weight else _raw_cost(problem, v),
        cost_weight=problem.cost_weight,
        running_cost=running,
        prediction_error=error,
        predicted_mean_square_error=error + prediction_weight(problem)[1],
        continuous=continuous,
        discretisation_error=error_of_steps,
        relaxed_cost=relaxed.cost if relaxed is not None else certificate.cost,
        relaxed_lower_bound=relaxed.lower_bound if relaxed is not None else certificate.lower_bound,
        singular_fraction=singular,
        intervals=problem.intervals,
        readings=None,
        integration_steps=evaluated.steps,
        integration_error=error_of_steps,
        added_edges=[{"t": t, "why": why} for t, why in problem.added_edges],
        warnings=list(problem.warnings),
        switches=schedule.switches,
        sweeps=dict(relaxed.sweeps) if relaxed is not None else {},
        extra=dict(found.extra),
        bounds=found.bounds,
        schedule=schedule.segments(),
    )
    arrays = {
        "times": problem.edges,
        "edges": problem.edges,
        "weights": v,
        "covariance": path.covariance,
        "costate": path.costate,
        "switching": path.switching,
        **filter_gains(problem, v, path),
        **(planned_gains(problem, schedule) if finer_steps(evaluated) else {}),
    }
    if relaxed is not None:
        arrays["relaxed_weights"] = relaxed.weights
        arrays["relaxed_switching"] = ideal.gradient / problem.steps[:, None]
    return make_solution(
        problem=problem,
        method=name,
        status=status,
        message=(message or _message(status, top, singular, schedule)) + remarks,
        iterations=found.iterations,
        numbers=numbers,
        monitor=monitor,
        began=started,
        arrays=arrays,
        schedule=schedule,
        certificate=certificate,
    )


def _singular_fraction(
    sweep: Sweep, allowed: FeasibleSet, relaxed: np.ndarray, weights: np.ndarray, monitor: Monitor
) -> float:
    """Share of the horizon on singular arcs of the relaxed optimum."""
    r = sweep.recursion
    rounded = weights
    if weights is relaxed or not np.array_equal(weights, np.round(weights)):
        rounded = polish(sweep, allowed, allowed.round(relaxed), 50, monitor.child(silent=True)).weights
    singular = singular_intervals(relaxed, rounded)
    return float(np.sum(r.steps[singular]) / np.sum(r.steps))


def _raw_cost(problem: SchedulingProblem, v: np.ndarray) -> float:
    rates = np.column_stack([s.cost.sample(problem.midpoints)[:, 0, 0] for s in problem.sensors])
    return float(np.sum(rates * problem.steps[:, None] * v))


_SPOILT = (
    "rounding has spoilt the recursion, its cost is not the sum of its parts: the covariance grows too far between "
    "measurements, use shorter intervals"
)
DIFFERENCE_TO_REMARK = 0.1  # of the cost: a difference between recursion and continuous time that is worth a remark
GAP_TO_REMARK = 0.01  # gap at the top that is worth a remark where the gap on the grid is much smaller


def _adds_up(cost: float, observation: float, error: float, running: bool) -> bool:
    """Whether the cost of the sweep is that of the path, up to a running cost, which is not negative."""
    rest = cost - observation - error
    slack = 1e-2 * (abs(cost) + abs(observation) + abs(error))
    return rest >= -slack and (running or rest <= slack)


def _tops(certificate: Certificate, judged: Judgement | None, reason: str) -> tuple[TopNumbers, ContinuousNumbers]:
    """The pair for the top, in continuous time where the check finished, and the continuous numbers."""
    if judged is None:
        on_grid = TopNumbers(certificate.cost, certificate.lower_bound, certificate.relative_gap, "grid")
        return on_grid, ContinuousNumbers(None, None, None, reason)
    c = judged.certificate
    numbers = (c.cost, c.lower_bound, c.relative_gap)
    return TopNumbers(*numbers, "continuous"), ContinuousNumbers(*numbers)


def _limited(evaluated: Evaluation, accuracy: float, exact: float | None = None) -> str:
    """A remark where the cost is less accurate than was asked for, by its own estimate or by the `exact` one."""
    size = abs(evaluated.cost)
    apart = 0.0 if exact is None else abs(evaluated.cost - exact)
    error = max(evaluated.error, apart)
    if not error > accuracy * size:
        return ""
    why = f" An interval may have {MOST_IN_INTERVAL} steps of integration, which is too few here: the cost"
    start = why if evaluated.error > accuracy * size else " The cost"
    reached = error / size if size else np.inf
    return f"{start} is accurate to {reached:.2g} of itself where {accuracy:.2g} was asked for; use more intervals."


def _remark(certificate: Certificate, top: TopNumbers, unfinished: str) -> str:
    """A remark where the grid and continuous time say different things, or one of them nothing."""
    if unfinished:
        return f" The check in continuous time is not computed: {unfinished}"
    if abs(certificate.cost - top.cost) > DIFFERENCE_TO_REMARK * abs(top.cost):
        return f" The steps are coarse: the recursion puts the cost at {certificate.cost:.6g}; use more intervals."
    if top.relative_gap > max(GAP_TO_REMARK, 2 * certificate.relative_gap):
        share = f"{100 * certificate.relative_gap:.3g} %"
        return f" With changes at these edges only the gap is {share}: more intervals would bring the two together."
    return ""


def _message(status: Status, top: TopNumbers, singular: float, schedule: Schedule) -> str:
    which = "whenever it switches" if top.of == "continuous" else "that changes at these edges"
    text = f"No schedule {which} costs less than {rounded_down(top.lower_bound, 6)}."
    if top.of == "continuous":
        text = f"No schedule costs less than {rounded_down(top.lower_bound, 6)}, {which}."
    if singular > 0 and status in (Status.CERTIFIED, Status.FEASIBLE):
        text += f" Arcs are singular on {100 * singular:.3g} % of the horizon: there"
        fast = " the optimum is approached only by fast switching."
        text += fast if schedule.is_integer else " the weights are fractions of time."
    return text if status in (Status.CERTIFIED, Status.FEASIBLE) else f"{status.text} {text}"

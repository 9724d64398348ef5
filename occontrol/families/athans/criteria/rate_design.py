"""Continuous sensing without a prior: which share of every interval, or which schedule, tells most of the parameters.

An interval is a candidate of an experiment as a reading is, with the information that it gives when it is used
throughout. Sums over intervals are exact, so cost and bound on the grid are those of continuous time; the bound for
schedules that change between the edges is lower by what the pointwise minimum of the switching functions saves.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from occontrol.core import stopwatch
from occontrol.core.errors import InfeasibleError, UsageError
from occontrol.core.kinds import PlainDict
from occontrol.core.method import Method
from occontrol.core.monitor import Monitor
from occontrol.core.printed import rounded_down
from occontrol.core.schedule import Schedule
from occontrol.core.solution import ALLOWANCE, Certificate, Solution, Status, make_solution
from occontrol.families.athans.criteria.design_arrays import equivalence_of
from occontrol.families.athans.criteria.design_search import HuntedDesign, hunt_design
from occontrol.families.athans.criteria.experiment import TOO_FEW, informed
from occontrol.families.athans.criteria.plain_rate_information import plain_rate_cost
from occontrol.families.athans.criteria.rate_arrays import rate_arrays
from occontrol.families.athans.criteria.rate_information import Watched, watched
from occontrol.families.athans.criteria.ruled_design import RuledDesign, search_design
from occontrol.families.athans.discretise import discretise, feasible_set
from occontrol.families.athans.methods import Relaxed, RelaxRoundPolish
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.families.athans.result import AthansResult, ContinuousNumbers, TopNumbers
from occontrol.families.athans.rules.certify import require_rules
from occontrol.families.athans.rules.columns import on_of
from occontrol.families.athans.rules.plain_bound import slewing_bound
from occontrol.families.athans.rules.setting import frame_of
from occontrol.scheduling.information import InformationObjective, prove_information
from occontrol.scheduling.proof import Proof

AGREE = 1e-8  # of the cost: by so much search and independent integration may differ
WEIGHTS = {"error": 0.0}  # of the observation cost, where it is not the problem's own


@dataclass(frozen=True, eq=False)
class RateExperiment:
    """A problem of continuous sensing without a prior as the search sees it.

    Parameters
    ----------
    problem : with the observation cost weighted as it counts
    watched : what its sensors tell
    objective : the true one
    note : what is to be said about it
    """

    problem: SchedulingProblem
    watched: Watched
    objective: InformationObjective
    note: str


@dataclass
class _Made:
    """A policy with what is known of it.

    Parameters
    ----------
    on, measuring : (N, M) what is in use, and what of it measures
    hunted : policy and tangents
    proof : of cost and bound on the grid
    switching : what changes cost
    further : entries of AthansResult
    ruled : whether the bound is that of rules
    saved : what slews may save at most
    proven : whether the schedule is proven optimal
    """

    on: np.ndarray
    measuring: np.ndarray
    hunted: HuntedDesign
    proof: Proof
    switching: float = 0.0
    further: PlainDict = field(default_factory=dict)
    ruled: bool = False
    saved: float = 0.0
    proven: bool | None = None


def experiment_over_time(problem: SchedulingProblem) -> RateExperiment:
    """A problem of continuous sensing without a prior made ready.

    Parameters
    ----------
    problem : without a prior

    Raises InfeasibleError, with the direction, where no schedule sees what an output needs.
    """
    problem.require_feasible()
    inner = replace(problem, cost_weight=WEIGHTS.get(problem.minimise, problem.cost_weight))
    seen = watched(inner)
    recursion = replace(discretise(inner), cost=np.ascontiguousarray(seen.prices))
    found = informed(inner, seen.seen, recursion, problem.upper, lambda direction: direction)
    return RateExperiment(inner, replace(seen, kept=found.kept), found.objective, found.note)


def solve_rate_design(problem: SchedulingProblem, method: Method, monitor: Monitor) -> Solution:
    """Run `method` on a problem of continuous sensing without a prior and certify what it found.

    Parameters
    ----------
    problem : without a prior
    method : of the family, but collocation
    monitor : Monitor

    Raises InfeasibleError where no schedule sees every direction that an output needs, UsageError for switch times off
    the grid.
    """
    if getattr(method, "off_grid", False):
        raise UsageError("off_grid needs an initial covariance, and this problem has none\n  hint: more intervals")
    began = stopwatch.seconds()
    e = experiment_over_time(problem)
    allowed = feasible_set(problem)
    if problem.ruled or getattr(method, "exact_options", None) is not None:
        made = _under_rules(problem, e, search_design(
            e.objective, frame_of(problem), problem.minimise, allowed, method, monitor))  # fmt: skip
        return _assembled(problem, method.name, e, made, monitor, began)
    hunted = hunt_design(e.objective, allowed, method, monitor)
    if not np.isfinite(e.objective.cost(hunted.found.weights)):
        if isinstance(method, Relaxed | RelaxRoundPolish):
            raise InfeasibleError(f"{TOO_FEW}\n  hint: more sensors, or an initial covariance")
        raise InfeasibleError(
            f"the schedule of {method.name} leaves a direction of the states unseen: its cost is infinite\n"
            "  hint: method: schedule"
        )
    return _assembled(problem, method.name, e, _free(e, hunted), monitor, began)


def judge_rate_design(
    problem: SchedulingProblem, weights: np.ndarray, relative_gap: float
) -> tuple[Solution, float]:
    """The solution that a given policy is, and the cost of the best schedule known beside it.

    Parameters
    ----------
    problem : without a prior
    weights : (N, M) on its edges
    relative_gap : target of the relaxation

    Raises InfeasibleError where the policy leaves a direction unseen, ProblemError for rules that it breaks.
    """
    began, monitor = stopwatch.seconds(), Monitor()
    method = Relaxed(relative_gap)
    if problem.ruled:
        require_rules(problem, weights)
    e, allowed = experiment_over_time(problem), feasible_set(problem)
    if problem.ruled:
        frame = frame_of(problem)
        on = on_of(weights, frame.rules)
        found = search_design(e.objective, frame, problem.minimise, allowed, method, monitor, on)
        made = _under_rules(problem, e, found)
        return _assembled(problem, "certify", e, made, monitor, began), found.known
    if not np.isfinite(e.objective.cost(weights)):
        raise InfeasibleError("the schedule leaves a direction of the states unseen: its cost is infinite")
    hunted = hunt_design(e.objective, allowed, method, monitor)
    known = e.objective.cost(hunted.found.weights)
    hunted.found.weights = weights
    return _assembled(problem, "certify", e, _free(e, hunted), monitor, began), known


def _free(e: RateExperiment, hunted: HuntedDesign) -> _Made:
    """A policy without rules."""
    found = hunted.found
    proof = prove_information(e.objective, feasible_set(e.problem), found.weights, hunted.tangents, found.bound)
    extra = found.extra
    further = {"nodes": extra.pop("nodes", None), "proven_optimal": extra.pop("proven_optimal", None)}
    return _Made(found.weights, found.weights, hunted, proof, further=further)


def _under_rules(problem: SchedulingProblem, e: RateExperiment, ruled: RuledDesign) -> _Made:
    """A schedule under rules, with the words of its budgets."""
    made, relaxed = ruled.handed(problem.ruled), ruled.outcome.relaxed
    tangents = [] if relaxed is None else [(e.objective, relaxed.weights)]
    saved = -slewing_bound(0.0, ruled.task, problem.upper)
    hunted = HuntedDesign(made.found, tangents)
    return _Made(
        made.on, made.measuring, hunted, ruled.proof, made.switching, made.further, True, saved, made.proven
    )


def _assembled(
    problem: SchedulingProblem, name: str, e: RateExperiment, made: _Made, monitor: Monitor, began: float
) -> Solution:
    """Check what was found in another way, bound it in continuous time, and collect what a run folder holds."""
    found, objective, proof = made.hunted.found, e.objective, made.proof
    v, relaxed, certificate = made.measuring, found.relaxed, proof.certificate
    monitor.report(found.iterations, certificate.cost, certificate.lower_bound, stage="check")
    plain = plain_rate_cost(e.problem, v)
    rates = np.column_stack([s.cost.sample(problem.midpoints)[:, 0, 0] for s in problem.sensors])
    spent = float(np.sum(rates * problem.steps[:, None] * made.on))
    if problem.cost_weight and e.problem.cost_weight:
        spent = float(np.vdot(objective.prices, made.on)) / problem.cost_weight
    unmeasured = float(np.vdot(objective.prices, made.on - v))  # while a sensor warms up
    plainly = plain.cost + made.switching + unmeasured
    free = _whenever(e, made, certificate.cost)
    status, message = found.status, found.message
    if not made.ruled and status is Status.CERTIFIED and not (found.proves and proof.resolved(found.target)):
        status = Status.CERTIFIED if certificate.relative_gap <= found.target else Status.FEASIBLE
    top = TopNumbers.stated(certificate if made.ruled else free, "grid" if made.ruled else "continuous")
    if certificate.contradicts:
        status, message = Status.DISAGREES, certificate.text
    elif not abs(plainly - certificate.cost) <= AGREE * _size(plain, certificate) + 10 * proof.allowance:
        status, message = Status.DISAGREES, (
            f"the search puts the cost at {certificate.cost:.12g}, an independent integration at {plainly:.12g}: do "
            "not trust either"
        )
    else:
        message = message or _message(top, status, made)
        message += proof.remark(found.target) + (f" {e.note}" if e.note else "")
    extra = dict(found.extra)
    if relaxed is not None:
        extra["equivalence"] = equivalence_of(objective, feasible_set(problem), relaxed.weights)
    schedule = Schedule(problem.edges, made.on, tuple(problem.sensors.names))
    numbers = AthansResult(
        name=problem.name,
        top=top,
        cost=certificate.cost,
        lower_bound=certificate.lower_bound,
        relative_gap=certificate.relative_gap,
        allowance=proof.allowance,
        observation_cost=spent,
        cost_weight=problem.cost_weight,
        running_cost=0.0,
        prediction_error=plain.prediction,
        predicted_mean_square_error=plain.prediction,
        continuous=ContinuousNumbers(free.cost, free.lower_bound, free.relative_gap),
        discretisation_error=0.0,
        relaxed_cost=relaxed.cost if relaxed is not None else certificate.cost,
        relaxed_lower_bound=relaxed.lower_bound if relaxed is not None else certificate.lower_bound,
        singular_fraction=None,
        intervals=problem.intervals,
        readings=None,
        integration_steps=None,
        integration_error=None,
        added_edges=[{"t": t, "why": why} for t, why in problem.added_edges],
        warnings=list(problem.warnings),
        sweeps=dict(relaxed.sweeps) if relaxed is not None else {},
        extra=extra,
        schedule=schedule.segments(),
        criterion=None if problem.criterion is None else plain.criterion,
        **{"switches": schedule.switches, **made.further},
    )
    return make_solution(
        problem=problem, method=name, status=status, message=message, iterations=found.iterations, numbers=numbers,
        monitor=monitor, began=began, arrays=rate_arrays(problem, e.watched, objective, made.on, v, relaxed),
        schedule=schedule, certificate=certificate,
    )  # fmt: skip


def _size(plain, certificate: Certificate) -> float:
    return max(certificate.size, abs(plain.observation) + abs(plain.criterion))


def _whenever(e: RateExperiment, made: _Made, cost: float) -> Certificate:
    """Cost and bound for schedules that change whenever they like, without rules."""
    objective, problem, found = e.objective, e.problem, made.hunted.found
    allowed = feasible_set(problem)
    bounds = [] if objective.signed else [0.0]
    bounding = getattr(found.relaxed, "bounding", None)
    others = list(made.hunted.tangents)
    if bounding is not None:
        others.append((objective.with_smoothing(bounding[1]), bounding[0]))
    for at, v in [(objective, made.measuring), *others]:
        each = at.tangent(v).certified(allowed)
        if np.isfinite(each.lower_bound):
            saved = e.watched.saved_between_edges(at, v, problem.upper, problem.select)
            bounds.append(each.lower_bound - each.bound_allowance - saved - made.saved)
    signed = objective.signed
    share = max(ALLOWANCE, made.proof.allowance / (1.0 if signed else max(abs(cost), 1e-300)))
    return Certificate(cost, max(bounds), share, signed)


def _message(top: TopNumbers, status: Status, made: _Made) -> str:
    kept = " that keeps the rules" if made.ruled and "constraints" in made.further else ""
    which = ", whenever it switches" if top.of == "continuous" else " with changes at these edges"
    text = f"No schedule{kept} costs less than {rounded_down(top.lower_bound, 6)}{which}."
    if made.proven:
        text += " The schedule is proven optimal among them."
    return text if status in (Status.CERTIFIED, Status.FEASIBLE) else f"{status.text} {text}"

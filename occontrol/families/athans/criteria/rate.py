"""Problems of continuous sensing with another criterion than the trace: solved, judged, checked in continuous time.

On the grid cost and bound are those of one convex recursion, with the fewest equal steps that reach the accuracy, as
for rules. In continuous time the policy is integrated again, and its covariance gives the weight of a problem of traces

    J(w) >= phi(X(v)) - tr(Z X(v)) + [cost of w, with tr(Z X(w)) in the place of the criterion],   Z = dphi/dX at v,

whose bound holds whenever a schedule switches. A peak counts at the edges; its bound is that of the grid.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from occontrol.core import stopwatch
from occontrol.core.errors import InfeasibleError, SolveFailed, UsageError
from occontrol.core.method import Method
from occontrol.core.monitor import Monitor
from occontrol.core.printed import rounded_down
from occontrol.core.schedule import Schedule
from occontrol.core.signal import ConstantSignal
from occontrol.core.solution import ALLOWANCE, Certificate, Solution, Status
from occontrol.families.athans.assembly import assemble
from occontrol.families.athans.balanced import balanced, restored
from occontrol.families.athans.continuous.reintegration import reintegrate
from occontrol.families.athans.criteria.limit import KEEPS, hunt_below
from occontrol.families.athans.criteria.rate_objective import Measured, measured_of, objective_on
from occontrol.families.athans.criteria.search import Hunted, hunt
from occontrol.families.athans.criteria.statement import CriterionChoice
from occontrol.families.athans.discretise import feasible_set
from occontrol.families.athans.found import Found
from occontrol.families.athans.integration.integrator import Integrator
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.families.athans.result import ContinuousNumbers, TopNumbers
from occontrol.families.athans.rules.setting import prepared
from occontrol.numerics.linalg import square_root
from occontrol.scheduling.criterion import Criterion
from occontrol.scheduling.criterion_sweep import CriterionSweep
from occontrol.scheduling.peak import PeakSweep
from occontrol.scheduling.proof import Proof, prove
from occontrol.scheduling.sweep import Sweep

SAFETY, RELATIVE = 5.0, 1e-6  # as in certificate.py
GRID_ONLY = "the bound of a peak is that of the edges"


def solve_rate(problem: SchedulingProblem, method: Method, monitor: Monitor) -> Solution:
    """Run `method` on a problem of continuous sensing with a criterion and certify what it found.

    Parameters
    ----------
    problem : with a criterion that is not the trace, without rules
    method : of the family
    monitor : Monitor

    Raises UsageError for a method that does not do criteria, InfeasibleError where a limit cannot be kept.
    """
    if method.name == "collocation":
        raise UsageError("collocation does not do criteria other than the trace\n  hint: method: schedule, or relaxed")
    problem.require_feasible()
    began = stopwatch.seconds()
    inner, units = balanced(prepared(problem, getattr(method, "relative_gap", 1e-4)))
    measured = measured_of(inner)
    hunted = _hunted(measured, method, monitor)
    if hunted.found.status is Status.INFEASIBLE:
        raise InfeasibleError(hunted.found.message)
    return restored(_assembled(measured, method.name, hunted, monitor, began), problem, units)


def judge_rate(problem: SchedulingProblem, weights: np.ndarray, method: Method) -> tuple[Solution, float]:
    """The solution that a given policy is, and the cost of the best one known beside it.

    Parameters
    ----------
    problem : with a criterion
    weights : (N, M) on its edges
    method : whose relaxation proves the bound

    Raises InfeasibleError where a limit cannot be kept, UsageError where this policy does not keep it.
    """
    began, monitor = stopwatch.seconds(), Monitor()
    inner, units = balanced(prepared(problem, getattr(method, "relative_gap", 1e-4)))
    measured = measured_of(inner)
    limit = _limit(problem)
    if limit is not None:
        measured.objective.cost(weights)
        if measured.objective.criterion_value > limit * (1 + KEEPS):
            peak = measured.objective.criterion_value
            raise UsageError(f"the peak of the schedule is {peak:.8g}, the limit is {limit:g}")
    hunted = _hunted(measured, method, monitor)
    known = measured.objective.cost(hunted.found.weights)
    known -= 0.0 if limit is None else measured.objective.criterion_value
    hunted.found.weights = weights
    return restored(_assembled(measured, "certify", hunted, monitor, began), problem, units), known


def _limit(problem: SchedulingProblem) -> float | None:
    return None if problem.criterion is None else problem.criterion.limit


def _hunted(measured: Measured, method: Method, monitor: Monitor) -> Hunted:
    limit, allowed = _limit(measured.problem), feasible_set(measured.problem)
    if limit is not None and isinstance(measured.objective, PeakSweep):
        return hunt_below(measured.objective, limit, allowed, method, monitor)
    return hunt(measured.objective, allowed, method, monitor)


def _assembled(measured: Measured, name: str, hunted: Hunted, monitor: Monitor, began: float) -> Solution:
    """Numbers and arrays along the tangent, a problem of traces; cost and bounds of the criterion."""
    problem, objective, found = measured.problem, measured.objective, hunted.found
    limit, allowed, relaxed = _limit(problem), feasible_set(problem), found.relaxed
    own = objective.with_limit(limit, 0.0) if limit is not None and isinstance(objective, PeakSweep) else objective
    judged = own.tangent(found.weights)
    criterion = own.criterion_value
    known = max(found.bound, relaxed.lower_bound if relaxed is not None else -np.inf)
    proof = prove([judged, *hunted.tangents], allowed, known, objective.signed)
    error = _halving_error(measured, found.weights, judged.cost)
    continuous, agrees, apart = _continuous(measured, hunted, proof, error, criterion)
    plain = Found(found.weights, found.iterations, Status.FEASIBLE, "", None, target=np.inf)
    trace = replace(problem, criterion=None)
    for what in ("added_edges", "warnings"):
        object.__setattr__(trace, what, getattr(problem, what))
    integrator = Integrator(trace)
    lines = assemble(trace, name, integrator, Sweep(integrator.recursion), plain, monitor, began)
    certificate, status, message = proof.certificate, found.status, found.message
    if status is Status.CERTIFIED and not (found.proves and proof.resolved(found.target)):
        status = Status.CERTIFIED if certificate.relative_gap <= found.target else Status.FEASIBLE
    if certificate.contradicts:
        status, message = Status.DISAGREES, certificate.text
    elif not agrees:
        status, message = Status.DISAGREES, apart
    pair = continuous if continuous.absolute_gap is not None else None
    top = TopNumbers.stated(certificate, "grid")
    if pair is not None and pair.certificate is not None:
        top = TopNumbers.stated(pair.certificate, "continuous")
    if status is not Status.DISAGREES:
        message = message or _message(top, limit, status)
        message += proof.remark(found.target) + (f" The {measured.note}" if measured.note else "")
    extra = dict(found.extra)
    numbers = replace(
        lines.numbers,  # type: ignore[type-var]
        top=top,
        cost=certificate.cost,
        lower_bound=certificate.lower_bound,
        relative_gap=certificate.relative_gap,
        allowance=proof.allowance,
        running_cost=max(lines.numbers.running_cost, 0.0),
        continuous=continuous.numbers,
        discretisation_error=error,
        integration_error=error,
        relaxed_cost=relaxed.cost if relaxed is not None else certificate.cost,
        relaxed_lower_bound=relaxed.lower_bound if relaxed is not None else certificate.lower_bound,
        sweeps=dict(relaxed.sweeps) if relaxed is not None else {},
        nodes=extra.pop("nodes", None),
        proven_optimal=extra.pop("proven_optimal", None),
        extra=extra,
        criterion=criterion,
    )
    arrays = {**lines.arrays, "switching": judged.gradient / problem.steps[:, None]}
    if relaxed is not None:
        arrays["relaxed_weights"] = relaxed.weights
    return replace(
        lines, status=status, message=message, numbers=numbers, arrays=arrays, certificate=certificate, problem=problem,
        iterations=found.iterations, history=tuple(monitor.history),
    )  # fmt: skip


def _message(top: TopNumbers, limit: float | None, status: Status) -> str:
    kept = "" if limit is None else f" whose peak is at most {limit:g}"
    which = ", whenever it switches" if top.of == "continuous" else " with changes at these edges"
    text = f"No schedule{kept} costs less than {rounded_down(top.lower_bound, 6)}{which}."
    return text if status in (Status.CERTIFIED, Status.FEASIBLE) else f"{status.text} {text}"


@dataclass(frozen=True)
class _Continuous:
    numbers: ContinuousNumbers
    certificate: Certificate | None = None

    @property
    def absolute_gap(self) -> float | None:
        return None if self.certificate is None else self.certificate.gap


def _halving_error(measured: Measured, weights: np.ndarray, cost: float) -> float:
    """Estimated error of J by halving every step once; a peak's variances are watched on the finer steps, too."""
    problem = measured.problem
    parts = problem.integration.substeps or 1
    finer = tuple(2 * p for p in parts) if isinstance(parts, tuple) else 2 * parts
    again = replace(problem, integration=replace(problem.integration, substeps=finer))
    integrator = Integrator(again)
    objective, _ = objective_on(again, integrator.fixed.shared, measured.output, integrator)
    value = objective.cost(weights)
    if problem.criterion is not None and problem.criterion.limit is not None:
        value -= objective.criterion_value
    return 4 / 3 * abs(value - cost)


def _continuous(
    measured: Measured, hunted: Hunted, proof: Proof, error: float, criterion: float
) -> tuple[_Continuous, bool, str]:
    """The policy in continuous time, whether it agrees with the recursion, and the words if not."""
    problem, signed = measured.problem, measured.objective.signed
    found, names = hunted.found, tuple(measured.problem.sensors.names)
    cost = proof.certificate.cost
    try:
        if isinstance(measured.objective, PeakSweep):
            check = reintegrate(replace(problem, criterion=None), Schedule(problem.edges, found.weights, names))
            choice = problem.criterion or CriterionChoice()
            since = -np.inf if choice.since is None else choice.since - 1e-9 * float(np.ptp(problem.edges))
            at = np.flatnonzero(problem.edges >= since)
            D = problem.output.sample(problem.edges[at])
            S = check.covariance_at_edges[at]
            peak = float(np.max(np.einsum("kpi,kij,kpj->k", D, S, D)))
            value = problem.cost_weight * check.observation_cost + check.running_cost
            value += 0.0 if choice.limit is not None else peak
            within = SAFETY * error + RELATIVE * max(abs(cost), abs(criterion)) + check.error
            return _Continuous(ContinuousNumbers(value, None, None, GRID_ONLY)), *_agree(value, cost, within)
        sweep = measured.objective
        assert isinstance(sweep, CriterionSweep)
        value, bound, allowed = _integrated(problem, measured.output, sweep.criterion, found.weights)
        for smoothed, weights in _others(sweep, hunted):
            bound = max(bound, _integrated(problem, measured.output, smoothed, weights)[1])
    except SolveFailed as failure:
        return _Continuous(ContinuousNumbers(None, None, None, str(failure))), True, ""
    if not signed and value >= 0:
        bound = max(bound, 0.0)
    size = 1.0 if signed else abs(value)
    certificate = Certificate(value, bound, max(ALLOWANCE, allowed / size) if size else 0.0, signed)
    numbers = ContinuousNumbers(certificate.cost, certificate.lower_bound, certificate.relative_gap)
    within = SAFETY * error + RELATIVE * max(abs(cost), 1.0 if signed else 0.0) + allowed
    agrees, words = _agree(value, cost, within)
    return _Continuous(numbers, certificate), agrees and not certificate.contradicts, words or certificate.text


def _agree(value: float, cost: float, within: float) -> tuple[bool, str]:
    good = abs(value - cost) <= within
    words = "" if good else (
        f"the recursion puts the cost at {cost:.10g}, the independent integration at {value:.10g}, more than "
        f"{SAFETY:g} discretisation errors apart"
    )  # fmt: skip
    return good, words


def _others(sweep: CriterionSweep, hunted: Hunted) -> list[tuple[Criterion, np.ndarray]]:
    """Policies of the relaxation, and the criterion smoothed as where they prove most."""
    found = hunted.found
    if found.relaxed is None or found.relaxed.weights is found.weights:
        return []
    bounding = getattr(found.relaxed, "bounding", None)
    if bounding is None:
        return [(sweep.criterion, found.relaxed.weights)]
    return [(sweep.with_smoothing(bounding[1]).criterion, bounding[0])]


def _integrated(
    problem: SchedulingProblem, output: np.ndarray, criterion: Criterion, weights: np.ndarray
) -> tuple[float, float, float]:
    """Cost, bound and numerical error in continuous time of a policy (N, M)."""
    schedule = Schedule(problem.edges, weights, tuple(problem.sensors.names))
    end = float(problem.edges[-1])
    first = reintegrate(replace(problem, criterion=None, output=ConstantSignal(output), predict_at=end), schedule)
    S = first.covariance_at_edges[-1]
    W = criterion.gradient(S)
    offset = criterion.value(S) - criterion.smoothing_error(S) - float(np.vdot(W, S))
    root = np.swapaxes(square_root((W + W.T) / 2), -1, -2)
    again = reintegrate(replace(problem, criterion=None, output=ConstantSignal(root), predict_at=end), schedule)
    error = again.error + criterion.rounding(S)
    return again.cost + offset, again.lower_bound + offset - criterion.rounding(S), error



"""From a policy of continuous sensing with a criterion to a Solution, checked in continuous time.

Cost and bound are those of the grid. In continuous time the policy is integrated again, and its covariance gives the
weight of a problem of traces

    J(w) >= phi(X(v)) - tr(Z X(v)) + [cost of w, with tr(Z X(w)) in the place of the criterion],   Z = dphi/dX at v,

whose bound holds whenever a schedule switches. A peak counts at the edges; its bound is that of the grid.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from occontrol.core.errors import SolveFailed
from occontrol.core.kinds import PlainDict
from occontrol.core.monitor import Monitor
from occontrol.core.printed import rounded_down
from occontrol.core.schedule import Schedule
from occontrol.core.signal import ConstantSignal
from occontrol.core.solution import ALLOWANCE, Certificate, Solution, Status
from occontrol.families.athans.assembly import assemble
from occontrol.families.athans.continuous.reintegration import reintegrate
from occontrol.families.athans.criteria.rate_objective import Measured, objective_on
from occontrol.families.athans.criteria.search import Hunted
from occontrol.families.athans.criteria.statement import CriterionChoice
from occontrol.families.athans.discretise import feasible_set
from occontrol.families.athans.found import Found
from occontrol.families.athans.integration.integrator import Integrator
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.families.athans.result import ContinuousNumbers, TopNumbers
from occontrol.numerics.linalg import square_root
from occontrol.scheduling.criterion import Criterion
from occontrol.scheduling.criterion_sweep import CriterionSweep
from occontrol.scheduling.peak import PeakSweep
from occontrol.scheduling.proof import MESHES, Proof, prove
from occontrol.scheduling.sweep import Sweep

SAFETY, RELATIVE = 5.0, 1e-6  # as in certificate.py
GRID_ONLY = "the bound of a peak is that of the edges"


@dataclass(frozen=True, eq=False)
class UnderRules:
    """What rules add to a policy.

    Parameters
    ----------
    on : (N, M) what is in use and paid for
    proof : of F, with the rules
    saved : what slews may save at most: by so much a bound without rules is lowered
    steps_chosen : whether the steps of integration are ours
    further : entries of AthansResult
    """

    on: np.ndarray
    proof: Proof
    saved: float
    steps_chosen: bool
    further: PlainDict = field(default_factory=dict)


def assembled(
    measured: Measured, name: str, hunted: Hunted, monitor: Monitor, began: float, rules: UnderRules | None = None
) -> Solution:
    """Numbers and arrays along the tangent, a problem of traces; cost and bounds of the criterion.

    Parameters
    ----------
    measured : the problem
    name : of the method
    hunted : what it found
    monitor : Monitor
    began : stopwatch.seconds() at the start
    rules : what rules add, or None
    """
    problem, objective, found = measured.problem, measured.objective, hunted.found
    limit, allowed, relaxed = measured.limit, feasible_set(problem), found.relaxed
    own = objective.with_limit(limit, 0.0) if limit is not None and isinstance(objective, PeakSweep) else objective
    judged = own.tangent(found.weights)
    criterion = own.criterion_value
    known = max(found.bound, relaxed.lower_bound if relaxed is not None else -np.inf)
    proof = prove([judged, *hunted.tangents], allowed, known, objective.signed) if rules is None else rules.proof
    error = _halving_error(measured, found.weights, judged.cost)
    continuous, agrees, apart = _continuous(measured, hunted, judged.cost, error, criterion)
    if rules is not None:
        continuous = continuous.moved(proof.certificate.cost - judged.cost, rules.saved, objective.signed)
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
    if rules is not None and rules.steps_chosen:
        lowered = certificate.lower_bound - MESHES * error
        top = TopNumbers.stated(Certificate(certificate.cost, lowered, ALLOWANCE, objective.signed), "grid")
    elif rules is None and pair is not None and pair.certificate is not None:
        top = TopNumbers.stated(pair.certificate, "continuous")
    if status is not Status.DISAGREES:
        message = message or _message(top, limit, status, rules is not None)
        message += proof.remark(found.target) + (f" The {measured.note}" if measured.note else "")
    extra = dict(found.extra)
    further: PlainDict = {"nodes": extra.pop("nodes", None), "proven_optimal": extra.pop("proven_optimal", None)}
    further["relaxed_lower_bound"] = relaxed.lower_bound if relaxed is not None else certificate.lower_bound
    schedule = lines.schedule
    if rules is not None:
        schedule = Schedule(problem.edges, rules.on, tuple(problem.sensors.names))
        further |= {"schedule": schedule.segments(), **rules.further}
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
        sweeps=dict(relaxed.sweeps) if relaxed is not None else {},
        extra=extra,
        criterion=criterion,
        **further,
    )
    arrays = {**lines.arrays, "switching": judged.gradient / problem.steps[:, None]}
    if relaxed is not None:
        arrays["relaxed_weights"] = relaxed.weights
    if rules is not None:
        arrays |= {"weights": rules.on, "measuring": found.weights}
    return replace(
        lines, status=status, message=message, numbers=numbers, arrays=arrays, certificate=certificate, problem=problem,
        iterations=found.iterations, history=tuple(monitor.history), schedule=schedule,
    )  # fmt: skip


def _message(top: TopNumbers, limit: float | None, status: Status, rules: bool) -> str:
    kept = "" if limit is None else f" whose peak is at most {limit:g}"
    if rules:
        kept = " that keeps the rules" + ("" if limit is None else f" and{kept}")
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

    def moved(self, more: float, saved: float, signed: bool) -> _Continuous:
        """The same of a schedule that costs `more` by its changes, beside a bound lowered by `saved`."""
        c = self.certificate
        if c is None:
            cost = self.numbers.cost
            return self if cost is None else _Continuous(replace(self.numbers, cost=cost + more))
        c = Certificate(c.cost + more, c.lower_bound - saved, c.allowance, signed)
        return _Continuous(ContinuousNumbers(c.cost, c.lower_bound, c.relative_gap), c)


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
    measured: Measured, hunted: Hunted, cost: float, error: float, criterion: float
) -> tuple[_Continuous, bool, str]:
    """The policy in continuous time, whether it agrees with the recursion, and the words if not."""
    problem, signed = measured.problem, measured.objective.signed
    found, names = hunted.found, tuple(measured.problem.sensors.names)
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



"""Problems of readings with another criterion than the trace: solved, judged, put together."""

from __future__ import annotations

import numpy as np

from occontrol.core import stopwatch
from occontrol.core.errors import InfeasibleError
from occontrol.core.method import Method
from occontrol.core.monitor import Monitor
from occontrol.core.printed import rounded_down
from occontrol.core.solution import Solution, Status
from occontrol.families.athans.criteria.limit import hunt_below
from occontrol.families.athans.criteria.objective import objective_of, require_below
from occontrol.families.athans.criteria.search import Hunted, hunt
from occontrol.families.athans.methods import Relaxed
from occontrol.families.athans.readings.assembly import Verdict, checked, collect, raised, remark_on
from occontrol.families.athans.readings.fill import Filled, feasible_set, fill
from occontrol.families.athans.readings.plain import plain_cost
from occontrol.families.athans.readings.problem import ReadingsProblem
from occontrol.scheduling.criterion_sweep import CriterionObjective
from occontrol.scheduling.peak import PeakSweep
from occontrol.scheduling.proof import prove


def solve_measured(problem: ReadingsProblem, method: Method, monitor: Monitor) -> Solution:
    """Run `method` on a problem of readings with a criterion and certify what it found.

    Parameters
    ----------
    problem : with a criterion that is not the trace, without rules
    method : of the family
    monitor : Monitor

    Raises UsageError for a method that does not do criteria, InfeasibleError where a limit cannot be kept.
    """
    problem.require_feasible()
    began = stopwatch.seconds()
    filled = fill(problem)
    objective, note = objective_of(problem, filled)
    hunted = _hunted(problem, objective, method, monitor)
    if hunted.found.status is Status.INFEASIBLE:
        raise InfeasibleError(hunted.found.message)
    return _assembled(problem, method.name, filled, objective, hunted, note, monitor, began)


def judge_measured(problem: ReadingsProblem, weights: np.ndarray, relative_gap: float) -> tuple[Solution, float]:
    """The solution that a given policy is, and the cost of the best schedule known beside it.

    Parameters
    ----------
    problem : with a criterion
    weights : (E, M) of every decision
    relative_gap : target of the relaxation

    Raises ProblemError where the policy does not keep the limit of a peak.
    """
    began, monitor = stopwatch.seconds(), Monitor()
    filled = fill(problem)
    objective, note = objective_of(problem, filled)
    limit = _limit(problem)
    if limit is not None:
        require_below(problem, filled, weights)
    whole = bool(np.all(np.abs(weights - np.round(weights)) < 1e-9))
    method = problem.method if hasattr(problem.method, "exact_options") else None
    hunted = _hunted(problem, objective, method if whole and method else _usual(whole, relative_gap), monitor)
    known = _cost(objective, limit, hunted.found.weights) + filled.constant
    hunted.found.weights = weights
    return _assembled(problem, "certify", filled, objective, hunted, note, monitor, began), known


def _usual(whole: bool, relative_gap: float) -> Method:
    from occontrol.families.athans.methods import RelaxRoundPolish

    return RelaxRoundPolish(relative_gap) if whole else Relaxed(relative_gap)


def _limit(problem: ReadingsProblem) -> float | None:
    return None if problem.criterion is None else problem.criterion.limit


def _hunted(problem: ReadingsProblem, objective: CriterionObjective, method: Method, monitor: Monitor) -> Hunted:
    limit = _limit(problem)
    if limit is not None and isinstance(objective, PeakSweep):
        return hunt_below(objective, limit, feasible_set(problem), method, monitor)
    return hunt(objective, feasible_set(problem), method, monitor)


def _cost(objective: CriterionObjective, limit: float | None, weights: np.ndarray) -> float:
    cost = objective.cost(weights)
    return cost if limit is None else cost - objective.criterion_value


def _assembled(
    problem: ReadingsProblem,
    name: str,
    filled: Filled,
    objective: CriterionObjective,
    hunted: Hunted,
    note: str,
    monitor: Monitor,
    began: float,
) -> Solution:
    """Certify what was found, and check it with the plain filter."""
    found, limit = hunted.found, _limit(problem)
    v, relaxed, constant = found.weights, found.relaxed, filled.constant
    own = objective if limit is None else objective.with_limit(limit, 0.0)  # type: ignore[attr-defined]
    judged = own.tangent(v)
    known = max(found.bound, relaxed.lower_bound if relaxed is not None else -np.inf)
    proof = raised(prove([judged, *hunted.tangents], feasible_set(problem), known, objective.signed), constant)
    certificate = proof.certificate
    monitor.report(found.iterations, certificate.cost, certificate.lower_bound, stage="check")
    plain = plain_cost(problem, filled.recursion.on_steps(v))
    status = found.status
    if status is Status.CERTIFIED and not (found.proves and proof.resolved(found.target)):
        status = Status.CERTIFIED if certificate.relative_gap <= found.target else Status.FEASIBLE
    status, message = checked(proof, plain, plain.cost, status, found.message)
    if status is not Status.DISAGREES:
        kept = "" if limit is None else f" whose peak is at most {limit:g}"
        text = f"No schedule of these readings{kept} costs less than {rounded_down(certificate.lower_bound, 6)}."
        usual = status in (Status.CERTIFIED, Status.FEASIBLE)
        message = message or (text if usual else f"{status.text} {text}")
        message += remark_on(found, certificate) + proof.remark(found.target) + (f" The {note}" if note else "")
    extra = dict(found.extra)
    further = {"nodes": extra.pop("nodes", None), "proven_optimal": extra.pop("proven_optimal", None)}
    bound = relaxed.lower_bound + constant if relaxed is not None else certificate.lower_bound
    verdict = Verdict(
        v, v, proof, judged.gradient, found.iterations, status, message, relaxed, bound, further, extra,
        judged.terms[0].recursion,
    )  # fmt: skip
    return collect(problem, name, filled, verdict, plain, monitor, began)



"""Problems of readings without a prior: experiments for constant parameters, solved, judged, put together."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from occontrol.core import stopwatch
from occontrol.core.errors import InfeasibleError
from occontrol.core.method import Method
from occontrol.core.monitor import Monitor
from occontrol.core.printed import rounded_down
from occontrol.core.solution import Solution, Status
from occontrol.families.athans.criteria.design_arrays import arrays_of, equivalence_of
from occontrol.families.athans.criteria.design_search import HuntedDesign, hunt_design
from occontrol.families.athans.criteria.experiment import TOO_FEW, informed
from occontrol.families.athans.criteria.plain_information import plain_information_cost
from occontrol.families.athans.criteria.ruled_design import Handed, RuledDesign, search_design
from occontrol.families.athans.methods import Relaxed, RelaxRoundPolish
from occontrol.families.athans.readings.assembly import Verdict, checked, collect_numbers, remark_on
from occontrol.families.athans.readings.fill import Filled, feasible_set, fill, terminal_output
from occontrol.families.athans.readings.problem import ReadingsProblem
from occontrol.families.athans.readings.rules import frame_of, require_kept
from occontrol.families.athans.rules.certify import require_whole
from occontrol.families.athans.rules.columns import on_of
from occontrol.scheduling.information import InformationObjective, prove_information
from occontrol.scheduling.proof import Proof
from occontrol.scheduling.seen import seen_from_start

WEIGHTS = {"error": 0.0}  # of the observation cost, where it is not the problem's own


@dataclass(frozen=True, eq=False)
class Experiment:
    """A problem without a prior as the search sees it.

    Parameters
    ----------
    problem : with the observation cost weighted as it counts
    filled : as a recursion, in balanced units
    objective : the true one
    note : what is to be said about it
    """

    problem: ReadingsProblem
    filled: Filled
    objective: InformationObjective
    note: str


def experiment_of(problem: ReadingsProblem) -> Experiment:
    """A problem without a prior made ready.

    Parameters
    ----------
    problem : without a prior

    Raises InfeasibleError, with the direction, where no schedule sees what an output needs.
    """
    problem.require_feasible()
    inner = replace(problem, cost_weight=WEIGHTS.get(problem.minimise, problem.cost_weight))
    filled = fill(inner)
    r = filled.recursion
    seen = seen_from_start(r, filled.units.out_of(terminal_output(problem)[0]))
    found = informed(problem, seen, r, problem.upper, filled.units.inverse.vector)
    return Experiment(inner, filled, found.objective, found.note)


def solve_design(problem: ReadingsProblem, method: Method, monitor: Monitor) -> Solution:
    """Run `method` on a problem without a prior and certify what it found.

    Parameters
    ----------
    problem : without a prior
    method : of the family, but collocation
    monitor : Monitor

    Raises InfeasibleError where no schedule sees every direction that an output needs.
    """
    began = stopwatch.seconds()
    experiment = experiment_of(problem)
    if problem.ruled:
        return _ruled(problem, method.name, experiment, _searched(problem, experiment, method, monitor), monitor, began)
    hunted = hunt_design(experiment.objective, feasible_set(problem), method, monitor)
    if not np.isfinite(experiment.objective.cost(hunted.found.weights)):
        if isinstance(method, Relaxed | RelaxRoundPolish):
            raise InfeasibleError(f"{TOO_FEW}\n  hint: more readings, or an initial covariance")
        raise InfeasibleError(
            f"the schedule of {method.name} leaves a direction of the states unseen: its cost is infinite\n"
            "  hint: method: schedule"
        )
    return _assembled(problem, method.name, experiment, hunted, monitor, began)


def judge_design(problem: ReadingsProblem, weights: np.ndarray, relative_gap: float) -> tuple[Solution, float]:
    """The solution that a given policy is, and the cost of the best schedule known beside it.

    Parameters
    ----------
    problem : without a prior
    weights : (E, M) of every decision
    relative_gap : target of the relaxation

    Raises InfeasibleError where the policy leaves a direction unseen, ProblemError for rules that it breaks.
    """
    began, monitor = stopwatch.seconds(), Monitor()
    if problem.ruled:
        require_kept(problem, weights)
    experiment = experiment_of(problem)
    if problem.ruled:
        searched = _searched(problem, experiment, Relaxed(relative_gap), monitor, require_whole(weights))
        return _ruled(problem, "certify", experiment, searched, monitor, began), searched.known
    if not np.isfinite(experiment.objective.cost(weights)):
        raise InfeasibleError("the schedule leaves a direction of the states unseen: its cost is infinite")
    whole = bool(np.all(np.abs(weights - np.round(weights)) < 1e-9))
    method: Method = RelaxRoundPolish(relative_gap) if whole else Relaxed(relative_gap)
    hunted = hunt_design(experiment.objective, feasible_set(problem), method, monitor)
    known = experiment.objective.cost(hunted.found.weights)
    hunted.found.weights = weights
    return _assembled(problem, "certify", experiment, hunted, monitor, began), known


def _searched(
    problem: ReadingsProblem, e: Experiment, method: Method, monitor: Monitor, given: np.ndarray | None = None
) -> RuledDesign:
    frame = frame_of(problem)
    on = None if given is None else on_of(given, frame.rules)
    return search_design(e.objective, frame, problem.minimise, feasible_set(problem), method, monitor, on)


def _ruled(
    problem: ReadingsProblem, name: str, e: Experiment, ruled: RuledDesign, monitor: Monitor, began: float
) -> Solution:
    """What the search under rules found, with its proof and its words."""
    made = ruled.handed(True)
    if not made.found.message:
        bound = rounded_down(ruled.proof.certificate.lower_bound, 6)
        made.found.message = f"No schedule of these readings that keeps the rules costs less than {bound}."
        made.found.message += " The schedule is proven optimal among them." if made.proven else ""
    return _collected(problem, name, e, made, ruled.proof, monitor, began)


def _assembled(
    problem: ReadingsProblem, name: str, e: Experiment, hunted: HuntedDesign, monitor: Monitor, began: float
) -> Solution:
    """Certify what was found without rules, in words."""
    found = hunted.found
    proof = prove_information(e.objective, feasible_set(problem), found.weights, hunted.tangents, found.bound)
    certificate, status = proof.certificate, found.status
    if status is Status.CERTIFIED and not (found.proves and proof.resolved(found.target)):
        status = Status.CERTIFIED if certificate.relative_gap <= found.target else Status.FEASIBLE
    if not found.message:
        text = f"No schedule of these readings costs less than {rounded_down(certificate.lower_bound, 6)}."
        usual = status in (Status.CERTIFIED, Status.FEASIBLE)
        found.message = text if usual else f"{status.text} {text}"
    found.status, found.message = status, found.message + remark_on(found, certificate)
    extra = found.extra
    further = {"nodes": extra.pop("nodes", None), "proven_optimal": extra.pop("proven_optimal", None)}
    made = Handed(found, found.weights, found.weights, 0.0, further, False)
    return _collected(problem, name, e, made, proof, monitor, began)


def _collected(
    problem: ReadingsProblem, name: str, e: Experiment, made: Handed, proof: Proof, monitor: Monitor, began: float
) -> Solution:
    """Check a policy by another route, and put everything together that a run folder holds."""
    found, filled, objective, v = made.found, e.filled, e.objective, made.measuring
    relaxed, allowed, certificate = found.relaxed, feasible_set(problem), proof.certificate
    monitor.report(found.iterations, certificate.cost, certificate.lower_bound, stage="check")
    plain = plain_information_cost(e.problem, filled.recursion.on_steps(v))
    beside = float(np.vdot(objective.prices, made.on - v)) + made.switching  # warming up, and changes
    status, message = checked(proof, plain, plain.cost + beside, found.status, found.message)
    if status is not Status.DISAGREES:
        message += proof.remark(found.target) + (f" {e.note}" if e.note else "")
    extra, further = dict(found.extra), dict(made.further)
    switches = further.pop("switches", None)
    if relaxed is not None:
        extra["equivalence"] = equivalence_of(objective, allowed, relaxed.weights)
    bound = relaxed.lower_bound if relaxed is not None else certificate.lower_bound
    _, gradient = objective.cost_and_gradient(v)
    verdict = Verdict(v, made.on, proof, gradient, found.iterations, status, message, relaxed, bound, further, extra)
    arrays = arrays_of(problem, filled, v, gradient)
    if made.on is not v:
        arrays |= {"weights": filled.recursion.on_steps(made.on), "measuring": filled.recursion.on_steps(v)}
    if relaxed is not None:
        arrays["relaxed_weights"] = filled.recursion.on_steps(relaxed.weights)
        _, slope = objective.cost_and_gradient(relaxed.weights)
        arrays["relaxed_switching"] = filled.recursion.on_steps(slope)
    solution = collect_numbers(problem, name, filled, verdict, plain, arrays, monitor, began)
    if switches is None:
        return solution
    return replace(solution, numbers=replace(solution.numbers, switches=switches))  # type: ignore[type-var]

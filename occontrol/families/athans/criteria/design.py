"""Problems of readings without a prior: experiments for constant parameters, solved, judged, put together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from occontrol.core import stopwatch
from occontrol.core.errors import InfeasibleError
from occontrol.core.method import Method
from occontrol.core.monitor import Monitor
from occontrol.core.printed import rounded_down
from occontrol.core.solution import Solution, Status
from occontrol.core.state_labels import state_names
from occontrol.families.athans.criteria.design_arrays import arrays_of, equivalence_of
from occontrol.families.athans.criteria.design_search import HuntedDesign, hunt_design
from occontrol.families.athans.criteria.plain_information import plain_information_cost
from occontrol.families.athans.criteria.statement import LARGEST, LOG_TRACE, LOGDET, SCHATTEN, CriterionChoice
from occontrol.families.athans.methods import Relaxed, RelaxRoundPolish
from occontrol.families.athans.readings.assembly import Verdict, checked, collect_numbers, remark_on
from occontrol.families.athans.readings.fill import Filled, feasible_set, fill, terminal_output
from occontrol.families.athans.readings.problem import ReadingsProblem
from occontrol.scheduling.criteria import LargestEigenvalue, LogDeterminant, LogTrace, Schatten, independent_outputs
from occontrol.scheduling.criterion import Criterion, TraceCriterion
from occontrol.scheduling.information import InformationObjective, prove_information
from occontrol.scheduling.seen import Unseen, reduced, seen_from_start

NAMED = 1e-6  # of the largest: what of a direction is told
UNSEEN = "no schedule sees the direction {direction} of the states at the start, and an output needs it"
TOO_FEW = "no schedule of these readings determines every state that the outputs need"


@dataclass(frozen=True, eq=False)
class Experiment:
    """A problem without a prior as the search sees it.

    Parameters
    ----------
    filled : as a recursion, in balanced units
    objective : the true one
    note : what is to be said about it
    """

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
    filled = fill(problem)
    r = filled.recursion
    unknown = problem.unknown
    seen = seen_from_start(r, filled.units.out_of(terminal_output(problem)[0])).of(unknown)
    try:
        kept, inner = reduced(seen, problem.upper)
    except Unseen as unseen:
        whole = np.zeros(problem.states)
        whole[unknown] = unseen.direction
        direction = filled.units.inverse.vector(whole)
        hint = "hint: a sensor that sees it, another output, or an initial covariance"
        raise InfeasibleError(f"{UNSEEN.format(direction=spelt(direction, state_names(problem)))}\n  {hint}") from None
    note = ""
    if kept.shape[1] < len(kept):
        note = f"{len(kept) - kept.shape[1]} directions of the states that no reading sees are needed by no output."
    output, choice = inner.output, problem.criterion or CriterionChoice()
    criterion: Criterion = TraceCriterion(output.T @ output)
    if choice.name == LOGDET:
        every = InformationObjective(inner, criterion, r.decision_cost, r).design.covariance(problem.upper)
        independent = independent_outputs(output, every) if every is not None else output
        if len(independent) < len(output):
            count = len(independent)
            note += f" {len(output)} outputs have only {count} independent errors: the determinant is theirs."
        criterion = LogDeterminant(independent)
    elif choice.name == LARGEST:
        criterion = LargestEigenvalue(output)
    elif choice.name == LOG_TRACE:
        criterion = LogTrace(output)
    elif choice.name == SCHATTEN:
        criterion = Schatten(output, choice.power)
    objective = InformationObjective(inner, criterion, r.decision_cost, r)
    if not np.isfinite(objective.cost(np.where(problem.upper > 0, problem.upper, 0.0))):
        raise InfeasibleError(TOO_FEW)
    return Experiment(filled, objective, note.strip())


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

    Raises InfeasibleError where the policy leaves a direction unseen.
    """
    began, monitor = stopwatch.seconds(), Monitor()
    experiment = experiment_of(problem)
    if not np.isfinite(experiment.objective.cost(weights)):
        raise InfeasibleError("the schedule leaves a direction of the states unseen: its cost is infinite")
    whole = bool(np.all(np.abs(weights - np.round(weights)) < 1e-9))
    method: Method = RelaxRoundPolish(relative_gap) if whole else Relaxed(relative_gap)
    hunted = hunt_design(experiment.objective, feasible_set(problem), method, monitor)
    known = experiment.objective.cost(hunted.found.weights)
    hunted.found.weights = weights
    return _assembled(problem, "certify", experiment, hunted, monitor, began), known


def spelt(direction: np.ndarray, names: Sequence[str]) -> str:
    """A direction (n,) in words: x1 - 0.5 x3.

    Parameters
    ----------
    direction : (n,)
    names : of the states
    """
    scaled = direction / direction[np.argmax(np.abs(direction))]
    parts = []
    for name, value in zip(names, scaled, strict=True):
        if abs(value) > NAMED:
            size = "" if abs(abs(value) - 1) < NAMED else f"{abs(value):.4g} "
            parts.append(f"{'-' if value < 0 else '+'} {size}{name}")
    text = " ".join(parts)
    return text[2:] if text.startswith("+") else f"-{text[2:]}"


def _assembled(
    problem: ReadingsProblem, name: str, experiment: Experiment, hunted: HuntedDesign, monitor: Monitor, began: float
) -> Solution:
    """Certify what was found, and check it by another route."""
    found, filled, objective = hunted.found, experiment.filled, experiment.objective
    v, relaxed, allowed = found.weights, found.relaxed, feasible_set(problem)
    proof = prove_information(objective, allowed, v, hunted.tangents, found.bound)
    certificate = proof.certificate
    monitor.report(found.iterations, certificate.cost, certificate.lower_bound, stage="check")
    plain = plain_information_cost(problem, filled.recursion.on_steps(v))
    status = found.status
    if status is Status.CERTIFIED and not (found.proves and proof.resolved(found.target)):
        status = Status.CERTIFIED if certificate.relative_gap <= found.target else Status.FEASIBLE
    status, message = checked(proof, plain, plain.cost, status, found.message)
    if status is not Status.DISAGREES:
        text = f"No schedule of these readings costs less than {rounded_down(certificate.lower_bound, 6)}."
        usual = status in (Status.CERTIFIED, Status.FEASIBLE)
        message = message or (text if usual else f"{status.text} {text}")
        message += remark_on(found, certificate) + proof.remark(found.target)
        message += f" {experiment.note}" if experiment.note else ""
    extra = dict(found.extra)
    further = {"nodes": extra.pop("nodes", None), "proven_optimal": extra.pop("proven_optimal", None)}
    if relaxed is not None:
        extra["equivalence"] = equivalence_of(objective, allowed, relaxed.weights)
    bound = relaxed.lower_bound if relaxed is not None else certificate.lower_bound
    _, gradient = objective.cost_and_gradient(v)
    verdict = Verdict(v, v, proof, gradient, found.iterations, status, message, relaxed, bound, further, extra)
    arrays = arrays_of(problem, filled, v, gradient)
    if relaxed is not None:
        arrays["relaxed_weights"] = filled.recursion.on_steps(relaxed.weights)
        _, slope = objective.cost_and_gradient(relaxed.weights)
        arrays["relaxed_switching"] = filled.recursion.on_steps(slope)
    return collect_numbers(problem, name, filled, verdict, plain, arrays, monitor, began)

"""From a policy of readings to a Solution: its numbers, certificate, independent check, arrays."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from occontrol.core.kinds import PlainDict
from occontrol.core.monitor import Monitor
from occontrol.core.printed import rounded_down
from occontrol.core.solution import ALLOWANCE, Certificate, Solution, Status, make_solution
from occontrol.families.athans.found import Found
from occontrol.families.athans.readings.fill import Filled, feasible_set
from occontrol.families.athans.readings.gains import reading_gains
from occontrol.families.athans.readings.plain import PlainCost, plain_cost
from occontrol.families.athans.readings.problem import ReadingsProblem
from occontrol.families.athans.result import AthansResult, TopNumbers
from occontrol.scheduling.certified import Term
from occontrol.scheduling.path import step_path
from occontrol.scheduling.proof import Judged, Proof, prove
from occontrol.scheduling.recursion import Recursion
from occontrol.scheduling.relaxation import RelaxedOutcome
from occontrol.scheduling.sweep import Sweep

AGREE = 1e-9  # of the cost: by so much the recursion and the plain filter may differ
WEAK = 0.01  # gap that is worth a sentence


@dataclass
class Verdict:
    """What is known of a policy of readings.

    Parameters
    ----------
    weights : (E, M) of what is measured
    on : (E, M) of what is in use and paid for; more than is measured where sensors warm up
    proof : of it
    gradient : (E, M) at the policy
    iterations : of the method
    status, message : how it ended
    relaxed : the relaxation without rules
    relaxed_lower_bound : its bound
    further : entries of AthansResult that only some policies have
    extra : entries of one method alone
    along : Recursion whose costate belongs to the policy; the problem's own where its trace is the criterion
    """

    weights: np.ndarray
    on: np.ndarray
    proof: Proof
    gradient: np.ndarray
    iterations: int
    status: Status
    message: str
    relaxed: RelaxedOutcome | None
    relaxed_lower_bound: float
    further: PlainDict = field(default_factory=dict)
    extra: PlainDict = field(default_factory=dict)
    along: Recursion | None = None


def assemble(
    problem: ReadingsProblem, name: str, filled: Filled, found: Found, monitor: Monitor, began: float
) -> Solution:
    """Certify a policy, check it with the plain filter, and collect everything that a run folder holds.

    Parameters
    ----------
    problem : ReadingsProblem
    name : of the method
    filled : the problem as a recursion
    found : what the method handed over
    monitor : Monitor
    began : stopwatch.seconds() at the start
    """
    v, relaxed, constant = found.weights, found.relaxed, filled.constant
    sweep = Sweep(filled.recursion)
    policies = [judged_policy(sweep, v)]
    if relaxed is not None and relaxed.weights is not v:
        policies.append(judged_policy(sweep, relaxed.weights))
    known = max(found.bound, relaxed.lower_bound if relaxed is not None else -np.inf)
    proof = raised(prove(policies, feasible_set(problem), known), constant)
    certificate = proof.certificate
    monitor.report(found.iterations, certificate.cost, certificate.lower_bound, stage="check")
    plain = plain_cost(problem, filled.recursion.on_steps(v))
    status = found.status
    if status is Status.CERTIFIED and not (found.proves and proof.resolved(found.target)):
        status = Status.CERTIFIED if certificate.relative_gap <= found.target else Status.FEASIBLE
    status, message = checked(proof, plain, plain.cost, status, found.message)
    if status is not Status.DISAGREES:
        text = f"No schedule of these readings costs less than {rounded_down(certificate.lower_bound, 6)}."
        usual = status in (Status.CERTIFIED, Status.FEASIBLE)
        message = message or (text if usual else f"{status.text} {text}")
        message += remark_on(found, certificate) + proof.remark(found.target)
    extra = dict(found.extra)
    further = {"nodes": extra.pop("nodes", None), "proven_optimal": extra.pop("proven_optimal", None)}
    bound = (relaxed.lower_bound + constant) if relaxed is not None else certificate.lower_bound
    verdict = Verdict(
        v, v, proof, policies[0].gradient, found.iterations, status, message, relaxed, bound, further, extra
    )
    return collect(problem, name, filled, verdict, plain, monitor, began)


def raised(proof: Proof, constant: float) -> Proof:
    """A proof of what schedules can change, with the constant that they cannot change.

    Parameters
    ----------
    proof : without it
    constant : in cost units
    """
    inner = proof.certificate
    cost = inner.cost + constant
    size = 1.0 if inner.absolute else abs(cost)
    share = max(ALLOWANCE, proof.allowance / size) if size else 0.0
    certificate = Certificate(cost, inner.lower_bound + constant, share, inner.absolute)
    return Proof(certificate, proof.allowance, proof.difference, proof.below)


def checked(proof: Proof, plain: PlainCost, cost: float, status: Status, message: str) -> tuple[Status, str]:
    """`disagrees` and its reason where the plain filter or the certificate itself contradicts; else what was given.

    Parameters
    ----------
    proof : of the policy
    plain : the plain filter's numbers
    cost : what they add up to
    status, message : how the method ended
    """
    certificate = proof.certificate
    apart = abs(cost - certificate.cost)
    scale = max(certificate.size, abs(plain.observation) + abs(plain.running) + abs(plain.criterion))
    if certificate.contradicts:
        return Status.DISAGREES, certificate.text
    if not apart <= AGREE * scale + 10 * proof.allowance:
        return Status.DISAGREES, (
            f"the recursion puts the cost at {certificate.cost:.12g}, an independent covariance filter at "
            f"{cost:.12g}: do not trust either"
        )
    return status, message


def collect(
    problem: ReadingsProblem, name: str, filled: Filled, verdict: Verdict, plain: PlainCost, monitor: Monitor,
    began: float,
) -> Solution:  # fmt: skip
    """The Solution of a policy: its numbers and arrays.

    Parameters
    ----------
    problem : ReadingsProblem
    name : of the method
    filled : the problem as a recursion
    verdict : what is known of the policy
    plain : what the plain filter says of it
    monitor : Monitor
    began : stopwatch.seconds() at the start
    """
    r, v, relaxed = filled.recursion, verdict.weights, verdict.relaxed
    rows, on = r.on_steps(v), r.on_steps(verdict.on)
    path, units = step_path(verdict.along or r, v), filled.units.inverse
    lengths = r.by_decision(np.ones(len(r.steps)))
    arrays = {
        "times": problem.clock.times,
        "edges": problem.edges,
        "weights": on,
        **({} if verdict.on is v else {"measuring": rows}),
        "covariance": units.covariance(path.after),
        "prior_covariance": units.covariance(np.concatenate([path.before, path.final[None]])),
        "costate": units.weight(path.costate),
        "switching": r.on_steps(verdict.gradient / lengths[:, None]),
        "gain": reading_gains(problem, rows, units.covariance(path.after)),
    }
    if relaxed is not None:
        arrays["relaxed_weights"] = r.on_steps(relaxed.weights)
    final = float(np.vdot(r.terminal, path.final))
    return collect_numbers(problem, name, filled, verdict, plain, arrays, monitor, began, final)


def collect_numbers(
    problem: ReadingsProblem, name: str, filled: Filled, verdict: Verdict, plain: PlainCost,
    arrays: dict[str, np.ndarray], monitor: Monitor, began: float, final: float | None = None,
) -> Solution:  # fmt: skip
    """The Solution of a policy with the arrays that are given.

    Parameters
    ----------
    problem : ReadingsProblem
    name : of the method
    filled : the problem as a recursion
    verdict : what is known of the policy
    plain : what the plain filter says of it
    arrays : by name, for example edges (N+1,)
    monitor : Monitor
    began : stopwatch.seconds() at the start
    final : tr(W S); the plain filter's if None
    """
    r, relaxed, certificate = filled.recursion, verdict.relaxed, verdict.proof.certificate
    on = r.on_steps(verdict.on)
    schedule = problem.make_schedule(problem.edges, on)
    final = plain.prediction if final is None else final
    top = TopNumbers.stated(certificate, "problem")
    numbers = AthansResult(
        name=problem.name,
        top=top,
        cost=certificate.cost,
        lower_bound=certificate.lower_bound,
        relative_gap=certificate.relative_gap,
        allowance=verdict.proof.allowance,
        observation_cost=float(np.sum(reading_prices(problem) * on)),
        cost_weight=problem.cost_weight,
        running_cost=plain.running,
        prediction_error=final,
        predicted_mean_square_error=final + filled.after,
        continuous=None,
        discretisation_error=None,
        relaxed_cost=relaxed.cost + filled.constant if relaxed is not None else certificate.cost,
        relaxed_lower_bound=verdict.relaxed_lower_bound,
        singular_fraction=None,
        intervals=r.intervals,
        readings=problem.readings,
        integration_steps=None,
        integration_error=None,
        added_edges=None,
        warnings=list(problem.warnings),
        switches=schedule.switches,
        sweeps=dict(relaxed.sweeps) if relaxed is not None else {},
        extra=verdict.extra,
        schedule=schedule.segments(),
        criterion=None if problem.criterion is None else plain.criterion,
        **verdict.further,
    )
    return make_solution(
        problem=problem,
        method=name,
        status=verdict.status,
        message=verdict.message,
        iterations=verdict.iterations,
        numbers=numbers,
        monitor=monitor,
        began=began,
        arrays=arrays,
        schedule=schedule,
        certificate=certificate,
    )


def reading_prices(problem: ReadingsProblem) -> np.ndarray:
    """(N, M) what each reading costs, before it is weighted."""
    return np.column_stack([s.cost.sample(problem.clock.times)[:, 0, 0] for s in problem.sensors])


def judged_policy(sweep: Sweep, weights: np.ndarray) -> Judged:
    """A policy with cost and gradient by the sweeps, for `prove`.

    Parameters
    ----------
    sweep : Sweep
    weights : (N, M) policy
    """
    J, g = sweep.cost_and_gradient(weights)
    return Judged(weights, J, g, [Term(1.0, sweep.recursion)])


def remark_on(found: Found, certificate: Certificate) -> str:
    """What a wide gap comes from.

    Parameters
    ----------
    found : by a method
    certificate : of it
    """
    if certificate.relative_gap <= WEAK or found.relaxed is None:
        return ""
    return (
        " A reading cannot be split, and the relaxation splits them: with few accurate readings the bound is loose, "
        "while the schedule may be the best."
    )

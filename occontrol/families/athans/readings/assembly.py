"""From a policy of readings to a Solution: its numbers, certificate, independent check, arrays."""

from __future__ import annotations

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.core.solution import ALLOWANCE, Certificate, Solution, Status, make_solution
from occontrol.families.athans.found import Found
from occontrol.families.athans.readings.fill import Filled, feasible_set
from occontrol.families.athans.readings.gains import reading_gains
from occontrol.families.athans.readings.plain import plain_cost
from occontrol.families.athans.readings.problem import ReadingsProblem
from occontrol.families.athans.result import AthansResult, TopNumbers
from occontrol.scheduling.certified import Term
from occontrol.scheduling.path import step_path
from occontrol.scheduling.proof import Judged, prove
from occontrol.scheduling.sweep import Sweep

AGREE = 1e-9  # of the cost: by so much the recursion and the plain filter may differ
WEAK = 0.01  # gap that is worth a sentence


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
    r, v, allowed, relaxed = filled.recursion, found.weights, feasible_set(problem), found.relaxed
    sweep, constant = Sweep(r), filled.constant
    policies = [_judged(sweep, v)]
    if relaxed is not None and relaxed.weights is not v:
        policies.append(_judged(sweep, relaxed.weights))
    known = max(found.bound, relaxed.lower_bound if relaxed is not None else -np.inf)
    proof = prove(policies, allowed, known)
    inner = proof.certificate
    certificate = Certificate(
        inner.cost + constant,
        inner.lower_bound + constant,
        max(ALLOWANCE, proof.allowance / abs(inner.cost + constant)) if inner.cost + constant else 0.0,
    )
    monitor.report(found.iterations, certificate.cost, certificate.lower_bound, stage="check")
    rows = r.on_steps(v)
    plain = plain_cost(problem, rows)
    status, message = found.status, found.message
    if status is Status.CERTIFIED and not (found.proves and proof.resolved(found.target)):
        status = Status.CERTIFIED if certificate.relative_gap <= found.target else Status.FEASIBLE
    apart = abs(plain.cost - certificate.cost)
    scale = max(abs(certificate.cost), abs(plain.observation) + abs(plain.running) + abs(plain.prediction))
    if certificate.contradicts:
        status, message = Status.DISAGREES, certificate.text
    elif not apart <= AGREE * scale + 10 * proof.allowance:
        status = Status.DISAGREES
        message = (
            f"the recursion puts the cost at {certificate.cost:.12g}, an independent covariance filter at "
            f"{plain.cost:.12g}: do not trust either"
        )
    extra = dict(found.extra)
    nodes, proven = extra.pop("nodes", None), extra.pop("proven_optimal", None)
    path = step_path(r, v)
    units = filled.units.inverse
    schedule = problem.make_schedule(problem.edges, rows)
    top = TopNumbers(certificate.cost, certificate.lower_bound, certificate.relative_gap, "problem")
    remarks = "" if status is Status.DISAGREES else _remark(found, certificate) + proof.remark(found.target)
    numbers = AthansResult(
        name=problem.name,
        top=top,
        cost=certificate.cost,
        lower_bound=certificate.lower_bound,
        relative_gap=certificate.relative_gap,
        allowance=proof.allowance,
        observation_cost=_prices(problem, rows),
        cost_weight=problem.cost_weight,
        running_cost=plain.running,
        prediction_error=float(np.vdot(r.terminal, path.final)),
        predicted_mean_square_error=float(np.vdot(r.terminal, path.final)) + filled.after,
        continuous=None,
        discretisation_error=None,
        relaxed_cost=(relaxed.cost if relaxed is not None else inner.cost) + constant,
        relaxed_lower_bound=(relaxed.lower_bound if relaxed is not None else inner.lower_bound) + constant,
        singular_fraction=None,
        intervals=r.intervals,
        readings=problem.readings,
        integration_steps=None,
        integration_error=None,
        added_edges=None,
        warnings=list(problem.warnings),
        switches=schedule.switches,
        sweeps=dict(relaxed.sweeps) if relaxed is not None else {},
        extra=extra,
        proven_optimal=proven,
        nodes=nodes,
        schedule=schedule.segments(),
    )
    arrays = {
        "times": problem.clock.times,
        "edges": problem.edges,
        "weights": rows,
        "covariance": units.covariance(path.after),
        "prior_covariance": units.covariance(np.concatenate([path.before, path.final[None]])),
        "costate": units.weight(path.costate),
        "switching": r.on_steps(policies[0].gradient / _readings_each(r)[:, None]),
        "gain": reading_gains(problem, rows, units.covariance(path.after)),
    }
    if relaxed is not None:
        arrays["relaxed_weights"] = r.on_steps(relaxed.weights)
    return make_solution(
        problem=problem,
        method=name,
        status=status,
        message=(message or _message(status, top)) + remarks,
        iterations=found.iterations,
        numbers=numbers,
        monitor=monitor,
        began=began,
        arrays=arrays,
        schedule=schedule,
        certificate=certificate,
    )


def _judged(sweep: Sweep, weights: np.ndarray) -> Judged:
    J, g = sweep.cost_and_gradient(weights)
    return Judged(weights, J, g, [Term(1.0, sweep.recursion)])


def _readings_each(r) -> np.ndarray:
    """(E,) readings of every decision."""
    return r.by_decision(np.ones(len(r.steps)))


def _prices(problem: ReadingsProblem, rows: np.ndarray) -> float:
    """What the readings of (N, M) cost, before it is weighted."""
    prices = np.column_stack([s.cost.sample(problem.clock.times)[:, 0, 0] for s in problem.sensors])
    return float(np.sum(prices * rows))


def _message(status: Status, top: TopNumbers) -> str:
    text = f"No schedule of these readings costs less than {top.lower_bound:.6g}."
    return text if status in (Status.CERTIFIED, Status.FEASIBLE) else f"{status.text} {text}"


def _remark(found: Found, certificate: Certificate) -> str:
    """What a wide gap comes from."""
    if certificate.relative_gap <= WEAK or found.relaxed is None:
        return ""
    return (
        " A reading cannot be split, and the relaxation splits them: with few accurate readings the bound is loose, "
        "while the schedule may be the best."
    )

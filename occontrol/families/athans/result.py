"""From a policy to a Solution of the athans family: certificate, independent check, arrays."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Certificate, Solution, Status
from occontrol.families.athans.certificate import judge
from occontrol.families.athans.discretise import HalfPredicts, prediction_weight
from occontrol.families.athans.filter.gains import filter_gains
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.families.athans.run_method import Found
from occontrol.scheduling.hminimal import polish
from occontrol.scheduling.proof import prove
from occontrol.scheduling.rounding import singular_intervals, sum_up_rounding
from occontrol.scheduling.sweep import Sweep, node_path


def assemble(
    problem: SchedulingProblem,
    name: str,
    sweep: Sweep,
    halves: HalfPredicts,
    found: Found,
    monitor: Monitor,
    started: float,
) -> Solution:
    """Certify a policy, check it in continuous time, and collect everything that a run folder holds.

    Parameters
    ----------
    problem : SchedulingProblem
    name : of the method
    sweep, halves : the problem's recursion
    found : what the method handed over
    monitor : Monitor
    started : time.perf_counter() at the start
    """
    r, v = sweep.recursion, found.weights
    relaxed = found.relaxed
    known = max(found.bound, relaxed.lower_bound if relaxed is not None else -np.inf)
    proof = prove(sweep, v, known, relaxed.weights if relaxed is not None else None)
    certificate = proof.certificate
    monitor.report(found.iterations, certificate.cost, certificate.lower_bound, stage="check")
    # whoever interrupts waits for one re-integration, not for two
    better = relaxed.weights if relaxed is not None and not monitor.interrupted else None
    judged = judge(problem, v, certificate.cost, better)
    path = node_path(r, halves, v)
    status, message = found.status, found.message
    trusted = found.proves and proof.resolved(found.target)
    if status is Status.CERTIFIED and not trusted and certificate.relative_gap > found.target:
        status = Status.FEASIBLE
    schedule = Schedule(problem.edges, v, tuple(problem.sensors.names))
    singular = _singular_fraction(sweep, relaxed.weights if relaxed is not None else v, v, monitor)
    observation = float(np.vdot(r.cost, v))
    error = float(np.vdot(r.terminal, path.covariance[-1]))
    continuous = judged.certificate
    if not judged.agrees:
        status, message = Status.DISAGREES, judged.text
    elif not _adds_up(certificate.cost + proof.below, observation, error, r.running.shape[0] > 0):
        status, message = Status.DISAGREES, _SPOILT
    remarks = "" if status is Status.DISAGREES else _coarse(certificate, continuous) + proof.remark(found.target)
    result: dict[str, Any] = {
        "name": problem.name,
        **certificate.as_dict(),
        "allowance": proof.allowance,
        "observation_cost": observation / problem.cost_weight if problem.cost_weight else _raw_cost(problem, v),
        "cost_weight": problem.cost_weight,
        "running_cost": certificate.cost - observation - error,
        "prediction_error": error,
        "predicted_mean_square_error": error + prediction_weight(problem)[1],
        "continuous": continuous.as_dict(),
        "discretisation_error": judged.discretisation_error,
        "relaxed_cost": relaxed.cost if relaxed is not None else certificate.cost,
        "relaxed_lower_bound": relaxed.lower_bound if relaxed is not None else certificate.lower_bound,
        "singular_fraction": singular,
        "switches": schedule.switches,
        "sweeps": dict(relaxed.sweeps) if relaxed is not None else {},
        **found.extra,
        "schedule": schedule.segments(),
    }
    if r.running.shape[0] == 0:
        result["running_cost"] = 0.0
    arrays = {
        "times": problem.edges,
        "edges": problem.edges,
        "weights": v,
        "covariance": path.covariance,
        "costate": path.costate,
        "switching": path.switching,
        **filter_gains(problem, v, path),
    }
    if relaxed is not None:
        arrays["relaxed_weights"] = relaxed.weights
    return Solution(
        family="athans",
        method=name,
        status=status,
        message=(message or _message(status, certificate, singular, schedule)) + remarks,
        iterations=found.iterations,
        seconds=time.perf_counter() - started,
        result=result,
        arrays=arrays,
        schedule=schedule,
        certificate=certificate,
        history=tuple(monitor.history),
        problem=problem,
    )


def _singular_fraction(sweep: Sweep, relaxed: np.ndarray, weights: np.ndarray, monitor: Monitor) -> float:
    """Share of the horizon on singular arcs of the relaxed optimum."""
    r = sweep.recursion
    rounded = weights
    if weights is relaxed or not np.array_equal(weights, np.round(weights)):
        rounded = polish(sweep, sum_up_rounding(relaxed, r.steps, r.upper, r.select), 50, monitor.silent()).weights
    singular = singular_intervals(relaxed, rounded)
    return float(np.sum(r.steps[singular]) / np.sum(r.steps))


def _raw_cost(problem: SchedulingProblem, v: np.ndarray) -> float:
    rates = np.column_stack([s.cost.sample(problem.midpoints)[:, 0, 0] for s in problem.sensors])
    return float(np.sum(rates * problem.steps[:, None] * v))


_SPOILT = (
    "rounding has spoilt the recursion, its cost is not the sum of its parts: the covariance grows too far between "
    "measurements, use shorter intervals"
)
COARSE = 0.1


def _adds_up(cost: float, observation: float, error: float, running: bool) -> bool:
    """Whether the cost of the sweep is that of the path, up to a running cost, which is not negative."""
    rest = cost - observation - error
    slack = 1e-2 * (abs(cost) + abs(observation) + abs(error))
    return rest >= -slack and (running or rest <= slack)


def _coarse(certificate: Certificate, continuous: Certificate) -> str:
    """A remark where the grid says little about continuous time."""
    if abs(certificate.cost - continuous.cost) <= COARSE * abs(continuous.cost):
        return ""
    return f" The grid is coarse: in continuous time this schedule costs {continuous.cost:.6g}; use more intervals."


def _message(status: Status, certificate: Certificate, singular: float, schedule: Schedule) -> str:
    text = f"No schedule on this grid costs less than {certificate.lower_bound:.6g}."
    if singular > 0 and status in (Status.CERTIFIED, Status.FEASIBLE):
        text += f" Arcs are singular on {100 * singular:.3g} % of the horizon: there"
        text += " the optimum is approached only by fast switching." if schedule.is_integer else " weights are shares."
    return text if status in (Status.CERTIFIED, Status.FEASIBLE) else f"{status.text} {text}"

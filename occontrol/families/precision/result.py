"""What a solve of the precision family hands over: numbers for result.json, and arrays."""

from __future__ import annotations

from typing import Any

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.core.result import PlainResult
from occontrol.core.solution import Certificate, Solution, Status
from occontrol.families.precision.problem import Problem
from occontrol.families.precision.program import MEETS, PrecisionResult, relative_margin
from occontrol.families.precision.pruning import Pruned, active
from occontrol.families.precision.sequence import BatchOutcome
from occontrol.families.precision.text import infeasible_text

Steps = list[tuple[PrecisionResult, Pruned | None]]
_WORST = (
    Status.FAILED,
    Status.INFEASIBLE,
    Status.DISAGREES,
    Status.INTERRUPTED,
    Status.LIMIT,
    Status.FEASIBLE,
    Status.CERTIFIED,
)


def assemble(
    problem: Problem, method: str, steps: Steps, outcomes: list[BatchOutcome], monitor: Monitor, seconds: float
) -> Solution:
    """The Solution of all batches; the family's names as in result.json."""
    records = [_record(problem, k, *step, outcomes) for k, step in enumerate(steps)]
    status = min((Status(r["status"]) for r in records), key=_WORST.index)
    missing = problem.batches - len(records)
    if missing and status not in (Status.INFEASIBLE, Status.FAILED):
        status = Status.INTERRUPTED if monitor.interrupted else Status.LIMIT
    finals = [pruned.result if pruned is not None else result for result, pruned in steps]
    good = [f for f in finals if f.precisions is not None]
    bad = next((k for k, f in enumerate(finals) if f.precisions is None), None)
    result: dict[str, Any] = {"name": problem.name}
    arrays: dict[str, np.ndarray] = {"bound": problem.bound}
    certificate = None
    verdict = finals[-1].feasibility if bad is None else finals[bad].feasibility
    # a bound below the reach of any precision: what could be had instead, and what stands in the way
    result["smallest_factor"] = problem.factor * max(first.feasibility.factor for first, _ in steps)
    if bad is not None:
        result["preventing_direction"] = verdict.direction.tolist()
        result["infeasible_batch"] = bad + 1
        message = finals[bad].message
        if finals[bad].status is Status.INFEASIBLE and verdict.factor >= 1 - 1e-9:
            message = infeasible_text(problem, verdict)
        if len(records) > 1 or problem.batches > 1:
            message = f"Batch {bad + 1} of {problem.batches}: {message}"
    else:
        message = finals[0].message if len(finals) == 1 else f"{len(finals)} batches, each within its bound."
        if missing:
            message = f"Stopped after {len(finals)} of {problem.batches} batches, each within its bound."
        pruned = steps[0][1]
        if pruned is not None and len(finals) == 1:
            message = f"{records[0]['active']} sensors are left ({pruned.reason}); " + message[0].lower() + message[1:]
        objective, lower = sum(f.objective for f in finals), sum(r["lower_bound"] for r in records)
        certificate = Certificate(objective, min(lower, objective))
        precisions = np.concatenate([f.precisions for f in good])  # type: ignore[misc]
        result |= {
            "objective": objective,
            **certificate.as_dict(),
            "precisions": precisions.tolist(),
            "active": sum(r["active"] for r in records),
            "active_sensors": records[0]["active_sensors"] if len(records) == 1 else None,
            "margin": min(f.margin for f in finals),
            "relative_margin": min(f.relative_margin for f in finals),
            "total_precision": float(np.sum(precisions)),
            "least_active": sum(f.feasibility.least_active for f in finals),
        }
        result = {key: value for key, value in result.items() if value is not None}
    if len(records) > 1 or problem.batches > 1:
        result["batches"] = records
        solved = [o for o in outcomes if o.observed is not None and np.isfinite(o.nis)]
        if solved:
            error = np.array([o.mean - o.truth for o in solved])
            result["rms_error"] = float(np.sqrt(np.mean(error**2)))
    elif "pruning" in records[0]:
        result["pruning"] = records[0]["pruning"]
    result["route"] = finals[-1].route
    if good:
        arrays["precisions"] = np.array([f.precisions for f in good])
        arrays["posterior"] = np.array([f.posterior for f in good])
    if outcomes:
        arrays |= {
            "prior": np.array([o.forecast.moments.state for o in outcomes]),
            "measurement_times": np.concatenate([o.forecast.times for o in outcomes]),
            "estimate": np.array([o.mean for o in outcomes]),
            "truth": np.array([o.truth for o in outcomes]),
            "filter_covariance": np.array([o.filter_covariance for o in outcomes]),
        }
    elif problem.moments is not None:
        arrays["prior"] = problem.moments.state[None]
    iterations = sum(f.iterations for f in finals)
    return Solution(
        "precision", method, status, message, iterations, seconds, PlainResult(result), arrays, None, certificate,
        tuple(monitor.history), problem=problem,
    )  # fmt: skip


def _record(
    problem: Problem, k: int, result: PrecisionResult, pruned: Pruned | None, outcomes: list[BatchOutcome]
) -> dict[str, Any]:
    """One batch as it stands in result.json."""
    final = result if pruned is None else pruned.result
    record: dict[str, Any] = {"batch": k + 1, "status": str(final.status)}
    record["smallest_factor"] = problem.factor * result.feasibility.factor
    if final.precisions is None:
        return record
    status = final.status
    if pruned is not None and status is Status.CERTIFIED and final.objective > result.objective * (1 + 1e-6):
        status = Status.FEASIBLE  # the bound below is that of all sensors
    moments = problem.moments if not outcomes else outcomes[k].forecast.moments
    assert moments is not None
    labels, on = problem.labels(), active(problem.program(moments), final.precisions)
    record |= {
        "status": str(status),
        "objective": final.objective,
        "lower_bound": min(result.lower_bound, final.objective),
        "active": len(on),
        "active_sensors": [labels[i] for i in on],
        "margin": final.margin,
        "relative_margin": final.relative_margin,
        "least_active": final.feasibility.least_active,
    }
    if outcomes:
        outcome = outcomes[k]
        record["rms_error"] = float(np.sqrt(np.mean((outcome.mean - outcome.truth) ** 2)))
        record["filter_relative_margin"] = relative_margin(outcome.filter_covariance, problem.bound)
        record["guarantee"] = bool(relative_margin(outcome.covariance, problem.bound) >= -MEETS)
        if np.isfinite(outcome.nis):
            record["nis"] = outcome.nis
    if pruned is not None:
        record["pruning"] = _pruning(problem, result, pruned)
    return record


def _pruning(problem: Problem, result: PrecisionResult, pruned: Pruned) -> dict[str, Any]:
    labels, groups = problem.labels(), problem.groups()

    def called(members: tuple[int, ...]) -> list[str]:
        return [labels[i] for g in members for i in groups[g]]

    removals = [
        {
            "removed": called(r.groups),
            "objective": r.objective,
            "price": r.price if np.isfinite(r.price) else r.objective - result.objective,
            "remaining": r.remaining,
        }
        for r in pruned.removals
    ]
    before = {"objective_before": result.objective, "removals": removals, "refused": called(pruned.refused)}
    return {
        **before,
        "reason": pruned.reason,
        "restricted_lower_bound": pruned.result.lower_bound,
        "proven": pruned.proven,
    }

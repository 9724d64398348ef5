"""The Solution of all batches: numbers for result.json, arrays, and the one sentence of how it ended."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from occontrol.core import stopwatch
from occontrol.core.kinds import PlainDict
from occontrol.core.monitor import Monitor
from occontrol.core.solution import Certificate, Solution, Status, make_solution
from occontrol.families.precision.batches import Solved
from occontrol.families.precision.problem import Problem
from occontrol.families.precision.program import MEETS, Outcome, relative_margin
from occontrol.families.precision.pruning import Pruned, active
from occontrol.families.precision.reach import infeasible_text
from occontrol.families.precision.result import BatchRecord, PrecisionResult, PruningRecord, RemovalRecord
from occontrol.families.precision.sequence import BatchOutcome

# the status of several batches is the first of these that one of them has
_WORST = (
    Status.FAILED,
    Status.INFEASIBLE,
    Status.DISAGREES,
    Status.INTERRUPTED,
    Status.LIMIT,
    Status.FEASIBLE,
    Status.CERTIFIED,
)


def solution_of(
    problem: Problem,
    numbers: PrecisionResult,
    *,
    method: str,
    status: Status,
    message: str,
    arrays: Mapping[str, np.ndarray],
    certificate: Certificate | None,
    iterations: int,
    monitor: Monitor,
) -> Solution:
    """The Solution that holds these numbers; its `seconds` are for the caller to fill in.

    Parameters
    ----------
    problem, numbers : the problem and what was found
    method, status, message, certificate, iterations : as in Solution
    arrays : by name, as in Solution; for example precisions (m,)
    monitor : whose history is kept
    """
    return make_solution(
        problem=problem,
        method=method,
        status=status,
        message=message,
        iterations=iterations,
        numbers=numbers,
        arrays=arrays,
        certificate=certificate,
        monitor=monitor or Monitor(),
        began=stopwatch.seconds(),
    )


def assemble(
    problem: Problem, method: str, solved: Sequence[Solved], outcomes: Sequence[BatchOutcome], monitor: Monitor
) -> Solution:
    """The Solution of all batches.

    Parameters
    ----------
    problem, method : the problem and the method's name
    solved, outcomes : of `solve_batches`
    monitor : who watched
    """
    records = [_record(problem, k, batch, outcomes) for k, batch in enumerate(solved)]
    finals = [batch.final for batch in solved]
    bad = next((k for k, f in enumerate(finals) if f.precisions is None), None)
    several = len(records) > 1 or problem.batches > 1
    missing = problem.batches - len(records)
    status = min((Status(r.status) for r in records), key=_WORST.index)
    if missing and status not in (Status.INFEASIBLE, Status.FAILED):
        status = Status.INTERRUPTED if monitor.interrupted else Status.LIMIT
    message, entries, certificate = "", {}, None
    if bad is None:
        certificate, entries = _totals(finals, records)
        disagrees = status is Status.DISAGREES
        message = _contradictions(solved, several) if disagrees else _success(problem, solved, records)
    else:
        message = finals[bad].message
        verdict = finals[bad].feasibility
        if finals[bad].status is Status.INFEASIBLE and verdict.factor >= 1 - 1e-9:
            message = infeasible_text(problem, verdict)
        if several:
            message = f"Batch {bad + 1} of {problem.batches}: {message}"
        entries = {"preventing_direction": verdict.direction.tolist(), "infeasible_batch": bad + 1}
    if several:
        entries |= {"batches": tuple(records), "rms_error": _rms_error(outcomes)}
    else:
        entries |= {"pruning": records[0].pruning}
    numbers = PrecisionResult(
        name=problem.name,
        # a bound below the reach of any precision: what could be had instead
        smallest_factor=problem.factor * max(batch.whole.feasibility.factor for batch in solved),
        route=finals[-1].route,
        **entries,
    )
    return solution_of(
        problem,
        numbers,
        method=method,
        status=status,
        message=message,
        arrays=_arrays(problem, finals, outcomes),
        certificate=certificate,
        iterations=sum(f.iterations for f in finals),
        monitor=monitor,
    )


def _success(problem: Problem, solved: Sequence[Solved], records: Sequence[BatchRecord]) -> str:
    """How it ended, in a sentence, where every batch that was solved keeps its bound."""
    if problem.batches > len(records):
        return f"Stopped after {len(records)} of {problem.batches} batches, each within its bound."
    if len(records) > 1:
        return f"{len(records)} batches, each within its bound."
    message, pruned = solved[0].final.message, solved[0].pruned
    if pruned is not None:
        return f"{records[0].active} sensors are left ({pruned.reason}); " + message[0].lower() + message[1:]
    return message


def _beside(solved: Solved) -> Certificate:
    """The cost of a batch beside the bound, which is that of all its sensors."""
    return Certificate(solved.final.objective, solved.whole.lower_bound)


def _contradictions(solved: Sequence[Solved], several: bool) -> str:
    """Which batches have a bound above their cost; of a single one the certificate of the solution says it."""
    texts = [(k, _beside(batch).text) for k, batch in enumerate(solved)]
    return "; ".join(f"batch {k + 1}: {text}" for k, text in texts if text) if several else ""


def _totals(finals: Sequence[Outcome], records: Sequence[BatchRecord]) -> tuple[Certificate, PlainDict]:
    """Certificate and entries of all batches together."""
    objective = sum(f.objective for f in finals)
    certificate = Certificate(objective, sum(_number(r.lower_bound) for r in records))
    precisions = np.concatenate([f.precisions for f in finals])
    entries = {
        "objective": objective,
        **certificate.as_dict(),
        "precisions": precisions.tolist(),
        "active": sum(r.active or 0 for r in records),
        "active_sensors": records[0].active_sensors if len(records) == 1 else None,
        "margin": min(f.margin for f in finals),
        "relative_margin": min(f.relative_margin for f in finals),
        "total_precision": float(np.sum(precisions)),
        "least_active": sum(f.feasibility.least_active for f in finals),
    }
    return certificate, entries


def _number(value: float | None) -> float:
    return float("nan") if value is None else value


def _rms_error(outcomes: Sequence[BatchOutcome]) -> float | None:
    """Of the estimates against the truth, over states and the batches in which something was measured."""
    error = [o.mean - o.truth for o in outcomes if np.isfinite(o.nis)]
    return float(np.sqrt(np.mean(np.array(error) ** 2))) if error else None


def _arrays(problem: Problem, finals: Sequence[Outcome], outcomes: Sequence[BatchOutcome]) -> dict[str, np.ndarray]:
    arrays: dict[str, np.ndarray] = {"bound": problem.bound}
    good = [f for f in finals if f.precisions is not None]
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
    return arrays


def _record(problem: Problem, k: int, solved: Solved, outcomes: Sequence[BatchOutcome]) -> BatchRecord:
    """One batch as it stands in result.json."""
    whole, final, pruned = solved.whole, solved.final, solved.pruned
    smallest = problem.factor * whole.feasibility.factor
    if final.precisions is None:
        return BatchRecord(batch=k + 1, status=str(final.status), smallest_factor=smallest)
    status = final.status
    if pruned is not None and status is Status.CERTIFIED and final.objective > whole.objective * (1 + 1e-6):
        status = Status.FEASIBLE  # the bound below is that of all sensors
    certificate = _beside(solved)
    if certificate.contradicts:
        status = Status.DISAGREES
    moments = outcomes[k].forecast.moments if outcomes else problem.first_moments()
    labels, on = problem.labels(), active(problem.program(moments), final.precisions)
    against_truth: PlainDict = {}
    if outcomes:
        outcome = outcomes[k]
        against_truth = {
            "rms_error": float(np.sqrt(np.mean((outcome.mean - outcome.truth) ** 2))),
            "filter_relative_margin": relative_margin(outcome.filter_covariance, problem.bound),
            "guarantee": bool(relative_margin(outcome.covariance, problem.bound) >= -MEETS),
            "nis": outcome.nis if np.isfinite(outcome.nis) else None,
        }
    return BatchRecord(
        batch=k + 1,
        status=str(status),
        smallest_factor=smallest,
        objective=final.objective,
        lower_bound=certificate.lower_bound,
        active=len(on),
        active_sensors=[labels[i] for i in on],
        margin=final.margin,
        relative_margin=final.relative_margin,
        least_active=final.feasibility.least_active,
        **against_truth,
        pruning=None if pruned is None else _pruning(problem, whole, pruned),
    )


def _pruning(problem: Problem, whole: Outcome, pruned: Pruned) -> PruningRecord:
    labels, groups = problem.labels(), problem.groups()

    def called(members: tuple[int, ...]) -> list[str]:
        return [labels[i] for g in members for i in groups[g]]

    removals = [
        RemovalRecord(
            removed=called(r.groups),
            objective=r.objective,
            price=r.price if np.isfinite(r.price) else r.objective - whole.objective,
            remaining=r.remaining,
        )
        for r in pruned.removals
    ]
    return PruningRecord(
        objective_before=whole.objective,
        removals=tuple(removals),
        refused=called(pruned.refused),
        reason=pruned.reason,
        restricted_lower_bound=pruned.result.lower_bound,
        proven=pruned.proven,
    )

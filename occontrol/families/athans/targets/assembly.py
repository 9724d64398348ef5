"""From weights of looks to a Solution: certificate, check in continuous time, results by target."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occontrol.core.errors import SolveFailed
from occontrol.core.look_schedule import LookSchedule
from occontrol.core.printed import rounded_down
from occontrol.core.solution import ALLOWANCE, Certificate, Solution, Status, make_solution
from occontrol.families.athans.result import AthansResult, ContinuousNumbers, TopNumbers
from occontrol.families.athans.targets.fill import Filled
from occontrol.families.athans.targets.one_target import continuous_costs
from occontrol.families.athans.targets.problem import TargetsProblem
from occontrol.families.athans.targets.rounding_check import rounding
from occontrol.families.athans.targets.solve import Task, interrupted
from occontrol.scheduling.blocks.sweep import BlockSweep
from occontrol.scheduling.bounds import at_least_zero
from occontrol.scheduling.whole.bound import relaxed_prices

LISTED = 200  # targets up to which their costs stand in result.json
SAFETY = 5.0  # discretisation errors by which the check in continuous time may differ
RELATIVE = 1e-6
SMALLEST = 1e-12
MOST_HALVED = 3e7  # blocks times steps


@dataclass(frozen=True)
class _Checked:
    """What the check in continuous time says: the cost of all targets, or why there is none, and what disagrees."""

    cost: float | None
    reason: str
    wrong: str


def assemble(
    problem: TargetsProblem, name: str, task: Task, weights: np.ndarray, error: float, gap: float, began: float
) -> Solution:
    """Certify a policy and collect everything that a run folder holds.

    Parameters
    ----------
    problem : TargetsProblem
    name : of the method
    task : with the relaxation
    weights : (E, 1) policy
    error : estimated |J - J of continuous time|; NaN where nobody has estimated it
    gap : target of the relaxation
    began : stopwatch.seconds() at the start

    Raises SolveFailed where a covariance overflows.
    """
    f, sweep, relaxed = task.filled, task.sweep, task.relaxed
    cost, gradient = sweep.cost_and_gradient(weights)
    by_error, paid = f.by_target(sweep, weights)
    own = f.allowed.bound(cost, weights, gradient)
    of_cost, _ = rounding(f, sweep, weights, cost, gradient)
    _, of_bound = rounding(f, sweep, relaxed.weights, relaxed.cost, relaxed.gradient)
    allowance = max(of_cost, of_bound)
    if not np.isfinite(cost):
        raise SolveFailed(
            "the covariance of a target leaves the range of floating-point numbers\n"
            "  hint: a target that grows and is not looked at for long does that; shorten the horizon"
        )
    relaxed_bound = at_least_zero(max(own, relaxed.lower_bound) - allowance, cost)
    integer_bound = _of_whole_looks(task, weights, of_cost / abs(cost) if cost else 0.0)
    bound = max(relaxed_bound, -np.inf if integer_bound is None else integer_bound)
    certificate = Certificate(cost, bound, max(ALLOWANCE, 2 * allowance / abs(cost)) if cost else 0.0)
    schedule = schedule_of(f, weights)
    task.monitor.report(relaxed.iterations, cost, certificate.lower_bound, stage="check")
    if not np.isfinite(error):
        error = halved(f, weights, cost)
    known = error if np.isfinite(error) else None
    checked = _check(problem, f, schedule, by_error + paid, error, cost)
    status, message = interrupted(task), ""
    if status is Status.CERTIFIED and (name != "relaxed" and name != "schedule") and certificate.relative_gap > gap:
        status = Status.FEASIBLE
    if checked.wrong:
        status, message = Status.DISAGREES, checked.wrong
    top = TopNumbers(cost, certificate.lower_bound, certificate.relative_gap, "grid")
    per_target = {"cost": (by_error + paid).tolist(), "error": by_error.tolist()}
    many = problem.targets > LISTED
    terminal = _terminal(sweep, weights)
    running = float(np.sum(by_error)) - terminal
    numbers = AthansResult(
        name=problem.name, top=top, cost=cost, lower_bound=certificate.lower_bound,
        relative_gap=certificate.relative_gap, allowance=allowance,
        observation_cost=_raw_cost(problem, f, weights), cost_weight=problem.cost_weight, running_cost=running,
        prediction_error=terminal, predicted_mean_square_error=terminal,
        continuous=ContinuousNumbers(checked.cost, None, None, checked.reason), discretisation_error=known,
        relaxed_cost=relaxed.cost, relaxed_lower_bound=relaxed.lower_bound, singular_fraction=None,
        intervals=problem.intervals, readings=None, integration_steps=len(f.steps), integration_error=known,
        added_edges=[], warnings=[], switches=schedule.switches, sweeps=dict(relaxed.sweeps), extra=dict(task.extra),
        schedule=schedule.segments(), bounds={"relaxed": relaxed_bound, "integer": integer_bound},
        proven_optimal=task.whole.proven or None if task.whole is not None else None,
        nodes=task.whole.nodes if task.whole is not None else None,
        blocks=sum(len(group) for group in f.groups), targets=problem.targets,
        per_target=None if many else per_target,
    )  # fmt: skip
    arrays = {
        "times": problem.edges, "edges": problem.edges, "weights": schedule.weights,
        "per_target_cost": by_error + paid, "per_target_error": by_error,
        "prices": _prices(problem, f, relaxed.gradient, task, bound > relaxed_bound),
    }  # fmt: skip
    return make_solution(
        problem=problem, method=name, status=status,
        message=message or _message(problem, status, certificate, error, gap),
        iterations=relaxed.iterations, numbers=numbers, monitor=task.monitor, began=began, arrays=arrays,
        schedule=schedule, certificate=certificate,
    )  # fmt: skip


def schedule_of(filled: Filled, weights: np.ndarray) -> LookSchedule:
    """The looks that weights (E, 1) of a problem stand for."""
    problem, looks, v = filled.problem, filled.looks, weights[:, 0]
    used = np.flatnonzero((looks.target >= 0) & (v > SMALLEST))
    names = tuple(problem.resource_names), tuple(problem.target_names)
    columns = (looks.interval[used], looks.resource[used], looks.target[used], np.minimum(v[used], 1.0))
    return LookSchedule(problem.edges, *columns, *names)


def halved(filled: Filled, weights: np.ndarray, cost: float) -> float:
    """Estimated error of the cost of a policy, `weights` (E, 1): what halving every step changes, and halving again.

    NaN where that would take too much memory.
    """
    from occontrol.families.athans.targets.fill import fill

    if 4 * len(filled.steps) * sum(len(group) for group in filled.groups) > MOST_HALVED:
        return np.nan
    finer = [fill(filled.problem, factor * filled.substeps).sweep().cost(weights) for factor in (2, 4)]
    return max(4 / 3 * abs(finer[0] - cost), 16 / 15 * abs(finer[1] - cost))


def _check(
    problem: TargetsProblem, filled: Filled, schedule: LookSchedule, costs: np.ndarray, error: float, cost: float
) -> _Checked:
    """The costs of targets integrated again by other code."""
    found = continuous_costs(problem, schedule, costs)
    if isinstance(found, str):
        return _Checked(None, f"the check in continuous time did not finish: {found}", "")
    apart = abs(sum(found.values()) - float(np.sum(costs[list(found)])))
    share = sum(abs(c) for c in found.values()) / max(float(np.sum(np.abs(costs))), 1e-300)
    allowed = SAFETY * error + RELATIVE * abs(cost) if np.isfinite(error) else np.inf
    wrong = ""
    if apart > allowed:
        wrong = (
            f"the recursion and the independent integration differ by {apart:.3g}, more than {SAFETY:g} discretisation "
            "errors"
        )
    if len(found) == problem.targets:
        return _Checked(float(sum(found.values())), "the bound holds for schedules that change at these edges", wrong)
    what = f"{len(found)} of {problem.targets} targets were integrated again, {100 * share:.3g} % of the cost"
    return _Checked(None, what, wrong)


def _terminal(sweep: BlockSweep, weights: np.ndarray) -> float:
    """sum_i w_i tr(D Sigma(T) D'), of weights (E, 1)."""
    if not any(np.any(lanes.terminal) for lanes in sweep.lanes):
        return 0.0
    return sweep.without_running().cost(weights)


def _raw_cost(problem: TargetsProblem, filled: Filled, weights: np.ndarray) -> float:
    paid = float(filled.looks.price @ weights[:, 0])
    if problem.cost_weight:
        return paid / problem.cost_weight
    found, v = 0.0, weights[:, 0]
    for g, group in enumerate(problem.groups):
        at = 0
        places = np.concatenate(filled.looks.source[g]) if filled.looks.source[g] else np.zeros(0, dtype=np.int64)
        for looks in group.looks:
            open_ = problem.resources[looks.resource].capacity[looks.interval] > 0
            size = int(np.sum(open_))
            rate = looks.cost[looks.which[open_]] * problem.steps[looks.interval[open_]]
            found += float(rate @ v[places[at : at + size]])
            at += size
    return found


def _of_whole_looks(task: Task, weights: np.ndarray, doubt: float) -> float | None:
    """The bound on whole looks, lowered by what rounding may have done; None where weights (E, 1) share looks out."""
    if task.whole is None or np.any(np.abs(weights - np.round(weights)) > SMALLEST):
        return None
    return task.whole.lowered(doubt)


def _prices(problem: TargetsProblem, f: Filled, gradient: np.ndarray, task: Task, whole: bool) -> np.ndarray:
    """(N, resources) what one more look would save to first order: by whole looks, or by the relaxation."""
    found = np.zeros((problem.intervals, len(problem.resources)))
    allowed = f.allowed
    prices = task.whole.prices if task.whole is not None and whole else relaxed_prices(gradient, allowed)
    found[allowed.interval, f.looks.resource[allowed.starts[:-1]]] = prices
    return found


def _message(problem: TargetsProblem, status: Status, certificate: Certificate, error: float, gap: float) -> str:
    text = f"No schedule that changes at these edges costs less than {rounded_down(certificate.lower_bound, 6)}."
    if status not in (Status.CERTIFIED, Status.FEASIBLE):
        text = f"{status.text} {text}"
    accuracy = problem.integration.target(gap)
    if problem.integration.substeps is None and error > accuracy * abs(certificate.cost):
        reached = error / abs(certificate.cost)
        text += f" The cost is accurate to {reached:.2g} of itself where {accuracy:.2g} was asked for."
    return text

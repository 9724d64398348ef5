"""Off-line schedules in continuous time with a certificate: the family of Athans (1971)."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from occontrol.core.errors import SolveFailed
from occontrol.core.monitor import Monitor
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Solution, Status
from occontrol.families.athans.methods import (
    BestSingle,
    Collocation,
    Greedy,
    HMinimal,
    Random,
    Relaxed,
    RelaxRoundPolish,
    RoundRobin,
)
from occontrol.families.athans.problem import SchedulingProblem

if TYPE_CHECKING:
    from occontrol.core.measurement import Estimate, Measurement
    from occontrol.core.trajectory import Trajectory
    from occontrol.families.athans.certificate import Claims
    from occontrol.families.athans.tradeoff import Front

Problem = SchedulingProblem
METHODS: dict[str, type] = {
    m.name: m for m in (RelaxRoundPolish, HMinimal, Relaxed, Collocation, BestSingle, RoundRobin, Random, Greedy)
}
PARTS = ("observation_cost", "running_cost", "prediction_error", "predicted_mean_square_error")
COMPARE = ["schedule", "relaxed", "hminimal", "greedy", "best-single", "round-robin", "random"]


def solve(problem: SchedulingProblem, method: Any = None, monitor: Monitor | None = None) -> Solution:
    """Solve with one of METHODS and certify the result.

    Parameters
    ----------
    problem : SchedulingProblem
    method : a METHODS value, or None for the problem's own, or the default
    monitor : Monitor

    Returns a Solution whose status is certified, feasible, limit, interrupted or disagrees.
    Raises InfeasibleError when some interval cannot be filled, SolveFailed when nothing usable was found.
    """
    from occontrol.families.athans.balanced import balanced, restored
    from occontrol.families.athans.discretise import discretise, half_predicts
    from occontrol.families.athans.result import assemble
    from occontrol.families.athans.run_method import run_method
    from occontrol.scheduling.sweep import Sweep

    monitor = monitor or Monitor()
    method = method or problem.method or RelaxRoundPolish()
    problem.require_feasible()
    started = time.perf_counter()
    if monitor.time_limit is None and getattr(method, "time_limit", None) is not None:
        monitor.time_limit = monitor.seconds + method.time_limit
    inner, units = balanced(problem)
    halves = half_predicts(inner)
    sweep = Sweep(discretise(inner, halves))
    found = run_method(inner, method, sweep, monitor)
    return restored(assemble(inner, method.name, sweep, halves, found, monitor, started), problem, units)


def certify(problem: SchedulingProblem, schedule: Schedule, claims: Claims | None = None) -> Solution:
    """Cost, lower bound and gap of anybody's schedule, everything recomputed from problem and schedule.

    Parameters
    ----------
    problem : SchedulingProblem
    schedule : Schedule on any edges over the problem's horizon; the grid is refined by its switch times
    claims : what somebody says of it; refuted claims make the status `disagrees`

    Returns a Solution with method "certify"; the bound is the better of the schedule's own and a relaxation's.
    """
    from occontrol.families.athans.balanced import balanced, restored
    from occontrol.families.athans.certificate import false_claims
    from occontrol.families.athans.discretise import discretise, half_predicts
    from occontrol.families.athans.result import assemble
    from occontrol.families.athans.run_method import Found
    from occontrol.scheduling.relaxation import RelaxedOptions, minimise_relaxed
    from occontrol.scheduling.sweep import Sweep

    started = time.perf_counter()
    monitor = Monitor()
    problem, weights = on_common_grid(problem, schedule)
    problem.require_feasible()
    inner, units = balanced(problem)
    halves = half_predicts(inner)
    sweep = Sweep(discretise(inner, halves))
    gap = getattr(problem.method, "relative_gap", 1e-4)
    relaxed = minimise_relaxed(sweep, None, RelaxedOptions(gap), monitor)
    found = Found(weights, relaxed.iterations, relaxed.status, "", relaxed, target=gap)
    solution = restored(assemble(inner, "certify", sweep, halves, found, monitor, started), problem, units)
    if claims is not None and solution.certificate is not None:
        lowest = min(relaxed.cost, solution.certificate.cost)
        continuous = solution.result["continuous"]["cost"]
        refuted = false_claims(claims, solution.certificate.cost, lowest, continuous, parts_of(solution))
        if refuted:
            return dataclasses.replace(solution, status=Status.DISAGREES, message="; ".join(refuted))
    return solution


def parts_of(solution: Solution) -> dict[str, float]:
    """The numbers of a result that follow from problem and schedule alone, by name.

    Parameters
    ----------
    solution : of this family
    """
    result = solution.result
    flat = {name: result.get(name) for name in PARTS}
    continuous = result.get("continuous")
    flat["continuous cost"] = continuous.get("cost") if isinstance(continuous, dict) else None
    return {name: float(value) for name, value in flat.items() if isinstance(value, int | float)}


def claims_of(problem: SchedulingProblem, solution: Solution) -> Claims:
    """What a run says of its schedule, for `certify` to check.

    Parameters
    ----------
    problem, solution : of the run
    """
    from occontrol.families.athans.certificate import Claims

    continuous = solution.result.get("continuous")
    bound = continuous.get("lower_bound") if isinstance(continuous, dict) else None
    cost, lower = (None, None) if solution.certificate is None else (solution.cost, solution.certificate.lower_bound)
    gap = solution.result.get("relative_gap")
    bound, gap = (float(x) if isinstance(x, int | float) else None for x in (bound, gap))
    return Claims(cost, lower, bound, gap, parts_of(solution))


def on_common_grid(problem: SchedulingProblem, schedule: Schedule) -> tuple[SchedulingProblem, np.ndarray]:
    """The problem on the union of its own edges and the schedule's, and the schedule's weights there.

    Parameters
    ----------
    problem : SchedulingProblem
    schedule : Schedule over the same horizon, sensors in any order
    """
    scale = max(1.0, float(np.max(np.abs(problem.edges))))
    extra = schedule.edges[np.min(np.abs(schedule.edges[:, None] - problem.edges[None]), axis=1) > 1e-9 * scale]
    edges = np.sort(np.concatenate([problem.edges, extra]))
    if len(extra):
        problem = dataclasses.replace(problem, edges=edges)
    middle = (edges[1:] + edges[:-1]) / 2
    interval = np.clip(np.searchsorted(schedule.edges, middle, side="right") - 1, 0, len(schedule.weights) - 1)
    order = [schedule.names.index(name) for name in problem.sensors.names]
    return problem, schedule.weights[interval][:, order]


def summarise(problem: SchedulingProblem, solution: Solution) -> list[tuple[str, str]]:
    """The lines that the command line prints after a solve.

    Parameters
    ----------
    problem : SchedulingProblem
    solution : Solution
    """
    result = solution.result
    continuous = result["continuous"]
    return [
        ("method", f"{solution.method}, {solution.iterations} iterations, {solution.seconds:.2f} s"),
        ("cost", f"{result['cost']:.8g}"),
        ("lower bound", f"{result['lower_bound']:.8g}   gap {100 * result['relative_gap']:.3g} %"),
        (
            "continuous",
            f"cost {continuous['cost']:.8g}   bound {continuous['lower_bound']:.8g}   "
            f"gap {100 * continuous['relative_gap']:.3g} %",
        ),
        ("parts", f"observation {result['observation_cost']:.6g} x {result['cost_weight']:g}, "
                  f"running {result['running_cost']:.6g}, prediction {result['prediction_error']:.6g}"),
        ("switches", f"{result['switches']}   singular on {100 * result['singular_fraction']:.3g} % of the horizon"),
    ]  # fmt: skip


def describe(problem: SchedulingProblem) -> list[tuple[str, str]]:
    """What `check` prints: sizes, costs, observability, an estimate of work.

    Parameters
    ----------
    problem : SchedulingProblem
    """
    from occontrol.families.athans.inspection import inspect

    return inspect(problem)


def simulate(problem: SchedulingProblem, solution: Solution, seed: int = 0) -> tuple[list[Measurement], Trajectory]:
    """A true trajectory of the continuous plant and what the scheduled sensors report of it.

    Parameters
    ----------
    problem : SchedulingProblem
    solution : Solution whose schedule is followed
    seed : of the random generator
    """
    from occontrol.families.athans.filter.simulate import simulate as draw

    return draw(problem, _schedule_of(solution), seed)


def run_filter(
    problem: SchedulingProblem, solution: Solution, measurements: Sequence[Measurement], model: str = "split"
) -> Estimate:
    """The matched filter and predictor over a list of measurements.

    Parameters
    ----------
    problem : SchedulingProblem
    solution : Solution whose schedule is followed
    measurements : list of Measurement
    model : "split", whose covariance is the schedule's, or "exact", for coarse grids
    """
    from occontrol.families.athans.filter.kalman_bucy import run_filter as follow

    return follow(problem, _schedule_of(solution), measurements, model)


def _schedule_of(solution: Solution) -> Schedule:
    if solution.schedule is None:
        raise SolveFailed("the solution has no schedule to follow")
    return solution.schedule


def tradeoff(problem: SchedulingProblem, cost_weights: Sequence[float], monitor: Monitor | None = None) -> Front:
    """Observation cost against prediction error over the cost weight alpha.

    Parameters
    ----------
    problem : SchedulingProblem
    cost_weights : values of alpha
    monitor : Monitor
    """
    from occontrol.families.athans.tradeoff import tradeoff as trace

    return trace(problem, cost_weights, monitor)

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
from occontrol.core.scheduling import SchedulingProblem
from occontrol.core.solution import Certificate, Solution, Status
from occontrol.solvers.options import (
    BestSingle,
    Collocation,
    Greedy,
    HMinimal,
    Random,
    Relaxed,
    RelaxRoundPolish,
    RoundRobin,
)

if TYPE_CHECKING:
    from occontrol.core.measurement import Estimate, Measurement
    from occontrol.core.trajectory import Trajectory
    from occontrol.numerics.sweep import Sweep
    from occontrol.solvers.certificate import Claims
    from occontrol.solvers.relaxed import RelaxedOutcome
    from occontrol.solvers.tradeoff import Front

Problem = SchedulingProblem
METHODS: dict[str, type] = {
    m.name: m for m in (RelaxRoundPolish, HMinimal, Relaxed, Collocation, BestSingle, RoundRobin, Random, Greedy)
}
COMPARE = ["schedule", "relaxed", "hminimal", "greedy", "best-single", "round-robin", "random"]


@dataclasses.dataclass
class _Found:
    """What a method hands over for judgement."""

    weights: np.ndarray
    iterations: int
    status: Status
    message: str = ""
    relaxed: RelaxedOutcome | None = None
    bound: float = -np.inf
    extra: dict[str, Any] = dataclasses.field(default_factory=dict)


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
    from occontrol.numerics.discretise import discretise, half_predicts
    from occontrol.numerics.sweep import Sweep

    monitor = monitor or Monitor()
    method = method or problem.method or RelaxRoundPolish()
    problem.require_feasible()
    started = time.perf_counter()
    if monitor.time_limit is None and getattr(method, "time_limit", None) is not None:
        monitor.time_limit = monitor.seconds + method.time_limit
    halves = half_predicts(problem)
    sweep = Sweep(discretise(problem, halves))
    found = _run(problem, method, sweep, monitor)
    return _assemble(problem, method.name, sweep, halves, found, monitor, started)


def _run(problem: SchedulingProblem, method: Any, sweep: Sweep, monitor: Monitor) -> _Found:
    from occontrol.solvers import baselines
    from occontrol.solvers.hminimal import h_minimal, polish
    from occontrol.solvers.relaxed import RelaxedOptions, minimise_relaxed
    from occontrol.solvers.rounding import sum_up_rounding

    r = sweep.recursion
    if isinstance(method, Collocation):
        return _collocate(problem, method, monitor)
    monitor.stage = "relaxation"
    limits = RelaxedOptions(method.relative_gap, getattr(method, "max_iterations", 500))
    relaxed = minimise_relaxed(sweep, None, limits, monitor)
    if isinstance(method, Relaxed):
        return _Found(relaxed.weights, relaxed.iterations, relaxed.status, "", relaxed)
    found = _Found(relaxed.weights, relaxed.iterations, relaxed.status, "", relaxed)
    if isinstance(method, RelaxRoundPolish):
        monitor.stage = "rounding"
        found.weights = sum_up_rounding(relaxed.weights, r.steps, r.upper, r.select)
        if method.polish and not monitor.stop:
            candidates = [found.weights]
            done = [polish(sweep, start, method.polish, monitor) for start in candidates]
            best = min(done, key=lambda o: o.cost)
            found.weights, found.extra["polish_rounds"] = best.weights, best.iterations
            if best.end == "interrupted":
                found.status = Status.INTERRUPTED
    elif isinstance(method, HMinimal):
        starts = {
            "best-single": lambda: baselines.best_single(sweep),
            "round-robin": lambda: baselines.round_robin(r),
            "greedy": lambda: baselines.greedy(r),
            "random": lambda: baselines.random_policy(r),
        }
        if method.start not in starts:
            raise SolveFailed(f"hminimal cannot start from '{method.start}'\n  hint: start: {', '.join(starts)}")
        done = h_minimal(
            sweep, starts[method.start](), method.max_iterations, method.tolerance, method.full_step, monitor
        )
        found.weights, found.iterations, found.bound = done.weights, done.iterations, done.lower_bound
        found.extra["end"] = done.end
        found.message = _END[done.end]
        if done.end == "interrupted":
            found.status = Status.INTERRUPTED
    elif isinstance(method, BestSingle):
        found.weights = baselines.best_single(sweep)
    elif isinstance(method, RoundRobin):
        found.weights = baselines.round_robin(r, method.dwell)
    elif isinstance(method, Random):
        found.weights = baselines.random_policy(r, method.seed)
    elif isinstance(method, Greedy):
        found.weights = baselines.greedy(r)
    return found


_END = {
    "stationary": "The policy minimises the Hamiltonian on every interval.",
    "no-descent": "No partial step lowers the cost; where arcs are singular a switching policy can only chatter.",
    "cycle": "The plain full-step sweep repeats itself; use full_step: false.",
    "limit": "max_iterations came first.",
    "interrupted": "Interrupted; this is the best so far.",
}


def _collocate(problem: SchedulingProblem, method: Collocation, monitor: Monitor) -> _Found:
    from occontrol.solvers.collocation import solve_collocation

    monitor.stage = "collocation"
    raw = solve_collocation(problem, method, monitor)
    found = _Found(raw.weights, raw.iterations, raw.status, raw.message)
    found.extra["collocation_cost"] = float(raw.cost)
    return found


def _assemble(
    problem: SchedulingProblem, name: str, sweep: Sweep, halves: Any, found: _Found, monitor: Monitor, started: float
) -> Solution:
    from occontrol.numerics.discretise import prediction_weight
    from occontrol.numerics.gains import filter_gains
    from occontrol.numerics.sweep import node_path
    from occontrol.solvers.certificate import judge, policy_certificate

    r, v = sweep.recursion, found.weights
    relaxed = found.relaxed
    known = max(found.bound, relaxed.lower_bound if relaxed is not None else -np.inf)
    certificate = policy_certificate(sweep, v, known)
    monitor.report(found.iterations, certificate.cost, certificate.lower_bound, stage="check")
    judged = judge(problem, v, certificate.cost, relaxed.weights if relaxed is not None else None)
    path = node_path(r, halves, v)
    status, message = found.status, found.message
    if isinstance(relaxed, type(None)) and status is Status.CERTIFIED and certificate.relative_gap > 1e-4:
        status = Status.FEASIBLE
    if not judged.agrees:
        status, message = Status.DISAGREES, judged.text
    schedule = Schedule(problem.edges, v, tuple(problem.sensors.names))
    singular = _singular_fraction(sweep, relaxed.weights if relaxed is not None else v, v)
    observation = float(np.vdot(r.cost, v))
    error = float(np.vdot(r.terminal, path.covariance[-1]))
    continuous = judged.certificate
    result: dict[str, Any] = {
        "name": problem.name,
        **certificate.as_dict(),
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
        message=message or _message(status, certificate, singular, schedule),
        iterations=found.iterations,
        seconds=time.perf_counter() - started,
        result=result,
        arrays=arrays,
        schedule=schedule,
        certificate=certificate,
        history=tuple(monitor.history),
        problem=problem,
    )


def _singular_fraction(sweep: Sweep, relaxed: np.ndarray, weights: np.ndarray) -> float:
    """Share of the horizon on singular arcs of the relaxed optimum."""
    from occontrol.solvers.hminimal import polish
    from occontrol.solvers.rounding import singular_intervals, sum_up_rounding

    r = sweep.recursion
    rounded = weights
    if weights is relaxed or not np.array_equal(weights, np.round(weights)):
        rounded = polish(sweep, sum_up_rounding(relaxed, r.steps, r.upper, r.select), 50).weights
    singular = singular_intervals(relaxed, rounded)
    return float(np.sum(r.steps[singular]) / np.sum(r.steps))


def _raw_cost(problem: SchedulingProblem, v: np.ndarray) -> float:
    rates = np.column_stack([s.cost.sample(problem.midpoints)[:, 0, 0] for s in problem.sensors])
    return float(np.sum(rates * problem.steps[:, None] * v))


def _message(status: Status, certificate: Certificate, singular: float, schedule: Schedule) -> str:
    text = f"No schedule on this grid costs less than {certificate.lower_bound:.6g}."
    if singular > 0:
        text += f" Arcs are singular on {100 * singular:.3g} % of the horizon: there"
        text += " the optimum is approached only by fast switching." if schedule.is_integer else " weights are shares."
    return text if status in (Status.CERTIFIED, Status.FEASIBLE) else f"{status.text} {text}"


def certify(problem: SchedulingProblem, schedule: Schedule, claims: Claims | None = None) -> Solution:
    """Cost, lower bound and gap of anybody's schedule, everything recomputed from problem and schedule.

    Parameters
    ----------
    problem : SchedulingProblem
    schedule : Schedule on any edges over the problem's horizon; the grid is refined by its switch times
    claims : what somebody says of it; refuted claims make the status `disagrees`

    Returns a Solution with method "certify"; the bound is the better of the schedule's own and a relaxation's.
    """
    from occontrol.numerics.discretise import discretise, half_predicts
    from occontrol.numerics.sweep import Sweep
    from occontrol.solvers.certificate import false_claims
    from occontrol.solvers.relaxed import RelaxedOptions, minimise_relaxed

    started = time.perf_counter()
    monitor = Monitor()
    problem, weights = on_common_grid(problem, schedule)
    problem.require_feasible()
    halves = half_predicts(problem)
    sweep = Sweep(discretise(problem, halves))
    gap = getattr(problem.method, "relative_gap", 1e-4)
    relaxed = minimise_relaxed(sweep, None, RelaxedOptions(gap), monitor)
    found = _Found(weights, relaxed.iterations, relaxed.status, "", relaxed)
    solution = _assemble(problem, "certify", sweep, halves, found, monitor, started)
    if claims is not None and solution.certificate is not None:
        lowest = min(relaxed.cost, solution.certificate.cost)
        refuted = false_claims(claims, solution.certificate.cost, lowest)
        if refuted:
            return dataclasses.replace(solution, status=Status.DISAGREES, message="; ".join(refuted))
    return solution


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
    from occontrol.solvers.inspection import inspect

    return inspect(problem)


def simulate(problem: SchedulingProblem, solution: Solution, seed: int = 0) -> tuple[list[Measurement], Trajectory]:
    """A true trajectory of the continuous plant and what the scheduled sensors report of it.

    Parameters
    ----------
    problem : SchedulingProblem
    solution : Solution whose schedule is followed
    seed : of the random generator
    """
    from occontrol.filtering.simulate import simulate as draw

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
    from occontrol.filtering.kalman_bucy import run_filter as follow

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
    from occontrol.solvers.tradeoff import tradeoff as trace

    return trace(problem, cost_weights, monitor)

"""One method of the athans family run on one recursion: a policy comes out, not yet judged."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from occontrol.core.errors import SolveFailed
from occontrol.core.monitor import Monitor
from occontrol.core.solution import Status
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
from occontrol.scheduling import baselines
from occontrol.scheduling.hminimal import h_minimal, polish
from occontrol.scheduling.relaxation import RelaxedOptions, RelaxedOutcome, minimise_relaxed
from occontrol.scheduling.rounding import nearest_policy, sum_up_rounding
from occontrol.scheduling.shaking import shake
from occontrol.scheduling.sweep import Sweep

SHAKEN = 4  # sweeps of the shaken polish for each of the relaxation's, which cost more


@dataclass
class Found:
    """What a method hands over for judgement.

    Parameters
    ----------
    weights : (N, M) policy
    iterations : of the method
    status : how it ended
    message : in words, empty where the status says it all
    relaxed : the relaxation whose bound stands beside the policy, if one was run
    bound : a lower bound that the method proved by itself
    proves : whether reaching the relaxation's target is what this method promises
    target : the relative gap that counts as certified otherwise
    extra : further entries of result.json
    """

    weights: np.ndarray
    iterations: int
    status: Status
    message: str = ""
    relaxed: RelaxedOutcome | None = None
    bound: float = -np.inf
    proves: bool = False
    target: float = 1e-4
    extra: dict[str, Any] = field(default_factory=dict)


def run_method(problem: SchedulingProblem, method: Any, sweep: Sweep, monitor: Monitor) -> Found:
    """The policy of one method.

    Parameters
    ----------
    problem : SchedulingProblem
    method : options object, see families/athans/methods.py
    sweep : Sweep on the problem's recursion
    monitor : Monitor

    Raises SolveFailed when nothing usable was found.
    """
    r = sweep.recursion
    if isinstance(method, Collocation):
        return _collocate(problem, method, monitor)
    monitor.stage = "relaxation"
    limits = RelaxedOptions(method.relative_gap, getattr(method, "max_iterations", 500))
    relaxed = minimise_relaxed(sweep, _begin(problem, monitor), limits, monitor)
    message = _STALLED if relaxed.stalled else ""
    if isinstance(method, Relaxed):
        return Found(relaxed.weights, relaxed.iterations, relaxed.status, message, relaxed, proves=True)
    found = Found(relaxed.weights, relaxed.iterations, relaxed.status, message, relaxed, target=method.relative_gap)
    found.proves = isinstance(method, RelaxRoundPolish)
    if isinstance(method, RelaxRoundPolish):
        monitor.stage = "rounding"
        # none of the roundings is the best on every problem, and a polish costs a fraction of the relaxation
        rounded = [sum_up_rounding(relaxed.weights, r.steps, r.upper, r.select, backward=b) for b in (False, True)]
        rounded.append(nearest_policy(relaxed.weights, r.upper, r.select))
        candidates = sorted(rounded, key=sweep.cost)
        found.weights = candidates[0]
        if method.polish and not monitor.stop:
            # without exact exchanges a polish is slow: the best start alone
            exact = sweep.keeps_all and not sweep.dense
            starts = candidates if exact else candidates[:1]
            done = [polish(sweep, start, method.polish, monitor) for start in starts]
            best = min(done, key=lambda o: o.cost)
            if exact and best.end == "stationary":
                enough = relaxed.lower_bound + method.relative_gap * abs(best.cost)
                best = shake(sweep, best, enough, SHAKEN * relaxed.sweeps["gradients"], method.polish, monitor)
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


def _begin(problem: SchedulingProblem, monitor: Monitor) -> np.ndarray | None:
    """(N, M) the relaxed policy of the earlier solution that the monitor brings, or None to begin anew."""
    earlier = monitor.resume
    if earlier is None:
        return None
    weights = earlier.arrays.get("relaxed_weights", earlier.arrays.get("weights"))
    same_grid = earlier.schedule is not None and np.array_equal(earlier.schedule.edges, problem.edges)
    fits = same_grid and weights is not None and weights.shape == problem.upper.shape
    if not fits or not np.all(np.isfinite(weights)):
        return None
    inside = np.all((weights >= 0) & (weights <= problem.upper + 1e-9))
    if not inside or not np.allclose(weights.sum(axis=1), problem.select, atol=1e-6):
        return None
    monitor.resumed = True
    return np.minimum(np.array(weights, dtype=float), problem.upper)


_STALLED = (
    "No step lowers the relaxed cost any more, though the gap is still open: the data span more orders of magnitude "
    "than double precision resolves, for instance where an unstable plant may go unmeasured for long. Shorten the "
    "horizon or demand a measurement where the covariance explodes."
)
_END = {
    "stationary": "The policy minimises the Hamiltonian on every interval.",
    "no-descent": "No partial step lowers the cost; where arcs are singular a switching policy can only chatter.",
    "cycle": "The plain full-step sweep repeats itself; use full_step: false.",
    "limit": "max_iterations came first.",
    "interrupted": "Interrupted; this is the best so far.",
}


def _collocate(problem: SchedulingProblem, method: Collocation, monitor: Monitor) -> Found:
    from occontrol.families.athans.collocation.solve import solve_collocation

    monitor.stage = "collocation"
    raw = solve_collocation(problem, method, monitor)
    found = Found(raw.weights, raw.iterations, raw.status, raw.message, target=method.relative_gap)
    found.extra["collocation_cost"] = float(raw.cost)
    return found

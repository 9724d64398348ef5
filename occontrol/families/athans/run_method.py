"""One method of the athans family run on one recursion: a policy comes out, not yet judged."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
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
from occontrol.families.athans.integration.relaxed import Relaxed as RelaxedFinely
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.scheduling import baselines
from occontrol.scheduling.hminimal import SweepOutcome, h_minimal, polish
from occontrol.scheduling.relaxation import RelaxedOptions, RelaxedOutcome, minimise_relaxed
from occontrol.scheduling.rounding import nearest_policy, sum_up_rounding
from occontrol.scheduling.shaking import shake
from occontrol.scheduling.sweep import Sweep

REPRICED = 4  # times that the prices are corrected for a schedule
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


def run_method(
    problem: SchedulingProblem, method: Any, sweep: Sweep, monitor: Monitor, integrated: RelaxedFinely | None = None
) -> Found:
    """The policy of one method.

    Parameters
    ----------
    problem : SchedulingProblem
    method : options object, see families/athans/methods.py
    sweep : Sweep on the problem's recursion
    monitor : Monitor
    integrated : the relaxation on finer steps, if it was done already; `sweep` then has its corrected prices

    Raises SolveFailed when nothing usable was found.
    """
    r = sweep.recursion
    judge = sweep if integrated is None else integrated.judge
    if isinstance(method, Collocation):
        return _collocate(problem, method, monitor)
    monitor.stage = "relaxation"
    limits = RelaxedOptions(method.relative_gap, getattr(method, "max_iterations", 500))
    relaxed = minimise_relaxed(sweep, None, limits, monitor) if integrated is None else integrated.outcome
    inner = relaxed if integrated is None else integrated.inner
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
            best = min(done, key=lambda o: judge.cost(o.weights)) if judge is not sweep else min(done, key=_cost)
            if exact and best.end == "stationary":
                scale = abs(best.cost if integrated is None else relaxed.cost)
                enough = inner.lower_bound + method.relative_gap * scale
                best = shake(sweep, best, enough, SHAKEN * relaxed.sweeps["gradients"], method.polish, monitor)
            if judge is not sweep:
                best = _polish_again(best, relaxed.cost - inner.cost, judge, method, monitor)
            found.weights, found.extra["polish_rounds"] = best.weights, best.iterations
            if best.end == "interrupted":
                found.status = Status.INTERRUPTED
    elif isinstance(method, HMinimal):
        starts = {
            "best-single": lambda: baselines.best_single(judge),
            "round-robin": lambda: baselines.round_robin(r),
            "greedy": lambda: baselines.greedy(r),
            "random": lambda: baselines.random_policy(r),
        }
        if method.start not in starts:
            raise SolveFailed(f"hminimal cannot start from '{method.start}'\n  hint: start: {', '.join(starts)}")
        done = h_minimal(
            judge, starts[method.start](), method.max_iterations, method.tolerance, method.full_step, monitor
        )
        found.weights, found.iterations, found.bound = done.weights, done.iterations, done.lower_bound
        found.extra["end"] = done.end
        found.message = _END[done.end]
        if done.end == "interrupted":
            found.status = Status.INTERRUPTED
    elif isinstance(method, BestSingle):
        found.weights = baselines.best_single(judge)
    elif isinstance(method, RoundRobin):
        found.weights = baselines.round_robin(r, method.dwell)
    elif isinstance(method, Random):
        found.weights = baselines.random_policy(r, method.seed)
    elif isinstance(method, Greedy):
        found.weights = baselines.greedy(r)
    return found


def _polish_again(
    best: SweepOutcome, offset: float, judge: Any, method: RelaxRoundPolish, monitor: Monitor
) -> SweepOutcome:
    """The policy polished with prices that were corrected for it, where those of the relaxation cost it wrongly."""
    cost = judge.cost(best.weights)
    for _ in range(REPRICED):
        if abs(best.cost + offset - cost) <= method.relative_gap * abs(cost) or monitor.stop:
            break
        sweep = judge.repriced(best.weights)
        found = polish(sweep, best.weights, method.polish, monitor)
        value = judge.cost(found.weights)
        if not value < cost:
            break
        offset, best, cost = cost - sweep.cost(best.weights), replace(found, iterations=best.iterations), value
    return best


def _cost(outcome: SweepOutcome) -> float:
    return outcome.cost


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

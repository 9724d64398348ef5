"""Switch times off the grid: those of a schedule that keeps the rules, moved to where the exact flow wants them.

    dJ/dt_i = s_before(t_i) - s_after(t_i),        s_j = alpha q_j - tr(L_j Sigma P Sigma) along the schedule

The order of sensors stays. What the rules ask of the times is linear in them (uses that are long or short enough, time
in use, windows, slews that last as long as they do), so a sequential quadratic program finds them. The flow is that of
continuous/, not the grid's; what comes out is judged by the rules again, and is taken only where it costs less.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from occontrol.core.schedule import Schedule
from occontrol.families.athans.continuous.reintegration import switching_at_edges
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.families.athans.rules.certify import broken
from occontrol.families.athans.rules.setting import frame_of
from occontrol.scheduling.rules.check import uses
from occontrol.scheduling.rules.rules import Rules

ROUNDS = 60
MARGIN = 1e-10  # of the horizon: what lengths are kept away from their limits by
LEAST = 1e-6  # of the horizon: the shortest segment without a rule about it
BETTER = 1e-12  # of the cost
MOST_TIMES = 200  # switch times


@dataclass(frozen=True, eq=False)
class Moved:
    """A schedule with times of its own.

    Parameters
    ----------
    schedule : Schedule
    before, after : what it costs in continuous time with the old times and with the new ones, changes not counted
    farthest : how far a switch time was moved
    rounds : evaluations of the flow
    """

    schedule: Schedule
    before: float
    after: float
    farthest: float
    rounds: int


def off_grid(problem: SchedulingProblem, schedule: Schedule) -> Moved | None:
    """The schedule with better switch times; None where there are none, or rules are not about lengths alone.

    Parameters
    ----------
    problem : SchedulingProblem whose cost weight is that of what is minimised
    schedule : one that keeps its rules, with whole weights
    """
    rules = frame_of(problem).rules
    if problem.minimise == "observation" or np.any(rules.warm_up > 0):
        return None
    edges, weights = _segments(schedule)
    if not 2 <= len(edges) - 1 <= MOST_TIMES + 1:
        return None
    flow = _Flow(problem, schedule, edges, weights)
    first, _ = flow(edges[1:-1])
    found = _minimised(flow, problem, rules, edges, weights)
    if found is None:
        return None
    times = np.concatenate([edges[:1], found, edges[-1:]])
    if np.any(np.diff(times) <= 0):
        return None
    last, _ = flow(found)
    moved = Schedule(times, weights, schedule.names)
    if not last < first - BETTER * abs(first) or _breaks(problem, moved):
        return None
    return Moved(moved, first, last, float(np.max(np.abs(times - edges))), flow.count)


def _segments(schedule: Schedule) -> tuple[np.ndarray, np.ndarray]:
    """Edges (K+1,) and weights (K, M) of the maximal runs of equal weights."""
    weights = np.asarray(schedule.weights)
    change = np.flatnonzero(np.any(weights[1:] != weights[:-1], axis=1)) + 1
    starts = np.concatenate([[0], change])
    return np.asarray(schedule.edges)[np.append(starts, len(weights))], weights[starts]


def _breaks(problem: SchedulingProblem, schedule: Schedule) -> bool:
    """Whether a schedule breaks a rule or a window, on edges of its own."""
    edges = schedule.common_edges(problem.edges)
    fine = problem.with_edges([(float(t), "") for t in edges[~np.isin(edges, problem.edges)]])
    weights = schedule.on_grid(fine.edges, list(fine.sensors.names), None if fine.slews else fine.select)
    closed = np.any(weights > fine.upper + 1e-9)
    return bool(closed) or bool(broken(frame_of(fine), weights))


class _Flow:
    """Cost and its slope in the inner switch times."""

    def __init__(self, problem: SchedulingProblem, schedule: Schedule, edges: np.ndarray, weights: np.ndarray):
        self.problem, self.names, self.edges, self.weights = problem, schedule.names, edges, weights
        self.order = [list(schedule.names).index(name) for name in problem.sensors.names]
        self.count = 0

    def __call__(self, times: np.ndarray) -> tuple[float, np.ndarray]:
        """J and dJ/dt (K-1,) at inner times (K-1,)."""
        self.count += 1
        edges = np.concatenate([self.edges[:1], times, self.edges[-1:]])
        cost, s = switching_at_edges(self.problem, Schedule(edges, self.weights, self.names))
        used = self.weights[:, self.order]
        return cost, np.sum((used[:-1] - used[1:]) * s[1:-1], axis=1)


def _minimised(
    flow: _Flow, problem: SchedulingProblem, rules: Rules, edges: np.ndarray, weights: np.ndarray
) -> np.ndarray | None:
    """The inner times (K-1,) at which J is least under the rules, or None."""
    from scipy.optimize import minimize

    span, step = float(edges[-1] - edges[0]), float(np.mean(np.diff(problem.edges)))
    start = edges[1:-1]
    A, b = linear_rules(problem, rules, edges, weights)
    C, d = slews(rules, edges, weights)
    cost, slope = flow(start)
    scale = 1.0 / max(step * float(np.max(np.abs(slope), initial=0.0)), 1e-12 * abs(cost), 1e-300)

    # in units of a step from where they are, and of what a step may save
    def value(x: np.ndarray) -> tuple[float, np.ndarray]:
        try:
            J, g = flow(start + step * x)
        except ValueError:  # times that no longer increase
            return 1e10, np.zeros_like(x)
        return scale * (J - cost), scale * step * g

    constraints: list[dict] = []
    if len(A):
        constraints.append({"type": "ineq", "fun": lambda x: (b - A @ (start + step * x)) / step,
                            "jac": lambda x: -A})  # fmt: skip
    if len(C):
        constraints.append({"type": "eq", "fun": lambda x: (C @ (start + step * x) - d) / step, "jac": lambda x: C})
    options = {"maxiter": ROUNDS, "ftol": 1e-10}
    done = minimize(value, np.zeros_like(start), jac=True, method="SLSQP", constraints=constraints, options=options)
    times = start + step * done.x
    if not np.all(np.isfinite(times)):
        return None
    # what the program leaves of a violation is far below what a rule may be off by, but an edge is not: stay inside
    worst = float(np.max(A @ times - b, initial=0.0)) if len(A) else 0.0
    return times if worst <= 1e-9 * span else None


def linear_rules(
    problem: SchedulingProblem, rules: Rules, edges: np.ndarray, weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """A (R, K-1) and b (R,): inner switch times t keep the rules on lengths, times and windows where A t <= b.

    Parameters
    ----------
    problem : SchedulingProblem
    rules : Rules of it
    edges, weights : (K+1,) and (K, M) of the segments
    """
    K, M = weights.shape
    on = weights > 0.5
    if rules.select > 1:
        on = on & ~rules.idle
    span = float(edges[-1] - edges[0])
    margin = MARGIN * span
    rows: list[np.ndarray] = []
    limits: list[float] = []

    def add(coefficients: np.ndarray, limit: float) -> None:
        """coefficients (K+1,) on all edges, of which the first and the last stay."""
        rows.append(coefficients[1:-1])
        limits.append(limit - margin - float(coefficients[0] * edges[0] + coefficients[-1] * edges[-1]))

    def between(a: int, b: int) -> np.ndarray:
        unit = np.zeros(K + 1)
        unit[b], unit[a] = 1.0, -1.0
        return unit

    for k in range(K):
        add(-between(k, k + 1), -LEAST * span)
    for j in range(M):
        runs = uses(on[:, j])
        past = rules.before[1] if rules.before is not None and rules.before[0] == j else 0.0
        for a, b in runs:
            known = past if a == 0 else 0.0
            cut = b == K and not rules.enforce
            if rules.min_on[j] > 0 and not cut:
                add(-between(a, b), known - float(rules.min_on[j]))
            if np.isfinite(rules.max_on[j]):
                add(between(a, b), float(rules.max_on[j]) - known)
        for (_, stop), (start, _) in itertools.pairwise(runs):
            if rules.min_off[j] > 0:
                add(-between(stop, start), -float(rules.min_off[j]))
        total = sum((between(a, b) for a, b in runs), np.zeros(K + 1))
        if np.isfinite(rules.max_time[j]) and runs:
            add(total, float(rules.max_time[j]))
        windows = problem.sensors[j].windows
        for a, b in runs if windows is not None else ():
            # a use stays within the window that it lies in
            inside = [(x, y) for x, y in np.asarray(windows) if x <= edges[a] + margin and edges[b] - margin <= y]
            if inside and a > 0:
                add(-between(0, a), float(edges[0] - inside[0][0]))
            if inside and b < K:
                add(between(0, b), float(inside[0][1] - edges[0]))
    if np.isfinite(rules.max_observation):
        rates = np.array([s.cost.sample(edges[:1])[0, 0, 0] for s in problem.sensors])
        spent = np.zeros(K + 1)
        for k in range(K):
            spent += float(weights[k] @ rates) * between(k, k + 1)
        add(spent, rules.max_observation)
    return np.array(rows).reshape(-1, K - 1), np.array(limits)


def slews(rules: Rules, edges: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """C (S, K-1) and d (S,): segments in which nothing is used last as long as the delay where C t = d.

    Parameters
    ----------
    rules : Rules, whose delays no grid rounds up any more
    edges, weights : (K+1,) and (K, M) of the segments
    """
    old = -1 if rules.before is None else rules.before[0]
    K = len(weights)
    rows, lengths = [], []
    for k in np.flatnonzero(~np.any(weights > 0, axis=1)):
        unit = np.zeros(K + 1)
        unit[k + 1], unit[k] = 1.0, -1.0
        rows.append(unit[1:-1])
        before = int(np.argmax(weights[k - 1])) if k else old
        delay = float(rules.switch_delay[before, int(np.argmax(weights[k + 1]))])
        lengths.append(delay - float(unit[0] * edges[0] + unit[-1] * edges[-1]))
    return np.array(rows).reshape(-1, K - 1), np.array(lengths)

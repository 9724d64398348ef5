"""The trade-off between observation cost and error over the cost weight alpha, every point with a proven bound.

For each alpha the relaxation is solved, started from its neighbour's answer, rounded and polished. A policy found for
one alpha is a policy for all of them, so each alpha finally takes the best of all that were found: observation cost q
then falls and error e rises with alpha, on a convex curve. Every bound L(alpha) holds for every schedule on the grid,
    e >= L(alpha) - alpha q,
so the upper envelope of these lines lies below any point (q, e) that a schedule can reach.
Costs and bounds are those of the recursion with one step an interval, on the edges of the file and of its windows:
`solve` integrates in finer steps, so on a coarse grid its cost of the same schedule differs.
Athans (1971), sections 1 and 8.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from occontrol.core.errors import ProblemError
from occontrol.core.monitor import Monitor
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Status
from occontrol.families.athans.balanced import balanced
from occontrol.families.athans.discretise import discretise, feasible_set, prediction_weight
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.scheduling.hminimal import polish
from occontrol.scheduling.relaxation import RelaxedOptions, minimise_relaxed
from occontrol.scheduling.sweep import Sweep

POLISH_ROUNDS = 200


@dataclass(frozen=True, eq=False)
class Policies:
    """Policies of one kind, one per alpha.

    Parameters
    ----------
    weights : (A, N, M)
    observation_cost : (A,) q, before it is weighted
    error : (A,) e = prediction error + running cost
    cost : (A,) alpha q + e
    """

    weights: np.ndarray
    observation_cost: np.ndarray
    error: np.ndarray
    cost: np.ndarray


@dataclass(frozen=True, eq=False)
class Front:
    """The trade-off of one problem.

    Parameters
    ----------
    problem : SchedulingProblem
    cost_weights : (A,) alpha, increasing
    schedules : Policies, one sensor (or `select` of them) at a time
    relaxed : Policies, shares of time: what ever faster switching comes close to
    lower_bound : (A,) no schedule on the grid has a smaller alpha q + e
    later_noise : what the plant's noise after T adds to the predicted error of every schedule
    status : certified, limit or interrupted
    """

    problem: SchedulingProblem
    cost_weights: np.ndarray
    schedules: Policies
    relaxed: Policies
    lower_bound: np.ndarray
    later_noise: float
    status: Status

    def least_error(self, observation_cost: np.ndarray) -> np.ndarray:
        """The error below which no schedule on the grid of this observation cost comes.

        Parameters
        ----------
        observation_cost : (K,) q

        Returns (K,), not negative.
        """
        q = np.atleast_1d(np.asarray(observation_cost, dtype=float))
        return np.maximum(np.max(self.lower_bound - np.outer(q, self.cost_weights), axis=1), 0.0)

    def as_dict(self) -> dict:
        """The front as plain data, point by point."""
        names = tuple(self.problem.sensors.names)
        points = []
        for i, alpha in enumerate(self.cost_weights):
            schedule = Schedule(self.problem.edges, self.schedules.weights[i], names)
            cost, bound = float(self.schedules.cost[i]), float(self.lower_bound[i])
            points.append(
                {
                    "cost_weight": float(alpha),
                    "observation_cost": float(self.schedules.observation_cost[i]),
                    "error": float(self.schedules.error[i]),
                    "predicted_mean_square_error": float(self.schedules.error[i]) + self.later_noise,
                    "cost": cost,
                    "lower_bound": bound,
                    "relative_gap": (cost - bound) / abs(cost) if cost else 0.0,
                    "relaxed": {
                        "observation_cost": float(self.relaxed.observation_cost[i]),
                        "error": float(self.relaxed.error[i]),
                        "cost": float(self.relaxed.cost[i]),
                    },
                    "switches": schedule.switches,
                    "schedule": schedule.segments(),
                }
            )
        return {
            "family": self.problem.family,
            "name": self.problem.name,
            "status": str(self.status),
            "points": points,
        }


def tradeoff(problem: SchedulingProblem, cost_weights: Sequence[float], monitor: Monitor | None = None) -> Front:
    """The front of observation cost against error over alpha.

    Parameters
    ----------
    problem : SchedulingProblem; its own cost_weight plays no part
    cost_weights : values of alpha > 0, in any order
    monitor : Monitor; interrupted, the points found so far are returned

    Raises InfeasibleError when no schedule exists, ProblemError when no sensor costs anything.
    """
    monitor = (monitor or Monitor()).child()
    problem.require_feasible()
    allowed = feasible_set(problem)
    base = Sweep(discretise(balanced(replace(problem, cost_weight=1.0))[0]))
    rates = base.recursion.cost
    if not np.any(rates * (problem.upper > 0)):
        raise ProblemError("no sensor costs anything: there is nothing to trade", "give the sensors a cost")
    options = RelaxedOptions(getattr(problem.method, "relative_gap", 1e-4))
    status, start = Status.CERTIFIED, None
    done: list[float] = []
    relaxed, schedules, bounds = [], [], []
    for alpha in sorted(set(float(a) for a in cost_weights)):
        monitor.stage = f"alpha {alpha:.3g}"
        sweep = Sweep(base.recursion.with_cost_weight(alpha))
        found = minimise_relaxed(sweep, allowed, start, options, monitor)
        if found.status is Status.INTERRUPTED and done:
            status = Status.INTERRUPTED
            break
        start = found.weights
        rounded = allowed.round(found.weights)
        schedules.append(polish(sweep, allowed, rounded, POLISH_ROUNDS, monitor).weights)
        relaxed.append(found.weights)
        bounds.append(found.lower_bound)
        done.append(alpha)
        if found.status is not Status.CERTIFIED:
            status = found.status
        if monitor.stop:
            break
    alphas = np.array(done)
    best = _best_for_each(base, alphas, relaxed)
    return Front(
        problem,
        alphas,
        _best_for_each(base, alphas, schedules),
        best,
        np.minimum(_concave(alphas, np.array(bounds)), best.cost),
        prediction_weight(problem)[1],
        status,
    )


def _best_for_each(base: Sweep, alphas: np.ndarray, policies: list[np.ndarray]) -> Policies:
    """For each alpha the best of all policies: q falls and e rises along a convex curve, by construction."""
    q = np.array([float(np.vdot(base.recursion.cost, v)) for v in policies])
    e = np.array([base.cost(v) for v in policies]) - q
    table = alphas[:, None] * q + e
    # ties go to the smaller observation cost, so that equal costs do not break the order
    chosen = np.array([min(range(len(q)), key=lambda i, row=row: (row[i], q[i])) for row in table])
    return Policies(np.array(policies)[chosen], q[chosen], e[chosen], table[np.arange(len(alphas)), chosen])


def _concave(alphas: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """The optimal cost is concave in alpha, so what lies on a chord of two bounds is a bound, too."""
    best = bounds.copy()
    for i, a in enumerate(alphas):
        for j in range(i):
            for k in range(i + 1, len(alphas)):
                share = (a - alphas[j]) / (alphas[k] - alphas[j])
                best[i] = max(best[i], (1 - share) * bounds[j] + share * bounds[k])
    return best

"""The trade-off between observation cost and error over the cost weight alpha, every point with a proven bound.

For each alpha the relaxation is solved, started from its neighbour's answer, rounded and polished. A policy found for
one alpha is a policy for all of them, so each alpha finally takes the best of all that were found: observation cost q
then falls and error e rises with alpha, on a convex curve. Every bound L(alpha) holds for every schedule,
    e >= L(alpha) - alpha q,
so the upper envelope of these lines lies below any point (q, e) that a schedule can reach.
Costs and bounds are those that `solve` shows at the top: of continuous time, so the bounds hold whenever a schedule
switches. Edges are those of the file and of its windows; none is added for accuracy, for all alphas share them.
Athans (1971), sections 1 and 8.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from occontrol.core.errors import ProblemError, SolveFailed
from occontrol.core.monitor import Monitor
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Status
from occontrol.families.athans.balanced import balanced
from occontrol.families.athans.certificate import judge
from occontrol.families.athans.discretise import feasible_set, prediction_weight
from occontrol.families.athans.integration.integrator import Integrator
from occontrol.families.athans.integration.path import parts_of
from occontrol.families.athans.integration.relaxed import relax
from occontrol.families.athans.methods import RelaxRoundPolish
from occontrol.families.athans.nonlinear.linearise import linearisation_of
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.scheduling.proof import prove
from occontrol.scheduling.relaxation import RelaxedOptions


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
    lower_bound : (A,) no schedule has a smaller alpha q + e
    later_noise : what the plant's noise after T adds to the predicted error of every schedule
    status : the worst of the points, or interrupted
    of : "continuous" where costs and bounds are those of continuous time, "grid" where that check did not finish for
        some alpha, and bounds hold for changes at the edges only
    """

    problem: SchedulingProblem
    cost_weights: np.ndarray
    schedules: Policies
    relaxed: Policies
    lower_bound: np.ndarray
    later_noise: float
    status: Status
    of: str = "continuous"

    def least_error(self, observation_cost: np.ndarray) -> np.ndarray:
        """The error below which no schedule of this observation cost comes.

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
            make = getattr(self.problem, "make_schedule", None) or partial(Schedule, names=names)
            schedule = make(self.problem.edges, self.schedules.weights[i])
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
            "of": self.of,
            "certificate_of": "problem" if linearisation_of(self.problem) is None else "linearised",
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
    if not any(np.any(s.cost.sample(problem.midpoints)) for s in problem.sensors if s.rows):
        raise ProblemError("no sensor costs anything: there is nothing to trade", "give the sensors a cost")
    inner = balanced(replace(problem, cost_weight=1.0))[0]
    gap = getattr(problem.method, "relative_gap", 1e-4)
    status, start = Status.CERTIFIED, None
    points: list[_Point] = []
    for alpha in sorted(set(float(a) for a in cost_weights)):
        monitor.stage = f"alpha {alpha:.3g}"
        point = _point(replace(inner, cost_weight=alpha), gap, start, monitor)
        if point.status is Status.INTERRUPTED and points:
            status = Status.INTERRUPTED
            break
        points.append(point)
        start = point.relaxed.weights
        if point.status is not Status.CERTIFIED:
            status = point.status
        if monitor.stop:
            break
    alphas = np.array([point.cost_weight for point in points])
    best = _best_for_each(alphas, [point.relaxed for point in points])
    bounds = np.array([point.lower_bound for point in points])
    return Front(
        problem,
        alphas,
        _best_for_each(alphas, [point.schedule for point in points]),
        best,
        np.minimum(concave(alphas, bounds), best.cost),
        prediction_weight(problem)[1],
        status,
        "continuous" if all(point.continuous for point in points) else "grid",
    )


@dataclass(frozen=True, eq=False)
class _Policy:
    """A policy (N, M), its observation cost q before it is weighted, and its error e."""

    weights: np.ndarray
    observation_cost: float
    error: float


@dataclass(frozen=True, eq=False)
class _Point:
    """What was found for one alpha; `continuous` is whether bound and costs are those of continuous time."""

    cost_weight: float
    schedule: _Policy
    relaxed: _Policy
    lower_bound: float
    status: Status
    continuous: bool


def _point(problem: SchedulingProblem, gap: float, start: np.ndarray | None, monitor: Monitor) -> _Point:
    """Relax, round, polish and certify as `solve` does, with no further edge: all alphas share theirs."""
    alpha, allowed = problem.cost_weight, feasible_set(problem)
    integrator = Integrator(problem, gap)
    sweep = relax(integrator, RelaxedOptions(gap), monitor, start)
    found = RelaxRoundPolish(relative_gap=gap).run(problem, sweep, allowed, monitor)
    evaluated, relaxed = (integrator.evaluate(v) for v in (found.weights, sweep.outcome.weights))
    known = [each.judged(integrator.recursion) for each in (evaluated, relaxed)]
    proof = prove(known, allowed, sweep.outcome.lower_bound)
    cost, bound, status, continuous = proof.certificate.cost, proof.certificate.lower_bound, found.status, False
    try:
        judged = judge(problem, evaluated.weights, cost, relaxed.weights, evaluated.error)
    except SolveFailed:  # the numbers on the grid stand all the same
        status = Status.FEASIBLE if status is Status.CERTIFIED else status
    else:
        cost, bound, continuous = judged.certificate.cost, judged.certificate.lower_bound, True
        if not judged.agrees or proof.certificate.contradicts:
            status = Status.DISAGREES
    if status is Status.CERTIFIED and not proof.resolved(gap):
        status = Status.FEASIBLE
    q, shared = (parts_of(integrator, each).observation / alpha for each in (evaluated, relaxed))
    schedule = _Policy(evaluated.weights, q, cost - alpha * q)
    return _Point(
        alpha, schedule, _Policy(relaxed.weights, shared, relaxed.cost - alpha * shared), bound, status, continuous
    )


def _best_for_each(alphas: np.ndarray, policies: list[_Policy]) -> Policies:
    """For each alpha the best of all policies: q falls and e rises along a convex curve, by construction."""
    q = np.array([policy.observation_cost for policy in policies])
    e = np.array([policy.error for policy in policies])
    table = alphas[:, None] * q + e
    # ties go to the smaller observation cost, so that equal costs do not break the order
    chosen = np.array([min(range(len(q)), key=lambda i, row=row: (row[i], q[i])) for row in table])
    weights = np.array([policy.weights for policy in policies])[chosen]
    return Policies(weights, q[chosen], e[chosen], table[np.arange(len(alphas)), chosen])


def concave(alphas: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """The optimal cost is concave in alpha, so what lies on a chord of two bounds is a bound, too.

    `alphas` (K,), `bounds` (K,).
    """
    best = bounds.copy()
    for i, a in enumerate(alphas):
        for j in range(i):
            for k in range(i + 1, len(alphas)):
                share = (a - alphas[j]) / (alphas[k] - alphas[j])
                best[i] = max(best[i], (1 - share) * bounds[j] + share * bounds[k])
    return best

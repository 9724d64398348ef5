"""Cost, lower bound and gap of a policy: of the discretised problem, and independently in continuous time.

Discretised: J(v) - sum_k [v_k.g_k - min_w w.g_k] for any v, so also the relaxation's bound holds for every schedule on
the grid. Continuous: covariance and costate re-integrated by continuous/reintegration.py, which shares no numerics with
the recursion; only that bound holds for all switching times. The two costs must agree within the discretisation error,
which is measured by halving every interval.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from occontrol.core.schedule import Schedule
from occontrol.core.signal import TableSignal
from occontrol.core.solution import Certificate
from occontrol.families.athans.continuous.reintegration import ContinuousCheck, reintegrate
from occontrol.families.athans.discretise import discretise
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.scheduling.sweep import Sweep

SAFETY = 5.0
FEW = 512  # intervals
RELATIVE = 1e-6


def discretisation_error(problem: SchedulingProblem, weights: np.ndarray, cost: float) -> float:
    """Estimated |J(h) - J(0)| of a policy (N, M): the change when every interval is halved, once and once more.

    The scheme is of second order, so the change after p halvings is multiplied by 4^p/(4^p - 1). On a grid too coarse
    for that order a halving may change little by chance: hence the larger of the two, and hence few intervals are
    halved on, until a halving changes less than half of what the one before it did. Where a table jumps within an
    interval the scheme is of first order only and a halving may miss it: such times become edges at the first one.

    Parameters
    ----------
    problem : SchedulingProblem
    weights : (N, M)
    cost : J(h)
    """
    estimate, finer, costs = 0.0, problem, [cost]
    extra = _jumps(problem)
    while len(costs) < 3 or (finer.intervals < FEW and abs(costs[-1] - costs[-2]) > abs(costs[-2] - costs[-3]) / 2):
        finer = replace(finer, edges=np.unique(np.concatenate([finer.edges, finer.midpoints, extra])))
        owner = np.searchsorted(problem.edges, finer.midpoints) - 1
        extra = extra[:0]
        factor = 4 ** len(costs)
        costs.append(Sweep(discretise(finer)).cost(np.ascontiguousarray(weights[owner])))
        estimate = max(estimate, factor / (factor - 1) * abs(costs[-1] - cost))
    return estimate


def _jumps(problem: SchedulingProblem) -> np.ndarray:
    """The times well inside an interval at which a table of the problem jumps."""
    tables = [s for s in problem.signals.values() if isinstance(s, TableSignal) and s.interpolation == "previous"]
    times = np.unique(np.concatenate([np.empty(0), *(table.breakpoints for table in tables)]))
    times = times[(times > problem.edges[0]) & (times < problem.edges[-1])]
    after = np.searchsorted(problem.edges, times)
    near = np.minimum(problem.edges[after] - times, times - problem.edges[after - 1])
    return times[near > 1e-9 * problem.steps[after - 1]]


@dataclass(frozen=True)
class Judgement:
    """The independent check beside the discretised numbers.

    Parameters
    ----------
    continuous : the policy in continuous time
    lower_bound : the best continuous-time bound of all policies that were re-integrated
    discretisation_error : estimated |J(h) - J(0)|
    agrees : whether the two costs lie within 5 times that plus 1e-6 relative
    """

    continuous: ContinuousCheck
    lower_bound: float
    discretisation_error: float
    agrees: bool

    @property
    def certificate(self) -> Certificate:
        """Cost and bound in continuous time."""
        return Certificate(self.continuous.cost, min(self.lower_bound, self.continuous.cost))

    @property
    def text(self) -> str:
        """What the user reads when the check disagrees."""
        return f"the recursion and the independent integration differ by more than {SAFETY:g} discretisation errors"


def judge(problem: SchedulingProblem, weights: np.ndarray, cost: float, relaxed: np.ndarray | None = None) -> Judgement:
    """Re-integrate a policy (and, for its bound, the relaxed one) in continuous time and compare the cost.

    Parameters
    ----------
    problem : SchedulingProblem
    weights : (N, M) policy on the problem's edges
    cost : its J by the recursion
    relaxed : (N, M) the relaxed optimum, whose continuous-time bound is the tighter one
    """
    names = tuple(problem.sensors.names)
    check = reintegrate(problem, Schedule(problem.edges, weights, names))
    bound = check.lower_bound
    if relaxed is not None and relaxed is not weights:
        bound = max(bound, reintegrate(problem, Schedule(problem.edges, relaxed, names)).lower_bound)
    error = discretisation_error(problem, weights, cost)
    allowed = SAFETY * error + RELATIVE * abs(cost) + check.error
    floor = 0.0 if check.cost >= 0 else -np.inf  # a running weight may be slightly below zero
    return Judgement(check, max(bound, floor), error, bool(abs(check.cost - cost) <= allowed))


@dataclass(frozen=True)
class Claims:
    """What somebody says about a policy.

    Parameters
    ----------
    cost : of the discretised problem, or None
    lower_bound : of the discretised problem, or None
    continuous_bound : in continuous time, or None
    relative_gap : (cost - lower_bound) / |cost|, or None
    parts : further numbers by the names that they have in a result, such as prediction_error
    """

    cost: float | None = None
    lower_bound: float | None = None
    continuous_bound: float | None = None
    relative_gap: float | None = None
    parts: Mapping[str, float] = field(default_factory=dict)


def false_claims(
    claims: Claims,
    cost: float,
    lowest_cost: float,
    continuous_cost: float | None = None,
    parts: Mapping[str, float] | None = None,
) -> list[str]:
    """Sentences on every claim that the recomputed numbers refute; empty if none is.

    A claimed bound is refuted when some policy, relaxed or not, costs less than it.

    Parameters
    ----------
    claims : Claims
    cost : recomputed J of the claimed policy
    lowest_cost : the lowest J of any policy known, the relaxed optimum included
    continuous_cost : recomputed J in continuous time, or None
    parts : recomputed numbers by name
    """
    found = []
    if claims.cost is not None and not abs(claims.cost - cost) <= 1e-8 * abs(cost):
        found.append(f"the stated cost is {claims.cost:.10g}, the schedule costs {cost:.10g}")
    if claims.lower_bound is not None and not claims.lower_bound <= lowest_cost + 1e-8 * abs(lowest_cost):
        found.append(
            f"the stated lower bound {claims.lower_bound:.10g} is not one: a known policy costs {lowest_cost:.10g}"
        )
    if None not in (claims.relative_gap, claims.cost, claims.lower_bound):
        gap = Certificate(claims.cost, claims.lower_bound).relative_gap  # type: ignore[arg-type]
        if not abs(claims.relative_gap - gap) <= RELATIVE:  # type: ignore[operator]
            found.append(f"the stated relative gap is {claims.relative_gap:.10g}, its cost and bound give {gap:.10g}")
    bound = claims.continuous_bound
    if bound is not None and continuous_cost is not None and not bound <= continuous_cost + RELATIVE * abs(cost):
        found.append(
            f"the stated continuous lower bound {bound:.10g} is not one: this policy costs {continuous_cost:.10g}"
        )
    for name, value in (parts or {}).items():
        stated = claims.parts.get(name)
        if stated is not None and not abs(stated - value) <= RELATIVE * max(abs(value), abs(cost)):
            found.append(f"the stated {name.replace('_', ' ')} is {stated:.10g}, recomputed {value:.10g}")
    return found

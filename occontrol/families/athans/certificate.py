"""Cost, lower bound and gap of a policy in continuous time, independently of the grid's (scheduling/bounds.py).

Covariance and costate are re-integrated by continuous/reintegration.py, which shares no numerics with the recursion;
only that bound holds for all switching times. The two costs must agree within the discretisation error, which is
measured by halving every interval.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from occontrol.core.clock import nearest_edge
from occontrol.core.schedule import Schedule
from occontrol.core.solution import ALLOWANCE, Certificate
from occontrol.families.athans.continuous.reintegration import ContinuousCheck, reintegrate
from occontrol.families.athans.discretise import discretise
from occontrol.families.athans.integration.edges import jumps
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.scheduling.bounds import at_least_zero
from occontrol.scheduling.sweep import Sweep

SAFETY = 5.0
SMALL_GRID = 512  # intervals
RELATIVE = 1e-6


def discretisation_error(problem: SchedulingProblem, weights: np.ndarray, cost: float) -> float:
    """Estimated |J(h) - J(0)| of a policy (N, M): the change when every interval is halved, once and once more.

    The scheme is of second order, so the change after p halvings is multiplied by 4^p/(4^p - 1). On a grid too coarse
    for that order a halving may change little by chance. So we take the larger of two estimates and, below SMALL_GRID
    intervals, keep halving until the change itself has halved. Where a table jumps within an interval the scheme is of
    first order only, and a halving may miss the jump: such times become edges at the first halving.

    Parameters
    ----------
    problem : SchedulingProblem
    weights : (N, M)
    cost : J(h)
    """
    estimate, finer, costs = 0.0, problem, [cost]
    extra = _jumps(problem)
    while len(costs) < 3 or (
        finer.intervals < SMALL_GRID and abs(costs[-1] - costs[-2]) > abs(costs[-2] - costs[-3]) / 2
    ):
        finer = replace(finer, edges=np.unique(np.concatenate([finer.edges, finer.midpoints, extra])))
        owner = np.searchsorted(problem.edges, finer.midpoints) - 1
        extra = extra[:0]
        factor = 4 ** len(costs)
        costs.append(Sweep(discretise(finer)).cost(np.ascontiguousarray(weights[owner])))
        estimate = max(estimate, factor / (factor - 1) * abs(costs[-1] - cost))
    return estimate


def _jumps(problem: SchedulingProblem) -> np.ndarray:
    """The times well inside an interval at which a table or a formula of the problem jumps."""
    start, end = float(problem.edges[0]), float(problem.edges[-1])
    found = [jumps(signal, start, end) for signal in problem.signals.values()]
    times = np.unique(np.concatenate([np.empty(0), *found]))
    times = times[(times > start) & (times < end)]
    return times[~nearest_edge(times, problem.edges)[1]] if len(times) else times


@dataclass(frozen=True)
class Judgement:
    """The independent check beside the discretised numbers.

    Parameters
    ----------
    continuous : the policy in continuous time
    lower_bound : the best continuous-time bound of all policies that were re-integrated
    discretisation_error : estimated |J(h) - J(0)|
    agrees : whether the two costs lie within 5 times that plus 1e-6 relative, and the bound does not contradict
    """

    continuous: ContinuousCheck
    lower_bound: float
    discretisation_error: float
    agrees: bool

    @property
    def certificate(self) -> Certificate:
        """Cost and bound in continuous time; the allowance is the error that the integration states."""
        cost = self.continuous.cost
        return Certificate(cost, self.lower_bound, max(ALLOWANCE, self.continuous.error / abs(cost)) if cost else 0.0)

    @property
    def text(self) -> str:
        """What the user reads when the check disagrees."""
        differ = f"the recursion and the independent integration differ by more than {SAFETY:g} discretisation errors"
        return self.certificate.text or differ


def judge(
    problem: SchedulingProblem,
    weights: np.ndarray,
    cost: float,
    relaxed: np.ndarray | None = None,
    error: float | None = None,
) -> Judgement:
    """Re-integrate a policy (and, for its bound, the relaxed one) in continuous time and compare the cost.

    Parameters
    ----------
    problem : SchedulingProblem
    weights : (N, M) policy on the problem's edges
    cost : its J by the recursion
    relaxed : (N, M) the relaxed optimum, whose continuous-time bound is the tighter one
    error : estimated |J - J of continuous time|, if it is known already
    """
    names = tuple(problem.sensors.names)
    check = reintegrate(problem, Schedule(problem.edges, weights, names))
    bound = check.lower_bound
    if relaxed is not None and relaxed is not weights:
        bound = max(bound, reintegrate(problem, Schedule(problem.edges, relaxed, names)).lower_bound)
    if error is None or not np.isfinite(error):
        error = discretisation_error(problem, weights, cost)
    allowed = SAFETY * error + RELATIVE * abs(cost) + check.error
    judged = Judgement(check, at_least_zero(bound, check.cost), error, bool(abs(check.cost - cost) <= allowed))
    return replace(judged, agrees=judged.agrees and not judged.certificate.contradicts)

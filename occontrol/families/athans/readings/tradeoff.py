"""The trade-off between observation cost and error over alpha for readings; see tradeoff.py of the family."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from occontrol.core.errors import ProblemError
from occontrol.core.monitor import Monitor
from occontrol.core.solution import Solution, Status
from occontrol.families.athans.methods import RelaxRoundPolish
from occontrol.families.athans.readings.fill import fill
from occontrol.families.athans.readings.problem import ReadingsProblem
from occontrol.families.athans.readings.solve import solve
from occontrol.families.athans.tradeoff import Front, Policies, concave
from occontrol.scheduling.sweep import Sweep


def tradeoff(problem: ReadingsProblem, cost_weights: Sequence[float], monitor: Monitor | None = None) -> Front:
    """The front of observation cost against error over alpha, every point with the bound that a solve proves.

    Parameters
    ----------
    problem : ReadingsProblem; its own cost_weight plays no part
    cost_weights : values of alpha > 0, in any order
    monitor : Monitor; interrupted, the points found so far are returned

    Raises InfeasibleError when no schedule exists, ProblemError when no reading costs anything.
    """
    monitor = (monitor or Monitor()).child()
    problem.require_feasible()
    unit = replace_weight(problem, 1.0)
    filled = fill(unit)
    if not np.any(filled.recursion.decision_cost * (problem.upper > 0)):
        raise ProblemError("no reading costs anything: there is nothing to trade", "give the sensors a cost")
    method = problem.method if isinstance(problem.method, RelaxRoundPolish) else RelaxRoundPolish()
    found: list[Solution] = []
    done: list[float] = []
    for alpha in sorted({float(a) for a in cost_weights}):
        monitor.stage = f"alpha {alpha:.3g}"
        solution = solve(replace_weight(problem, alpha), method, monitor)
        if solution.status is Status.INTERRUPTED and done:
            break
        found.append(solution)
        done.append(alpha)
        if monitor.stop:
            break
    alphas, sweep = np.array(done), Sweep(filled.recursion)
    first = np.flatnonzero(np.diff(problem.clock.owner, prepend=-1))
    schedules = [s.arrays["weights"][first] for s in found]
    relaxed = [s.arrays["relaxed_weights"][first] for s in found]
    statuses = [s.status for s in found if s.status not in (Status.CERTIFIED, Status.FEASIBLE)]
    if monitor.interrupted:
        statuses = [Status.INTERRUPTED]
    bounds = np.array([s.certificate.lower_bound for s in found if s.certificate is not None])
    split = _best(problem, sweep, filled.constant, alphas, relaxed)
    whole = _best(problem, sweep, filled.constant, alphas, schedules)
    return Front(
        problem,  # type: ignore[arg-type]
        alphas,
        whole,
        split,
        np.minimum(concave(alphas, bounds), whole.cost),
        filled.after,
        statuses[0] if statuses else Status.CERTIFIED,
        "problem",
    )


def replace_weight(problem: ReadingsProblem, cost_weight: float) -> ReadingsProblem:
    """The problem with another alpha."""
    found = replace(problem, cost_weight=cost_weight)
    object.__setattr__(found, "listed", problem.listed)  # the idle of a range is not the user's
    return found


def _best(
    problem: ReadingsProblem, sweep: Sweep, constant: float, alphas: np.ndarray, policies: list[np.ndarray]
) -> Policies:
    """For each alpha the best of all policies, ties to the smaller observation cost."""
    q = np.array([float(np.vdot(sweep.recursion.decision_cost, v)) for v in policies])
    e = np.array([sweep.cost(v) for v in policies]) - q + constant
    table = alphas[:, None] * q + e
    chosen = np.array([min(range(len(q)), key=lambda i, row=row: (row[i], q[i])) for row in table])
    rows = np.array(policies)[chosen][:, problem.clock.owner]
    return Policies(rows, q[chosen], e[chosen], table[np.arange(len(alphas)), chosen])

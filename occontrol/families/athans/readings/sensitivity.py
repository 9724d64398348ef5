"""What prices and noises of readings are worth at the relaxed optimum, see families/athans/sensitivity.py."""

from __future__ import annotations

from occontrol.core.errors import UsageError
from occontrol.core.monitor import Monitor
from occontrol.core.solution import Solution
from occontrol.families.athans.readings.assembly import judged_policy, raised
from occontrol.families.athans.readings.fill import feasible_set, fill
from occontrol.families.athans.readings.problem import ReadingsProblem
from occontrol.families.athans.sensitivity import GAP, MOST_STEPS, Sensitivities, Use
from occontrol.scheduling.budget import BudgetSet
from occontrol.scheduling.proof import prove
from occontrol.scheduling.relaxation import RelaxedOptions, minimise_relaxed
from occontrol.scheduling.sweep import Sweep


def sensitivity(problem: ReadingsProblem, solution: Solution | None, monitor: Monitor) -> Sensitivities:
    """Derivatives of the relaxed optimum of a problem of readings; `time` counts readings.

    Parameters
    ----------
    problem : without rules and exact numbers
    solution : of it, whose relaxed policy is the start; None where there is none
    monitor : Monitor

    Raises UsageError for problems with rules or a budget, InfeasibleError where no schedule exists.
    """
    problem.require_feasible()
    filled, allowed = fill(problem), feasible_set(problem)
    if problem.ruled or isinstance(allowed, BudgetSet):
        hint = "leave them out: what they cost is the difference of the two bounds"
        raise UsageError(f"sensitivities are those of a problem without rules and budgets\n  hint: {hint}")
    sweep = Sweep(filled.recursion)
    start = None if solution is None else solution.arrays.get("relaxed_weights")
    if start is not None and start.shape != allowed.shape:
        start = None
    monitor.stage = "relaxation"
    found = minimise_relaxed(sweep, allowed, start, RelaxedOptions(GAP, MOST_STEPS), monitor)
    at, r = judged_policy(sweep, found.weights), filled.recursion
    use = Use(r.lengths, allowed.upper, found.weights, at.gradient, r.decision_cost)
    top = raised(prove([at], allowed, found.lower_bound), filled.constant).certificate
    return Sensitivities(
        name=problem.name,
        cost=top.cost,
        lower_bound=top.lower_bound,
        sensors={s.name: use.of(j, problem.cost_weight) for j, s in enumerate(problem.sensors) if s.rows},
        windows=[],
        select={"value": allowed.select, "one_more": None},
    )

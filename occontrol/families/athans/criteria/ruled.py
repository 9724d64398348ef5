"""A criterion beside rules on schedules, on any clock: the search for rules works on a convex function below it.

With a limit of the peak the search is for the least peak first: where that lies above the limit nothing keeps both, and
otherwise its schedule is where the search for the cheapest one begins.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from occontrol.core.method import Method
from occontrol.core.monitor import Monitor
from occontrol.families.athans.criteria.limit import relaxed_below, require_reachable, unpriced, unreachable
from occontrol.families.athans.criteria.search import PAYS, hunt, relax, require_method, swept
from occontrol.families.athans.found import STEPS_FOR_BOUND
from occontrol.families.athans.methods import Exact, RelaxRoundPolish
from occontrol.families.athans.rules.diagnosis import blamed, refusal
from occontrol.families.athans.rules.frame import Frame
from occontrol.families.athans.rules.search import FIRST, MOVES, NODES, NONE, Work, searched
from occontrol.scheduling.criterion_sweep import LEAST_SHARE, CriterionObjective
from occontrol.scheduling.feasible_set import IntervalPolytopes
from occontrol.scheduling.peak import PeakSweep
from occontrol.scheduling.relaxation import RelaxedOutcome
from occontrol.scheduling.rules.model import KEEPS, CriterionModel
from occontrol.scheduling.rules.plan import Plan
from occontrol.scheduling.rules.task import Goal, Task
from occontrol.scheduling.rules.tree import TreeOptions

FINE = 0.1  # times LEAST_SHARE: what smoothing may cost a search that is to be exact
ROOM = 1e-3  # of what all readings may cost: beside a limit the cost may be 0
SECONDS = 20.0  # for the least peak
STEEPER = 4.0  # times the price of a limit without rules, which rules make harder to keep


@dataclass(frozen=True, eq=False)
class Begun:
    """A task with its criterion, and what is known of it.

    Parameters
    ----------
    task : Task whose sweep is a CriterionModel
    relaxed : the relaxation without rules
    seeds : (N, M) of what is on in schedules to begin with
    """

    task: Task
    relaxed: RelaxedOutcome
    seeds: list[np.ndarray]


def begun(
    objective: CriterionObjective,
    limit: float | None,
    task: Task,
    frame: Frame,
    allowed: IntervalPolytopes,
    method: Method,
    monitor: Monitor,
) -> Begun:
    """A task of traces turned into one of a criterion.

    Parameters
    ----------
    objective : the true one, on the columns of the sensors
    limit : of the peak, or None
    task : of the rules, whose sweep has the columns that are searched
    frame : of the problem
    allowed : IntervalPolytopes without rules
    method : of the family
    monitor : Monitor

    Raises InfeasibleError where no schedule that keeps the rules keeps the limit.
    """
    method = require_method(method, False)
    steps, share = getattr(method, "max_iterations", STEPS_FOR_BOUND), LEAST_SHARE
    if isinstance(method, RelaxRoundPolish) and method.exact_options is not None:
        share *= FINE
    on = swept(objective).on(task.sweep.recursion)
    if limit is None or not isinstance(objective, PeakSweep) or not isinstance(on, PeakSweep):
        relaxed, _ = relax(objective, allowed, monitor, method.relative_gap, steps)
        objective.cost(relaxed.weights)
        lost = share * abs(objective.criterion_value)
        return Begun(replace(task, sweep=CriterionModel(on, lost)), relaxed, [])
    free = unpriced(objective)
    peak, _ = relax(free, allowed, monitor, PAYS, steps)
    require_reachable(limit, peak.lower_bound)
    seeds = [plan.on for plan in _least_peak(free, limit, peak, task, frame, allowed, monitor)]
    capped, relaxed, _ = relaxed_below(objective, limit, allowed, peak.weights, method, monitor)
    most = float(np.sum(np.max(task.price, axis=1, initial=0.0)))
    lost = max(share * relaxed.cost, share * ROOM * most, share * 1e-6 * limit)
    return Begun(replace(task, sweep=CriterionModel(on, lost, limit, STEEPER * capped.penalty)), relaxed, seeds)


def _least_peak(
    free: PeakSweep,
    limit: float,
    relaxed: RelaxedOutcome,
    task: Task,
    frame: Frame,
    allowed: IntervalPolytopes,
    monitor: Monitor,
) -> list[Plan]:
    """A schedule that keeps rules and limit, if one is met; InfeasibleError where none does."""
    monitor.stage = "least peak"
    rules = replace(task.rules, switch_cost=np.zeros_like(task.rules.switch_cost), start_cost=0.0)
    r = task.sweep.recursion
    nothing = np.zeros((0, r.states, r.states))
    on = free.on(replace(r, cost=np.zeros_like(r.cost), running=nothing, charge=None))
    free.cost(relaxed.weights)
    for nodes in (NODES, Exact().max_nodes):
        lost = LEAST_SHARE * (1.0 if nodes == NODES else FINE) * free.criterion_value
        of_peak = replace(
            task, rules=rules, oracle=frame.oracle(rules), sweep=CriterionModel(on, lost), goal=Goal(1.0, 1.0)
        )
        options = TreeOptions(Exact().relative_gap, nodes, MOVES, FIRST)
        _, tree = searched(of_peak, relaxed, options, monitor.child(SECONDS), [])
        if tree.best is None and tree.complete and np.isinf(tree.lower_bound):
            raise refusal(NONE, blamed(frame, task.rules))
        if tree.lower_bound > limit * (1 + KEEPS):
            raise unreachable(limit, tree.lower_bound, None if tree.best is None else tree.best.value, True)
        if monitor.stop or (tree.best is not None and tree.best.value <= limit * (1 + KEEPS)):
            break
    return [] if tree.best is None else [tree.best.plan]


def work_of(
    begin: Begun,
    objective: CriterionObjective,
    frame: Frame,
    allowed: IntervalPolytopes,
    monitor: Monitor,
) -> Work:
    """The solve of a task with a criterion.

    Parameters
    ----------
    begin : from `begun`
    objective : as there
    frame : of the problem
    allowed : IntervalPolytopes without rules
    monitor : Monitor
    """

    def policy(method: Method) -> tuple[np.ndarray, str]:
        found = hunt(objective, allowed, method, monitor.child(silent=True)).found
        return found.weights, found.message

    known = begin.seeds[0] if begin.seeds else None
    return Work(begin.task, frame, None, allowed, begin.relaxed, monitor, known, policy)

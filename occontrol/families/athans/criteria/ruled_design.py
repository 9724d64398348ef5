"""Rules on schedules without a prior, on any clock: the search for rules beside a prior that tells next to nothing.

With information F_0 > 0 at the start, so little that J falls by a share of 1e-8, J is finite for every schedule and
lies below the true one: whatever bounds it bounds the true J. Schedules are weighed by the true J, which is infinite
where a direction is not seen.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from occontrol.core.errors import InfeasibleError, SolveFailed
from occontrol.core.kinds import PlainDict
from occontrol.core.method import Method
from occontrol.core.monitor import Monitor
from occontrol.families.athans.criteria.design_search import hunt_design, relax_design
from occontrol.families.athans.criteria.ruled import FINE
from occontrol.families.athans.criteria.search import require_method
from occontrol.families.athans.found import STEPS_FOR_BOUND, Found
from occontrol.families.athans.methods import RelaxRoundPolish
from occontrol.families.athans.rules.binding import active_rules, multipliers_of
from occontrol.families.athans.rules.columns import user_weights, with_warming
from occontrol.families.athans.rules.frame import Frame
from occontrol.families.athans.rules.search import Outcome, Work, run, searched
from occontrol.families.athans.rules.setting import GOALS
from occontrol.scheduling.criterion_sweep import LEAST_SHARE
from occontrol.scheduling.feasible_set import IntervalPolytopes
from occontrol.scheduling.information import InformationObjective
from occontrol.scheduling.proof import Proof
from occontrol.scheduling.rules.check import changes, switching_cost
from occontrol.scheduling.rules.model import CriterionModel
from occontrol.scheduling.rules.plan import Plan
from occontrol.scheduling.rules.proof import Claim, prove_under_rules
from occontrol.scheduling.rules.task import Task
from occontrol.scheduling.rules.tree import TreeOptions

VAGUE, LEAST_VAGUE = 1e-8, 1e-12  # of the information of the relaxed policy
UNDETERMINED = "no schedule that keeps the rules was found to determine every state that the outputs need"
LOWERED = 1e-8  # of the criterion: what the vague prior may take from it


@dataclass(frozen=True, eq=False)
class RuledDesign:
    """A schedule under rules without a prior, found or judged.

    Parameters
    ----------
    task : Task that was searched
    outcome : of the search
    proof : of the outcome
    known : the cost of the best schedule that was met
    """

    task: Task
    outcome: Outcome
    proof: Proof
    known: float

    def handed(self, ruled: bool) -> Handed:
        """What a solution is put together from.

        Parameters
        ----------
        ruled : whether the problem states rules, which are then reported
        """
        task, outcome = self.task, self.outcome
        rules, plan = task.rules, outcome.plan
        status, proven = outcome.concluded(self.proof)
        on = user_weights(plan.on, rules) if plan is not None else np.asarray(outcome.on)
        measuring = np.ascontiguousarray(outcome.weights[:, : rules.sensors])
        switching = outcome.switching if plan is None else switching_cost(rules, plan.on)
        found = Found(measuring, outcome.nodes, status, outcome.message, outcome.relaxed, target=outcome.target)
        found.proves, found.extra = True, dict(outcome.extra)
        further: PlainDict = {"switching_cost": switching, "proven_optimal": proven, "nodes": outcome.nodes}
        if plan is not None:
            further["switches"] = len(changes(rules, plan.on))
        if ruled:
            further["constraints"] = {"satisfied": True, "active": active_rules(task, plan, 0.0)}
            further["multipliers"] = multipliers_of(task, outcome.rows, outcome.root)
        return Handed(found, on, measuring, switching, further, proven)


@dataclass(frozen=True, eq=False)
class Handed:
    """A schedule under rules without a prior, as a solution needs it.

    Parameters
    ----------
    found : policy, status and relaxation
    on, measuring : (N, M) what is in use, and what of it measures
    switching : what changes cost
    further : entries of AthansResult
    proven : whether the schedule is proven optimal
    """

    found: Found
    on: np.ndarray
    measuring: np.ndarray
    switching: float
    further: PlainDict
    proven: bool


def vague_information(objective: InformationObjective, weights: np.ndarray) -> np.ndarray:
    """(n, n) information that lowers J at a policy by next to nothing.

    Parameters
    ----------
    objective : the true one
    weights : (N, M) that sees every direction
    """
    F = np.tensordot(weights.ravel(), objective.design.information, 1)
    J, share = objective.cost(weights), VAGUE
    size = 1.0 if objective.signed else abs(objective.criterion_value)
    while True:
        prior = share * np.diag(np.diagonal(F))
        if J - objective.with_prior(prior).cost(weights) <= LOWERED * size or share <= LEAST_VAGUE:
            return prior
        share *= 0.1


def search_design(
    objective: InformationObjective,
    frame: Frame,
    minimise: str,
    allowed: IntervalPolytopes,
    method: Method,
    monitor: Monitor,
    given: np.ndarray | None = None,
) -> RuledDesign:
    """What a method finds under rules without a prior, or what a given schedule is.

    Parameters
    ----------
    objective : the true one, on the columns of the sensors
    frame : of the problem
    minimise : "cost" or "error"
    allowed : IntervalPolytopes without rules
    method : of the family
    monitor : Monitor
    given : (N, M) what is on in a schedule to be judged, or None

    Raises InfeasibleError where no schedule that keeps the rules sees what the outputs need, SolveFailed where the
    errors of the outputs depend on one another but for rounding.
    """
    own = require_method(method, False)
    steps, share = getattr(method, "max_iterations", STEPS_FOR_BOUND), LEAST_SHARE
    if isinstance(method, RelaxRoundPolish) and method.exact_options is not None:
        share *= FINE
    relaxed, _ = relax_design(objective, allowed, monitor, own.relative_gap, steps)
    objective.cost(relaxed.weights)
    rules = frame.rules
    recursion = with_warming(objective.recursion, np.flatnonzero(rules.warm_up > 0))
    model = CriterionModel(
        objective.on(recursion), share * abs(objective.criterion_value),
        vague=vague_information(objective, relaxed.weights),
    )  # fmt: skip
    task = Task(rules, frame.edges, frame.oracle(), model, frame.spend, GOALS[minimise])

    def policy(other: Method) -> tuple[np.ndarray, str]:
        found = hunt_design(objective, allowed, other, monitor.child(silent=True)).found
        return found.weights, found.message

    work = Work(task, frame, None, allowed, relaxed, monitor, None, policy)
    if given is None:
        try:
            outcome = run(work, method)
        except ValueError as error:
            raise SolveFailed(f"{error}\n  hint: an initial covariance, or another criterion") from error
        known = np.inf if outcome.plan is None else task.value(outcome.plan)
    else:
        plan = task.oracle.follow(given)
        if plan is None or not np.isfinite(task.value(plan)):
            raise InfeasibleError("the schedule leaves a direction of the states unseen: its cost is infinite")
        outcome, known = _judged(work, plan, own.relative_gap)
    claim = Claim(outcome.plan, outcome.weights, outcome.switching, outcome.lower_bound, outcome.root.proof)
    proof = prove_under_rules(task, outcome.rows, claim)
    if not np.isfinite(proof.certificate.cost):  # singular but for rounding
        raise InfeasibleError(f"{UNDETERMINED}\n  hint: rules that leave room for more, or an initial covariance")
    return RuledDesign(task, outcome, proof, known)


def _judged(work: Work, plan: Plan, gap: float) -> tuple[Outcome, float]:
    """What a given plan is, and the cost of the best one that was met beside it."""
    options = TreeOptions(most=1, moves=0)
    search, tree = searched(work.task, work.relaxed, options, work.monitor, [plan], work.allowed)
    found = Outcome(plan, plan.weights, plan.switching, tree.lower_bound, tree.root, search.rows, tree.nodes)
    found = replace(found, relaxed=work.relaxed, status=work.relaxed.status, target=gap)
    return found, np.inf if search.best is None else search.best.value

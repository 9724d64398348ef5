"""Plans on the way under rules: every schedule that begins with what was done, through the search that has no past.

The oracle of the whole horizon is asked with its first decisions pinned to what was done. So a use that is going on
must still last as long as it owes, and changes, uses, times, duty windows and budgets count from the start.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from occontrol.core.errors import UsageError
from occontrol.core.monitor import Monitor
from occontrol.families.athans.readings.problem import ReadingsProblem
from occontrol.families.athans.readings.rules import frame_of
from occontrol.families.athans.replanning.rest import behind
from occontrol.families.athans.rules.columns import on_of, user_weights, with_warming
from occontrol.families.athans.rules.search import nearest, searched
from occontrol.families.athans.rules.setting import GOALS
from occontrol.scheduling.feasible_set import IntervalPolytopes
from occontrol.scheduling.recursion import Recursion
from occontrol.scheduling.relaxation import RelaxedOutcome
from occontrol.scheduling.rules.check import switching_cost
from occontrol.scheduling.rules.task import Task
from occontrol.scheduling.rules.tree import TreeOptions
from occontrol.scheduling.sweep import Sweep

NODES, FIRST = 4, 20  # of a plan's tree; those in which a first schedule must be found
MOVES = 200  # evaluations of block moves on every better plan


class RulesOnTheWay:
    """The rules of a problem of readings, for plans that begin with what was done.

    Parameters
    ----------
    problem : ReadingsProblem with rules, E decisions and M sensors

    Raises UsageError for a cap on the error.
    """

    def __init__(self, problem: ReadingsProblem):
        self.frame = frame_of(problem)
        if np.isfinite(self.frame.rules.max_error):
            what = "max_error is a promise made before anything is read; plans on the way do not keep it"
            raise UsageError(f"{what}\n  hint: minimise: cost, with a larger output or running weight")
        self.oracle, self.goal = self.frame.oracle(), GOALS[problem.minimise]
        self.spend = self.frame.spend
        self.warmers = np.flatnonzero(self.frame.rules.warm_up > 0)

    def measuring(self, weights: np.ndarray) -> np.ndarray:
        """(E, M) what measures along a schedule, `weights` (E, M) of what is on."""
        if not len(self.warmers):
            return weights
        plan = self.oracle.follow(on_of(weights, self.frame.rules))
        return weights if plan is None else plan.weights[:, : weights.shape[1]]

    def spent(self, earlier: RulesOnTheWay, owner: np.ndarray, k: int) -> None:
        """Count what was spent before reading k at the prices that held then.

        Parameters
        ----------
        earlier : the rules until now
        owner : (N,) the decision of every reading
        k : the next reading
        """
        first = int(owner[k]) if k < len(owner) else int(owner[-1]) + 1
        self.spend = np.concatenate([earlier.spend[:first], self.spend[first:]])

    def searched(
        self,
        rest: Recursion,
        k: int,
        owner: np.ndarray,
        upper: np.ndarray,
        old: np.ndarray,
        relaxed: RelaxedOutcome,
        gap: float,
        monitor: Monitor,
    ) -> tuple[np.ndarray, np.ndarray, float, float] | None:
        """What is on and what measures in D decisions to come, their cost and its bound; None: there is no schedule.

        Parameters
        ----------
        rest : of the readings from k on
        k : the next reading
        owner : (N,) the decision of every reading
        upper : (D, M) what is open in the decisions to come
        old : (E, M) the plan so far; its decisions before k are done
        relaxed : the relaxation of the rest without rules
        gap : relative
        monitor : Monitor
        """
        rules, first, M = self.frame.rules, int(owner[k]), old.shape[1]
        whole = np.concatenate([np.ones((first, M)), upper])
        on = on_of(old, rules)
        oracle = self.oracle.after(on[:first], whole)
        recursion = with_warming(behind(rest, k, owner, whole), self.warmers)
        task = Task(rules, self.frame.edges, oracle, Sweep(recursion), self.spend, self.goal)
        done, empty = old[:first].copy(), ~np.any(on[:first], axis=1)
        done[empty] = 1.0 / M  # on the way from one sensor to another
        start = replace(relaxed, weights=np.concatenate([done, relaxed.weights]))
        past = np.where(empty[:, None], 1.0, np.maximum(done, 0.0))
        allowed = IntervalPolytopes(np.concatenate([past, upper]), rules.select, None, rules.names)
        rounded = np.concatenate([old[:first], np.round(relaxed.weights)])
        seeds = [plan for plan in (oracle.follow(on), nearest(task, rounded)) if plan is not None]
        _, tree = searched(task, start, TreeOptions(gap, NODES, MOVES, FIRST), monitor, seeds, allowed)
        if tree.best is None:
            return None
        plan, paid = tree.best.plan, switching_cost(rules, on[:first]) if first else 0.0
        weights = user_weights(plan.on, rules)
        return weights[first:], plan.weights[first:, :M], tree.best.value - paid, tree.lower_bound - paid


def changes_price(problem: ReadingsProblem, on: np.ndarray) -> np.ndarray:
    """(B,) what the changes of B runs cost.

    Parameters
    ----------
    problem : ReadingsProblem
    on : (B, N, M) whether a sensor is in use
    """
    if problem.rules is None or not problem.rules.switch_cost:
        return np.zeros(len(on))
    rules, first = frame_of(problem).rules, problem.first_readings
    return np.array([switching_cost(rules, on_of(own[first].astype(float), rules)) for own in on])

"""A cap on the observation cost or on the error, and the task that has a price in its place.

F + nu u,       u the observation cost or the error of a schedule
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from occontrol.scheduling.rules.task import Goal, Task
from occontrol.scheduling.sweep import Sweep

CAPS = ("max_observation", "max_error")


def cap_of(task: Task) -> str | None:
    """The one cap of a task by its name in Rules; None where there is none, or both.

    Parameters
    ----------
    task : Task
    """
    found = [name for name in CAPS if np.isfinite(getattr(task.rules, name))]
    return found[0] if len(found) == 1 else None


def only_cap(task: Task) -> bool:
    """Whether a task has one cap and no other rule, and changes cost nothing: intervals are then on their own.

    Parameters
    ----------
    task : Task
    """
    cap = cap_of(task)
    return cap is not None and [rule for rule, _ in task.rules.stated()] == [cap] and not task.rules.costs_changes()


def spend_of_columns(task: Task) -> np.ndarray:
    """(N, C) the observation cost of the recursion's columns: a sensor that warms up is paid for as well.

    Parameters
    ----------
    task : Task
    """
    warmers = np.flatnonzero(task.rules.warm_up > 0)
    return np.concatenate([task.spend, task.spend[:, warmers]], axis=1)


def priced(task: Task, cap: str, price: float) -> Task:
    """The task without its cap, whose F is F + price u of the task.

    Parameters
    ----------
    task : Task
    cap : "max_observation" or "max_error"
    price : nu >= 0, per unit of u
    """
    r, goal = task.sweep.recursion, task.goal
    cost = goal.observation * r.cost
    if cap == "max_observation":
        extra = np.zeros_like(cost)
        extra[r.first_steps] = price * spend_of_columns(task)
        cost = cost + extra
    factor = goal.error + (price if cap == "max_error" else 0.0)
    cost = np.ascontiguousarray(cost)
    sweep = Sweep(replace(r, cost=cost)) if task.model is None else task.model.with_prices(cost)
    return replace(task, rules=replace(task.rules, **{cap: np.inf}), sweep=sweep, goal=Goal(1.0, factor))


class Scaled:
    """F of a task without caps, changes not counted, on policies (N, C); an Objective.

    Parameters
    ----------
    task : Task
    """

    def __init__(self, task: Task):
        self.task = task
        self.forward_count = self.backward_count = 0

    @property
    def shape(self) -> tuple[int, int]:
        """(N, C)"""
        return self.task.oracle.shape

    @property
    def states(self) -> int:
        """n"""
        return self.task.sweep.states

    def cost(self, weights: np.ndarray) -> float:
        """F of `weights` (N, C)."""
        self.forward_count += 1
        linear, error = self.task.parts(weights)
        return self.task.goal.observation * linear + self.task.goal.error * error

    def cost_and_gradient(self, weights: np.ndarray) -> tuple[float, np.ndarray]:
        """F and dF/dv (N, C) of `weights` (N, C)."""
        self.forward_count += 1
        self.backward_count += 1
        goal, linear = self.task.goal, float(np.vdot(self.task.price, weights))
        J, g = self.task.sweep.cost_and_gradient(weights)
        value = goal.observation * linear + goal.error * (J - linear)
        return value, goal.observation * self.task.price + goal.error * (g - self.task.price)


def used_by(task: Task, cap: str, weights: np.ndarray) -> float:
    """The observation cost or the error of a policy.

    Parameters
    ----------
    task : Task
    cap : "max_observation" or "max_error"
    weights : (N, C)
    """
    return float(np.vdot(spend_of_columns(task), weights)) if cap == "max_observation" else task.parts(weights)[1]

"""The exact optimum under rules: branch and bound on the set of sensors that an interval uses.

A node is a mask of allowed actions. Its bound is that of the hull under the mask, with the columns of its parent that
the mask allows; it is left as soon as the bound reaches the best cost but for `gap`. Every column is scored, so the
best schedule and the best bound are known at every moment. A node with one set on every interval is one schedule.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.scheduling.rules.branching import children_of
from occontrol.scheduling.rules.bundle import Bundle, solve
from occontrol.scheduling.rules.hull import Hull, HullOptions, bounds_at, hull, inherited
from occontrol.scheduling.rules.master import Multipliers, Tangent
from occontrol.scheduling.rules.moves import Mover, Scored
from occontrol.scheduling.rules.plan import Plan
from occontrol.scheduling.rules.pool import Pool
from occontrol.scheduling.rules.rows import Rows
from occontrol.scheduling.rules.task import Task

ROOT, INNER = 400, 60  # calls of the oracle in the first node, and in the others
EARLY, NEAR = 4, 0.02  # schedules at the start that are improved though they are only that close to the best


@dataclass(frozen=True)
class TreeOptions:
    """When to stop.

    Parameters
    ----------
    gap : relative to the best schedule's cost
    most : nodes
    moves : evaluations of block moves on every new best schedule
    first : nodes, as long as there is no schedule yet
    """

    gap: float = 1e-6
    most: int = 2000
    moves: int = 400
    first: int = 0


@dataclass
class Tree:
    """What is known at a moment.

    Parameters
    ----------
    best : the best schedule, or None
    lower_bound : proven for all schedules that keep the rules; inf where there are none
    root : the hull without a mask
    nodes : solved so far
    complete : whether no node is left open
    """

    best: Scored | None
    lower_bound: float
    root: Hull
    nodes: int
    complete: bool


@dataclass(frozen=True, eq=False)
class Begun:
    """What is known before the first node.

    Parameters
    ----------
    weights : (N, C) policy to begin at
    multipliers : of the rows and of the error
    plans : schedules to begin with
    known : a bound with policy and multipliers that prove it, or None
    value : of a mixture that keeps all rules, where one is known
    """

    weights: np.ndarray
    multipliers: Multipliers
    plans: list[Plan] = field(default_factory=list)
    known: tuple[np.ndarray, Multipliers, float] | None = None
    value: float = np.inf


@dataclass(order=True)
class Node:
    """Schedules that are still open.

    Parameters
    ----------
    bound : proven for them
    number : in which order they were met
    mask : (N, A) actions that may better the best schedule
    chosen : (N, A) actions that branching alone allows
    start : where the node's hull begins; None where tangents that are known will do
    """

    bound: float
    number: int
    mask: np.ndarray = field(compare=False)
    chosen: np.ndarray = field(compare=False)
    start: tuple[np.ndarray, Multipliers, list[Plan]] | None = field(compare=False)


class Elsewhere(Protocol):
    """What solves nodes of a search at several places.

    Attributes
    ----------
    worth : nodes from which it pays
    """

    @property
    def worth(self) -> int: ...

    def round(self, heap: list[Node], most: int) -> float:
        """Go on with the nodes of the `heap`, `most` of them; what the schedules cost at least that this leaves."""
        ...


class Search:
    """Branch and bound on one task.

    Parameters
    ----------
    task : Task
    options : TreeOptions
    monitor : Monitor
    seeds : plans to begin with
    told : called with every better Scored
    """

    def __init__(
        self,
        task: Task,
        options: TreeOptions,
        monitor: Monitor,
        seeds: list[Plan],
        told: Callable[[Scored], None] = lambda scored: None,
    ):
        self.task, self.options, self.monitor, self.told = task, options, monitor, told
        self.mover, self.rows = Mover(task), Rows(task)
        caps = np.isfinite(task.rules.max_error) or np.isfinite(task.rules.max_observation)
        self.bundle = Bundle(task) if task.complete and not caps and not self.rows.known else None
        self.best: Scored | None = None
        self.nodes, self._count = 0, 1
        self.tangents: list[Tangent] = []  # of the first node
        self._scored: set[bytes] = set()
        self._near = 0
        self._most, self.pool = _dearest(task), Pool(self.mover)
        for plan in seeds:
            self.score(plan)

    @property
    def cutoff(self) -> float:
        """The bound at which a node is left: relative to the best schedule; without one, what none can cost."""
        if self.best is None:
            return self._most
        return self.best.value - 0.5 * self.options.gap * self.task.size(self.best.value)

    def score(self, plan: Plan, improve: bool = True) -> None:
        """Cost a plan, and improve it, if wished, where it is the best, or early and near the best."""
        if plan.key in self._scored:
            return
        self._scored.add(plan.key)
        found = Scored(plan, self.task.value(plan))
        if not np.isfinite(found.value):
            return
        before = np.inf if self.best is None else self.best.value
        near = found.value < before + NEAR * self.task.size(before)
        if found.value < before or (near and self._near < EARLY):
            self._near += not found.value < before
            if self.options.moves and improve:
                found = self.mover.improve(found, self.options.moves, self.monitor)
        if found.value < before:
            self._better(found)
        elif improve and self.options.moves and not found.settled:
            self.pool.offer(found, before)

    def _better(self, found: Scored) -> None:
        self.best = found
        self._scored.add(found.plan.key)
        self.told(found)

    def run(
        self, start: np.ndarray, begun: Begun | None = None, elsewhere: Callable[[Search], Elsewhere] | None = None
    ) -> Tree:
        """The search, from a policy `start` (N, C) at which the first bound is taken, or with what is known already.

        `elsewhere` makes of the search, after its first node, what goes on with many nodes at once.
        """
        task, monitor = self.task, self.monitor
        everything = np.ones_like(task.oracle.open)
        begun = begun or Begun(start, Multipliers(np.empty(0)))
        root = self._solve(
            Node(-np.inf, 0, everything, everything, (begun.weights, begun.multipliers, begun.plans)), begun
        )
        heap: list[Node] = []
        closed = self._file(heap, root, everything, everything, root.lower_bound)
        apart = None if elsewhere is None or self.bundle is None else elsewhere(self)
        while heap and not monitor.stop:
            most = self.options.most if self.best else max(self.options.most, self.options.first)
            if self.nodes >= most:
                break
            if apart is None or len(heap) < apart.worth:
                closed = min(closed, self.step(heap))
            else:
                closed = min(closed, apart.round(heap, most - self.nodes))
            value = np.inf if self.best is None else self.best.value
            monitor.report(self.nodes, value, min(closed, value, *(n.bound for n in heap[:1])))
        open_bounds = [n.bound for n in heap]
        best = np.inf if self.best is None else self.best.value
        lower = min([closed, best, *open_bounds])
        lower = np.inf if self.best is None and not heap and not monitor.stop else lower
        return Tree(self.best, lower, root, self.nodes, not heap)

    def step(self, heap: list[Node]) -> float:
        """Solve the node of the best bound; what the schedules cost at least that this leaves."""
        node = heapq.heappop(heap)
        if node.bound >= self.cutoff:
            return node.bound
        found = self._solve(node)
        bound = max(found.lower_bound, node.bound)
        self._count += 8
        if self.options.moves and (better := self.pool.spend(self.best, self.monitor)) is not None:
            self._better(better)
        return self._file(heap, found, node.mask, node.chosen, bound)

    def _solve(self, node: Node, begun: Begun | None = None) -> Hull:
        self.nodes += 1
        options = HullOptions(0.1 * self.options.gap, lambda: self.cutoff, ROOT if self.nodes == 1 else INNER)
        if begun is not None:
            options = replace(options, known=begun.known, value=begun.value)
        common = node.mask, options, self.score, self.monitor
        if self.bundle is None:
            return hull(self.task, self.rows, node.start, *common)  # type: ignore[arg-type]
        if begun is None:
            return solve(self.bundle, *common)
        root = hull(self.task, self.rows, node.start, *common, self._taken)  # type: ignore[arg-type]
        for plan in root.plans:
            self.bundle.add(plan)
        return root

    def _taken(self, at: Tangent) -> None:
        self.tangents.append(at)
        self.bundle.take(at)  # type: ignore[union-attr]

    def _file(self, heap: list, found: Hull, mask: np.ndarray, chosen: np.ndarray, bound: float) -> float:
        """Put the children of a node on the heap; what the node's schedules cost at least, where it has none."""
        if not np.isfinite(found.lower_bound) or bound >= self.cutoff:
            return bound
        each = self._each(found, mask)
        # what cannot better the best schedule is left out of all that follows
        cutoff = self.cutoff
        closed = cutoff if np.any(mask & (each >= cutoff)) else np.inf
        useful = mask & (each < cutoff)
        children = children_of(self.task, found, chosen, useful)
        if not children:
            plan = self.task.oracle.minimise(np.zeros(self.task.oracle.shape), None, useful)[1]
            return closed if plan is None else min(closed, self.task.value(plan))
        for i, (child, at, actions) in enumerate(children):
            # a bundle knows all that it takes to begin
            start = None if self.bundle is not None else inherited(found, child)
            own = max(bound, float(np.min(each[at, actions], initial=np.inf)))
            if own >= cutoff:
                closed = min(closed, own)
                continue
            branch = chosen.copy()
            branch[at] &= actions
            heapq.heappush(heap, Node(own, self._count + i, child, branch, start))
        return closed

    def _each(self, found: Hull, mask: np.ndarray) -> np.ndarray:
        """(N, A) what the schedules of a node cost at least that do action a on interval k."""
        if found.line is not None:
            constant, g = found.line
            return constant + self.task.oracle.least_through(g, None, mask)
        policy, multipliers, _ = found.proof
        multipliers = multipliers.padded(len(self.rows.known))
        return bounds_at(self.task, self.rows, Tangent.at(self.task, policy), multipliers, mask)


def _dearest(task: Task) -> float:
    """More than any schedule costs: everything that sensors may cost, nothing measured, and as many changes as fit."""
    N, goal = len(task.spend), task.goal
    change = max(float(np.max(task.rules.switch_cost, initial=0.0)), task.rules.start_cost * task.rules.select)
    # a limit of the peak is no part of what is paid
    error = task.parts(np.zeros(task.oracle.shape))[1] if task.model is None else task.model.most()
    dear = np.max(task.price @ task.oracle.automaton.columns.T, axis=1, initial=0.0)
    most = goal.observation * float(np.sum(np.maximum(dear, 0.0))) + goal.error * error + N * change
    return most + 1e-6 * abs(most)

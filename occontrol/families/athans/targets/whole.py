"""The bound that knows looks are whole, for a problem of targets: from its arrays to prices and a lower bound."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.core.spread import HERE, Spread
from occontrol.families.athans.targets.fill import Looks
from occontrol.scheduling.blocks.lanes import BlockGroup
from occontrol.scheduling.blocks.resources import ResourceSet
from occontrol.scheduling.blocks.single import singles
from occontrol.scheduling.blocks.sweep import BlockSweep
from occontrol.scheduling.relaxation import RelaxedOutcome
from occontrol.scheduling.whole.bound import SPACING, Effort, WholeLooks, relaxed_prices
from occontrol.scheduling.whole.certificate import Tangents
from occontrol.scheduling.whole.courses import courses
from occontrol.scheduling.whole.index import price_index
from occontrol.scheduling.whole.prefixes import MOST, Beginnings
from occontrol.scheduling.whole.prices import Found
from occontrol.scheduling.whole.tree import search

CONTEXTS = 18, 28  # lumps of gaps that a target has, about, without levels and with
MOST_BYTES = 1.2e9  # of the tables of all targets
MOST_LOOKS = 200  # up to which a problem is small enough to ask for the trees of its targets
MOST_ARCS = 1e10  # gaps that are looked at in all rounds
ROUNDS = 12, 60
ENOUGH = 5e-3  # relative gap to the relaxed bound, up to which nothing more is asked
CLOSED = 1e-9  # relative gap that is none
NODES = 3_000_000
OF_WHOLE = 2.0  # times the relative doubt about a cost, of the numbers that a bound is the difference of
WHOLE_ALLOWANCE = 1e-12  # of the same, at least


class Listed(Protocol):
    """Targets, blocks and looks as arrays, such as `Filled`."""

    @property
    def targets(self) -> int: ...

    @property
    def intervals(self) -> int: ...

    @property
    def substeps(self) -> int: ...

    @property
    def looks(self) -> Looks: ...

    @property
    def allowed(self) -> ResourceSet: ...

    @property
    def groups(self) -> list[BlockGroup]: ...

    @property
    def owners(self) -> list[np.ndarray]: ...

    @property
    def steps(self) -> np.ndarray: ...

    @property
    def charges(self) -> np.ndarray: ...

    def by_target(self, sweep: BlockSweep, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Error and observation cost (T,) of every target, of the last sweep, at `weights` (E, 1)."""
        ...


def tangents_at(filled: Listed, sweep: BlockSweep, weights: np.ndarray) -> Tangents:
    """The tangents of all targets at shares of looks.

    Parameters
    ----------
    filled : the problem
    sweep : over its blocks
    weights : (E, 1) shares
    """
    _, gradient = sweep.cost_and_gradient(weights)
    error, paid = filled.by_target(sweep, weights)
    g, looked = gradient[:, 0], filled.looks.target >= 0
    base = error + paid
    np.subtract.at(base, filled.looks.target[looked], (g * weights[:, 0])[looked])
    return Tangents(base, g)


def whole_looks(
    filled: Listed, sweep: BlockSweep, weights: np.ndarray, effort: Effort, spread: Spread = HERE
) -> WholeLooks:
    """All targets of a problem, to be asked at prices.

    Parameters
    ----------
    filled : the problem
    sweep : over its blocks
    weights : (E, 1) of the relaxed optimum
    effort : Effort
    spread : where the targets are asked
    """
    looks = filled.looks
    data = singles(filled.groups, filled.owners, filled.targets, filled.steps, filled.charges)
    each = courses(data, looks.interval, looks.target, looks.price, filled.substeps)
    return WholeLooks(each, filled.allowed, tangents_at(filled, sweep, weights), effort, spread)


@dataclass(frozen=True, eq=False)
class Whole:
    """What is known about schedules of whole looks.

    Parameters
    ----------
    bound : no schedule of whole looks costs less
    size : of the numbers that the bound is the difference of, for what rounding does to it
    prices : (S,) of the stretches
    rounds : prices that were tried
    weights : (E, 1) of a schedule that is worth looking at, if any
    nodes : of the tree, None where there was none
    proven : whether the tree has left nothing untried
    """

    bound: float
    size: float
    prices: np.ndarray
    rounds: int
    weights: np.ndarray | None = None
    nodes: int | None = None
    proven: bool = False

    def lowered(self, doubt: float) -> float:
        """The bound less what rounding may have done to it.

        Parameters
        ----------
        doubt : relative, about a cost (rounding_check.py)
        """
        return self.bound - max(OF_WHOLE * doubt, WHOLE_ALLOWANCE) * self.size


def levels_that_fit(filled: Listed) -> int | None:
    """How many levels beside the floor fit in memory with the tables of all targets; None where nothing fits.

    Parameters
    ----------
    filled : the problem
    """
    looks, T, N = filled.looks, filled.targets, filled.intervals
    real = looks.target >= 0
    if not np.any(real):
        return None
    key = looks.target[real].astype(np.int64) * N + looks.interval[real]
    visits = np.bincount(looks.target[real], minlength=T).astype(float)
    open_ = np.bincount(np.unique(key) // N, minlength=T).astype(float)
    for levels in range(len(SPACING), -1, -1):
        each = 0.5 * visits * CONTEXTS[levels > 0] * (levels + 1) + (12 + levels) * open_
        if 8 * float(np.sum(each * open_)) <= MOST_BYTES:
            return levels
    return None


def _rounds(filled: Listed, levels: int) -> int:
    """Prices that are tried: fewer where there are many looks."""
    real = filled.looks.target >= 0
    each = np.bincount(filled.looks.target[real], minlength=filled.targets).astype(float)
    arcs = 0.5 * CONTEXTS[levels > 0] * (levels + 1) * float(np.sum(each**2))
    return int(np.clip(MOST_ARCS / (arcs + 1.0), *ROUNDS))


def bound_whole(
    filled: Listed, sweep: BlockSweep, relaxed: RelaxedOutcome, best: float, monitor: Monitor, walk: bool
) -> Whole | None:
    """The bound on whole looks, and with `walk` the schedule of the price index; None where it would take too much.

    Parameters
    ----------
    filled : the problem
    sweep : over its blocks
    relaxed : its relaxation
    best : cost of the best schedule that is known, to be shown
    monitor : Monitor
    walk : whether a schedule is asked for
    """
    levels = levels_that_fit(filled)
    there = any(len(group.entry) for group in filled.groups)  # not where their lists were dropped for want of memory
    if monitor.stop or not np.isfinite(relaxed.cost) or levels is None or not there:
        return None
    monitor.stage = "whole looks"
    effort = Effort(_rounds(filled, levels), levels=levels)
    ready = whole_looks(filled, sweep, relaxed.weights, effort, monitor.spread)
    start = relaxed_prices(relaxed.gradient, filled.allowed)

    def stop(found: Found) -> bool:
        monitor.report(found.rounds, best, found.bound, stage="whole looks")
        return monitor.stop

    found = ready.bound(start, stop)
    weights = price_index(ready.chunk, filled.allowed, found.prices) if walk and not monitor.stop else None
    size = float(np.sum(np.abs(found.bounds)) + found.prices @ ready.capacity)
    return Whole(found.bound, size, found.prices, found.rounds, weights)


def by_tree(
    filled: Listed, sweep: BlockSweep, relaxed: RelaxedOutcome, known: Whole, best: np.ndarray, monitor: Monitor
) -> Whole:
    """The same with what the tree proves, where every target is small: it is gone through whatever a bound says.

    Parameters
    ----------
    filled : the problem
    sweep : over its blocks
    relaxed : its relaxation
    known : of `bound_whole`
    best : (E, 1) the best schedule of whole looks that is known
    monitor : Monitor
    """
    cost = sweep.cost(best)
    if monitor.stop or known.bound >= cost - CLOSED * abs(cost):
        return known
    looks = filled.looks
    if np.sum(looks.target >= 0) > MOST_LOOKS:
        return known
    ready = whole_looks(filled, sweep, relaxed.weights, Effort(exact=MOST))
    if not ready.chunk.exactly:
        return known
    monitor.stage = "tree"
    found = ready.bound(known.prices, lambda found: monitor.stop)
    size = max(known.size, float(np.sum(np.abs(found.bounds)) + found.prices @ ready.capacity))
    trees = [t for t in ready.chunk.known if isinstance(t, Beginnings)]
    done = search(trees, ready.stretch, ready.capacity, found.prices, cost, CLOSED, NODES)
    weights = None
    if done.looks is not None:
        weights = np.zeros(filled.allowed.shape)
        weights[done.looks] = 1.0
        sums = np.add.reduceat(weights[:, 0], filled.allowed.starts[:-1])
        weights[filled.allowed.rest, 0] = filled.allowed.capacity - sums
    bound = max(known.bound, found.bound, done.bound)
    return Whole(bound, size, found.prices, known.rounds + found.rounds, weights, done.nodes, done.finished)

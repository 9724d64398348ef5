"""Whole looks of a dense plant that falls into targets: its bound, and a schedule of the price index.

Blocks of states that no sensor sees together are targets, the sensors their looks, `select` the capacity of one
resource. A schedule that has to use `select` sensors is one that may use so many, so the bound holds for it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from occontrol.core.monitor import Monitor
from occontrol.families.athans.found import Found
from occontrol.families.athans.integration.priced import judge_of
from occontrol.families.athans.targets.fill import Looks, costs_by_target
from occontrol.families.athans.targets.rounding_check import rounding
from occontrol.families.athans.targets.whole import ENOUGH, bound_whole, by_tree
from occontrol.scheduling.blocks.components import SPLIT, block_groups, components
from occontrol.scheduling.blocks.lanes import BlockGroup
from occontrol.scheduling.blocks.local_search import improve
from occontrol.scheduling.blocks.resources import ResourceSet
from occontrol.scheduling.blocks.single import singles
from occontrol.scheduling.blocks.sweep import BlockSweep
from occontrol.scheduling.feasible_set import FeasibleSet, IntervalPolytopes
from occontrol.scheduling.recursion import Recursion
from occontrol.scheduling.relaxation import RelaxedOutcome
from occontrol.scheduling.sweep import Sweep

SEARCH = 4e7  # steps of a block of two states that a search may spend, at most so many times the open looks:
SEARCH_PER_LOOK = 2e4


@dataclass(frozen=True, eq=False)
class Apart:
    """A recursion as targets and looks; what `bound_whole` reads.

    Parameters
    ----------
    targets, intervals, substeps : T, N, steps on every interval
    looks : Looks
    allowed : ResourceSet
    groups, owners : BlockGroups, and the target of each block
    steps, charges : of the recursion
    place : (N, M) the weight of each sensor, -1 for none
    """

    targets: int
    intervals: int
    substeps: int
    looks: Looks
    allowed: ResourceSet
    groups: list[BlockGroup]
    owners: list[np.ndarray]
    steps: np.ndarray
    charges: np.ndarray
    place: np.ndarray

    def by_target(self, sweep: BlockSweep, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Error and observation cost of every target, of the last sweep, at `weights` (E, 1)."""
        return costs_by_target(self.looks, self.owners, self.targets, sweep, weights)

    def listed(self, policy: np.ndarray) -> np.ndarray:
        """(E, 1) the weights of a policy (N, M)."""
        v = np.zeros(self.allowed.shape)
        there = self.place >= 0
        v[self.place[there], 0] = policy[there]
        v[self.allowed.rest, 0] = self.allowed.capacity - np.add.reduceat(v[:, 0], self.allowed.starts[:-1])
        return v

    def policy(self, weights: np.ndarray, upper: np.ndarray, idle: np.ndarray) -> np.ndarray | None:
        """(N, M) of whole looks, `weights` (E, 1); what is left over goes to idle sensors (M,), or to free ones.

        Parameters
        ----------
        weights : (E, 1)
        upper : (N, M) of the feasible set
        idle : (M,) which sensors see nothing
        """
        v, there = np.zeros(self.place.shape), self.place >= 0
        v[there] = np.round(weights[self.place[there], 0])
        for k, left in enumerate(np.round(weights[self.allowed.rest, 0]).astype(int)):
            for j in np.argsort(~idle, kind="stable"):
                give = min(left, int(upper[k, j] - v[k, j]))
                v[k, j] += give
                left -= give
            if left:
                return None
        return v


def apart(recursion: Recursion, allowed: FeasibleSet) -> Apart | None:
    """A recursion as targets; None where it is none, or where its sensors are chosen in another way.

    Parameters
    ----------
    recursion : Recursion
    allowed : FeasibleSet
    """
    r, N, M = recursion, recursion.intervals, recursion.sensors
    s, odd = divmod(len(r.steps), N)
    if not isinstance(allowed, IntervalPolytopes) or odd or np.any(r.cost < 0):
        return None
    if r.owner is not None and not np.array_equal(r.owner, np.repeat(np.arange(N), s)):
        return None
    blocks = components(r)
    groups = block_groups(r, blocks)
    first = np.cumsum([0, *map(len, groups)])
    block = np.concatenate([g.block + a for g, a in zip(groups, first, strict=False)])
    sensor = np.concatenate([g.entry % M for g in groups])
    B = len(blocks)
    graph = coo_array((np.ones(len(block)), (block, B + sensor)), shape=(B + M, B + M))
    label = connected_components(graph, directed=False)[1]
    target = np.unique(label[:B], return_inverse=True)[1]
    T = int(np.max(target)) + 1
    looking = np.isin(np.arange(M), sensor)
    open_ = (allowed.upper > 0) & (r.available > 0) & looking
    if T < 2 or np.any(allowed.upper[open_] != 1) or np.any(r.decision_cost[:, ~looking] != 0):
        return None
    of_sensor = np.full(M, -1)
    of_sensor[sensor] = target[block]
    order = np.argsort(of_sensor, kind="stable")
    place, at = np.full((N, M), -1), 0
    starts, whose, interval, price = [0], [], [], []
    for k in range(N):
        here = order[open_[k, order]]
        place[k, here] = at + np.arange(len(here))
        whose += [*of_sensor[here], -1]
        price += [*r.decision_cost[k, here], 0.0]
        interval += [k] * (len(here) + 1)
        at += len(here) + 1
        starts.append(at)
    if r.charge is None:
        charges = np.repeat(0.5 * r.steps[:, None], 2, axis=1)
    else:
        charges = r.charge
    none = np.zeros(at, dtype=np.int32)
    looks = Looks(np.array(interval), none, np.array(whose), np.array(price), [])
    lengths = np.add.reduceat(r.steps, r.first_steps)
    stretches = ResourceSet(np.array(starts), np.full(N, allowed.select), np.arange(N), lengths, np.array(whose))
    cut = []
    for g in groups:
        entry = place.reshape(-1)[g.entry]
        used = entry >= 0
        cut.append(replace(g, block=g.block[used], step=g.step[used], entry=entry[used], row=g.row[used]))
    owners = [target[a : a + len(g)] for g, a in zip(groups, first, strict=False)]
    return Apart(T, N, s, looks, stretches, cut, owners, r.steps, charges, place)


def whole_dense(
    sweep: Sweep, allowed: FeasibleSet, relaxed: RelaxedOutcome, weights: np.ndarray, monitor: Monitor
) -> tuple[float, np.ndarray] | None:
    """A lower bound for whole looks, and a schedule (N, M) that costs no more than `weights`; None where it is no use.

    Parameters
    ----------
    sweep : whose costs are those of the problem
    allowed : FeasibleSet
    relaxed : its relaxation
    weights : (N, M) the best schedule that is known
    monitor : Monitor
    """
    cost = sweep.cost(weights)
    if _in_one_piece(sweep) or cost - relaxed.lower_bound <= ENOUGH * abs(cost):
        return None
    filled = apart(sweep.recursion, allowed)
    if filled is None:
        return None
    looks, real = filled.looks, filled.place >= 0
    gradient = np.zeros(filled.allowed.shape)
    gradient[filled.place[real], 0] = relaxed.gradient[real]
    lanes = BlockSweep(filled.groups, filled.steps, filled.charges, looks.price[:, None])
    known = replace(relaxed, weights=filled.listed(relaxed.weights), gradient=gradient)
    whole = bound_whole(filled, lanes, known, cost, monitor, walk=True)
    if whole is None:
        return None
    best, idle = weights, np.all(~real, axis=0)

    def better(listed: np.ndarray) -> np.ndarray:
        other = filled.policy(listed, allowed.upper, idle) if isinstance(allowed, IntervalPolytopes) else None
        return best if other is None or sweep.cost(other) >= sweep.cost(best) else other

    if whole.weights is not None and not monitor.stop:
        data = singles(filled.groups, filled.owners, filled.targets, filled.steps, filled.charges)
        work = min(SEARCH, SEARCH_PER_LOOK * filled.allowed.shape[0] * filled.substeps)
        for start in (whole.weights, filled.listed(weights)):
            x, _ = improve(start, filled.allowed, looks.target, looks.resource, looks.price, data, work, monitor)
            best = better(x)
    closed = by_tree(filled, lanes, known, whole, filled.listed(best), monitor)
    if closed.weights is not None:
        best = better(closed.weights)
    at = filled.listed(best)
    value, slope = lanes.cost_and_gradient(at)
    doubt = rounding(filled, lanes, at, value, slope)[0] / abs(value) if value else 0.0
    return max(whole.lowered(doubt), closed.lowered(doubt)), best


def _in_one_piece(sweep: Sweep) -> bool:
    """Whether it is known already that no states stand apart from others; of few states it is not looked at before."""
    return sweep.blocks is None and sweep.recursion.states >= SPLIT


def with_whole_looks(found: Found, sweep: Sweep, allowed: FeasibleSet, monitor: Monitor) -> None:
    """What a method found, in place: with the bound for whole looks and a better schedule, where there are any.

    Parameters
    ----------
    found : of a method
    sweep : that it worked on
    allowed : FeasibleSet
    monitor : Monitor
    """
    relaxed = found.relaxed
    if relaxed is None or monitor.stop or _in_one_piece(sweep) or judge_of(sweep) is not sweep:
        return
    more = whole_dense(sweep, allowed, relaxed, found.weights, monitor)
    if more is not None:
        found.bound, found.weights = max(found.bound, more[0]), more[1]
        found.bounds = {"relaxed": relaxed.lower_bound, "integer": more[0]}

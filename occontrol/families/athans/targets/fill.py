"""A problem of many targets as blocks and looks: what the sweeps over scheduling/blocks work on.

The recursion of every target is that of families/athans/discretise.py: half predicts around one update in the middle of
every step, a running weight charged there as h/2 [tr(R S-) + tr(R S+)]. A look is what it is in the middle of its
interval. States of a model that nothing couples, such as the axes of a radar with independent errors, become blocks of
their own.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from occontrol.families.athans.targets.groups import TargetGroup
from occontrol.families.athans.targets.problem import TargetsProblem
from occontrol.scheduling.blocks.lanes import BlockGroup
from occontrol.scheduling.blocks.resources import ResourceSet
from occontrol.scheduling.blocks.sweep import BlockSweep


@dataclass(frozen=True, eq=False)
class Looks:
    """All looks that may be taken, in the order of interval, resource and target; one weight each.

    Parameters
    ----------
    interval, resource, target : (E,) numbers; target is -1 for the weight of what a resource leaves unused
    price : (E,) alpha q h
    group, which : (E,) for a look: the group of its target and which of the scaled rows there it has
    """

    interval: np.ndarray
    resource: np.ndarray
    target: np.ndarray
    price: np.ndarray = field(repr=False)
    source: list[list[np.ndarray]] = field(repr=False)


@dataclass(frozen=True, eq=False)
class Filled:
    """A problem as arrays for the solvers.

    Parameters
    ----------
    problem : TargetsProblem
    substeps : steps of integration on every interval
    looks : Looks
    allowed : ResourceSet
    groups : BlockGroups
    owners : (B,) target of each block, group by group
    steps : (K,) lengths of the steps of integration
    charges : (K, 2) factors of the running weight before and after an update
    """

    problem: TargetsProblem
    substeps: int
    looks: Looks
    allowed: ResourceSet
    groups: list[BlockGroup]
    owners: list[np.ndarray]
    steps: np.ndarray
    charges: np.ndarray

    def sweep(self, threads: int | None = None) -> BlockSweep:
        """A sweep over the blocks, by so many threads."""
        return BlockSweep(self.groups, self.steps, self.charges, self.looks.price[:, None], threads)

    def by_target(self, sweep: BlockSweep, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Error and observation cost (alpha q h v) of every target, of the last sweep, at `weights` (E, 1)."""
        return costs_by_target(self.looks, self.owners, self.targets, sweep, weights)

    @property
    def targets(self) -> int:
        """T"""
        return self.problem.targets

    @property
    def intervals(self) -> int:
        """N"""
        return self.problem.intervals


def costs_by_target(
    looks: Looks, owners: list[np.ndarray], targets: int, sweep: BlockSweep, weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Error and observation cost (alpha q h v) of every target, of the last sweep.

    Parameters
    ----------
    looks : Looks
    owners : (B,) target of each block, group by group
    targets : T
    sweep : over the blocks
    weights : (E, 1)
    """
    error, paid = np.zeros(targets), np.zeros(targets)
    for owner, costs in zip(owners, sweep.block_costs, strict=True):
        np.add.at(error, owner, costs)
    looked = looks.target >= 0
    np.add.at(paid, looks.target[looked], (looks.price * weights[:, 0])[looked])
    return error, paid


def fill(problem: TargetsProblem, substeps: int = 1) -> Filled:
    """The problem on its intervals, each integrated in equal steps.

    Parameters
    ----------
    problem : TargetsProblem
    substeps : steps on every interval
    """
    looks, allowed = _looks(problem)
    N, s = problem.intervals, substeps
    steps = np.repeat(problem.steps / s, s)
    starts = np.repeat(problem.elapsed[:-1], s) + np.tile(np.arange(s), N) * steps
    nodes = np.concatenate([[0.0], starts + steps / 2, problem.elapsed[-1:]])
    parts: dict[tuple, list[tuple[BlockGroup, np.ndarray]]] = {}
    for g, group in enumerate(problem.groups):
        F, Q, which = group.flows(nodes, float(problem.edges[0]))
        count, label = connected_components(csr_array(group.coupling), directed=False)
        for b in range(count):
            states = np.flatnonzero(label == b)
            made = _blocks(group, states, F, Q, which, looks, g, problem, s)
            key = (len(states), made.per_use, F.shape[1])
            parts.setdefault(key, []).append((made, np.arange(len(group)) + problem.first[g]))
    groups, owners = [], []
    while parts:
        merged, owner = _merged(parts.pop(next(iter(parts))))
        groups.append(merged)
        owners.append(owner)
    charges = np.repeat(0.5 * steps[:, None], 2, axis=1)
    return Filled(problem, s, looks, allowed, groups, owners, steps, charges)


def _looks(problem: TargetsProblem) -> tuple[Looks, ResourceSet]:
    """Every open look, and after those of one resource on one interval the weight of what is left over."""
    R, T = len(problem.resources), problem.targets
    capacity = np.array([r.capacity for r in problem.resources]).T  # (N, R)
    interval, resource, target, price, shape = [], [], [], [], []
    for g, group in enumerate(problem.groups):
        for looks in group.looks:
            open_ = capacity[looks.interval, looks.resource] > 0
            interval.append(looks.interval[open_])
            resource.append(np.full(int(np.sum(open_)), looks.resource, dtype=np.int32))
            target.append((looks.target[open_] + problem.first[g]).astype(np.int32))
            rate = looks.cost[looks.which[open_]] * problem.cost_weight
            price.append(rate * problem.steps[looks.interval[open_]])
            shape.append((g, len(interval[-1])))
    k, rho, i = np.concatenate(interval), np.concatenate(resource), np.concatenate(target)
    del interval, resource, target
    stretch = k * np.int64(R) + rho
    del k, rho
    order = np.argsort(stretch * (T + 1) + i, kind="stable")
    used, count = np.unique(stretch, return_counts=True)
    del stretch
    starts = np.concatenate([[0], np.cumsum(count + 1)])
    E = int(starts[-1])
    place = np.empty(len(order), dtype=np.int32 if E < 2**31 else np.int64)
    place[order] = np.arange(len(order)) + np.repeat(np.arange(len(used)), count)  # one more for every stretch before
    del order
    full = np.full(E, -1, dtype=np.int32)
    price_of = np.zeros(E)
    full[place], price_of[place] = i, np.concatenate(price)
    del i, price
    all_k = np.repeat((used // R).astype(np.int32), count + 1)
    all_rho = np.repeat((used % R).astype(np.int16 if R < 2**15 else np.int32), count + 1)
    source: list[list[np.ndarray]] = [[] for _ in problem.groups]
    at = 0
    for g, size in shape:
        source[g].append(place[at : at + size])
        at += size
    lane = np.where(full >= 0, all_rho.astype(np.int32 if R * T < 2**31 else np.int64) * T + full, 0)
    caps = capacity[(used // R).astype(np.int64), (used % R).astype(np.int64)]
    allowed = ResourceSet(starts, caps.astype(np.int64), (used // R).astype(np.int64), problem.steps, lane)
    return Looks(all_k, all_rho, full, price_of, source), allowed


def _blocks(
    group: TargetGroup, states: np.ndarray, F: np.ndarray, Q: np.ndarray, which: np.ndarray, looks: Looks, g: int,
    problem: TargetsProblem, s: int,
) -> BlockGroup:  # fmt: skip
    """One block of states of every target of a group."""
    G, n = len(group), len(states)
    cut = np.ix_(states, states)
    capacity = [r.capacity for r in problem.resources]
    rows, uses, at = [], [], 0
    touched = [np.flatnonzero(np.any(x.rows[:, :, states] != 0, axis=(0, 2))) for x in group.looks]
    per_use = max((len(t) for t in touched), default=0)
    for x, kept, place in zip(group.looks, touched, looks.source[g], strict=True):
        if not len(kept):
            continue
        part = np.zeros((len(x.rows), per_use, n))
        part[:, : len(kept)] = x.rows[:, kept][:, :, states]
        open_ = capacity[x.resource][x.interval] > 0
        target, k, number = x.target[open_], x.interval[open_], x.which[open_]
        for q in range(s):
            uses.append((target, k * s + q, place, at + number * per_use))
        rows.append(part.reshape(-1, n))
        at += len(x.rows) * per_use
    none = np.zeros(0, np.int32)
    listed = [np.concatenate([u[i] for u in uses]).astype(np.int32) if uses else none for i in range(4)]
    w = group.weight[:, None, None]
    full = (G, F.shape[1], n, n)
    return BlockGroup(
        initial=group.covariance[:, states[:, None], states],
        terminal=w * group.terminal[:, states[:, None], states],
        transition=np.broadcast_to(F[:, :, cut[0], cut[1]], full),
        noise=np.broadcast_to(Q[:, :, cut[0], cut[1]], full),
        predict=which.astype(np.int64),
        running=(w * group.running[:, states[:, None], states])[:, None],
        running_set=np.zeros(problem.intervals * s, dtype=np.int64),
        rows=np.concatenate(rows) if rows else np.zeros((1, n)),
        per_use=max(1, per_use),
        block=listed[0], step=listed[1], entry=listed[2], row=listed[3],
        whole=np.arange(G),
    )  # fmt: skip


def _merged(parts: list[tuple[BlockGroup, np.ndarray]]) -> tuple[BlockGroup, np.ndarray]:
    """Groups of alike blocks as one, blocks of the same target side by side; and the target of each block."""
    groups = [group for group, _ in parts]
    owner = np.concatenate([owner for _, owner in parts])
    order = np.argsort(owner, kind="stable")
    back = np.empty(len(order), dtype=np.int32)
    back[order] = np.arange(len(order), dtype=np.int32)
    first = np.cumsum([0, *(len(group) for group in groups)]).tolist()  # plain numbers keep lists of 32 bits so
    rows = np.cumsum([0, *(len(group.rows) for group in groups)]).tolist()

    def joined(name: str) -> np.ndarray:
        return np.concatenate([getattr(group, name) for group in groups])[order]

    return BlockGroup(
        initial=joined("initial"), terminal=joined("terminal"), transition=joined("transition"), noise=joined("noise"),
        predict=groups[0].predict, running=joined("running"), running_set=groups[0].running_set,
        rows=np.concatenate([group.rows for group in groups]), per_use=groups[0].per_use,
        block=back[np.concatenate([group.block + first[i] for i, group in enumerate(groups)])],
        step=np.concatenate([group.step for group in groups]),
        entry=np.concatenate([group.entry for group in groups]),
        row=np.concatenate([group.row + rows[i] for i, group in enumerate(groups)]),
        whole=owner[order],
    ), owner[order]  # fmt: skip

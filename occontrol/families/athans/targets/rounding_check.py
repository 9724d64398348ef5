"""How far rounding may have moved cost and bound of a problem of targets: some blocks again, in square-root form.

The blocks whose first look tells most, where most digits are lost, and others spread evenly are swept again by
scheduling/certified.py, which shares no arithmetic with the lanes. The largest relative differences of cost and
gradient among them, times FACTOR, are taken for all.
"""

from __future__ import annotations

import numpy as np

from occontrol.families.athans.targets.whole import Listed
from occontrol.scheduling.blocks.lanes import BlockGroup, Lanes, uses_of
from occontrol.scheduling.blocks.sweep import BlockSweep
from occontrol.scheduling.certified import FACTOR, ULP, Roots, square_root_pass
from occontrol.scheduling.recursion import Recursion

CHECKED = 24  # blocks of each size


def rounding(
    filled: Listed, sweep: BlockSweep, weights: np.ndarray, cost: float, gradient: np.ndarray
) -> tuple[float, float]:
    """Allowances for the cost of a policy and for its bound, in cost units.

    Parameters
    ----------
    filled : the problem
    sweep : over its blocks
    weights : (E, 1) the policy
    cost : J by the lanes
    gradient : (E, 1) by the lanes
    """
    of_cost = of_gradient = 0.0
    if not np.isfinite(sweep.cost(weights)):
        return np.inf, np.inf
    slope = gradient[:, 0] - filled.looks.price
    for lanes, costs in zip(sweep.lanes, sweep.block_costs, strict=True):
        group = lanes.group
        for b in _chosen(group):
            entries, recursion, policy = one_block(lanes, int(b), filled, weights)
            done = square_root_pass(Roots.of(recursion), policy)
            of_cost = max(of_cost, abs(done.cost - costs[b]) / max(abs(costs[b]), 1e-300))
            alone = np.bincount(entries.reshape(-1), minlength=len(slope) + 1)[:-1] > 0
            if len(sweep.lanes) == 1 and _whole(group, int(b)):
                known = np.zeros(len(slope) + 1)
                np.add.at(known, entries, done.gradient)
                size = np.max(np.abs(slope[alone]), initial=0.0)
                if size > 0:
                    apart = np.max(np.abs(known[:-1] - slope)[alone])
                    of_gradient = max(of_gradient, float(apart / size))
    least = ULP * np.sqrt(len(filled.steps)) * max(lanes.states for lanes in sweep.lanes)
    w = filled.allowed.vertex(gradient)
    moved = float(np.sum(np.abs(gradient) * np.abs(weights - w)))
    cost_part = FACTOR * (of_cost + least) * abs(cost)
    return cost_part, cost_part + FACTOR * (max(of_gradient, of_cost) + least) * moved


def _whole(group: BlockGroup, b: int) -> bool:
    """Whether block b shares its looks with no other block of its group."""
    mine = group.whole[b]
    return (b == 0 or group.whole[b - 1] != mine) and (b + 1 == len(group) or group.whole[b + 1] != mine)


def _chosen(group: BlockGroup) -> np.ndarray:
    """Numbers of the blocks that are swept again."""
    B = len(group)
    if B <= CHECKED:
        return np.arange(B)
    size = np.zeros(B)
    if len(group.block):
        strength = np.sum(group.rows**2, axis=1)
        np.maximum.at(size, group.block, strength[group.row])
    told = size * np.einsum("bii->b", group.initial)
    evenly = np.linspace(0, B - 1, CHECKED // 2).astype(int)
    return np.unique(np.concatenate([np.argsort(-told)[: CHECKED // 2], evenly]))


def one_block(
    lanes: Lanes, b: int, filled: Listed, weights: np.ndarray
) -> tuple[np.ndarray, Recursion, np.ndarray]:
    """One block as a Recursion of its own, for code that knows no lanes.

    Parameters
    ----------
    lanes : that it is one of
    b : its number
    filled : of the problem
    weights : (E, 1) of all looks

    Returns the weight that each column belongs to (K, M), the recursion, and the policy (K, M).
    """
    group = lanes.group
    K, n, per, E = len(filled.steps), group.states, group.per_use, len(weights)
    step, entry, row = uses_of(lanes, b, E)
    rank = np.arange(len(step)) - np.searchsorted(step, step)
    M = max(1, int(np.max(rank, initial=0)) + 1)
    entries, rows = np.full((K, M), E), np.zeros((K, M, per, n))
    entries[step, rank] = entry
    rows[step, rank] = group.rows[row[:, None] + np.arange(per)]
    policy = np.append(weights[:, 0], 0.0)[entries]
    recursion = Recursion(
        initial=group.initial[b], transition=group.transition[b].copy(), noise=group.noise[b].copy(),
        predict=group.predict, rows=rows.reshape(K, M * per, n), row_set=np.arange(K),
        offsets=np.arange(M + 1) * per, steps=filled.steps, cost=np.zeros((K, M)), running=group.running[b],
        running_set=group.running_set, terminal=group.terminal[b], available=np.ones((K, M)), charge=filled.charges,
    )  # fmt: skip
    return entries, recursion, policy

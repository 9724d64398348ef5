"""Which states of a recursion are coupled, and the recursion as independent blocks.

States are coupled by nonzero entries of F, Q, Sigma0 and L_j = C_j' Theta_j^-1 C_j at any step; the weights W and R
couple nothing (blocks/sweep.py). Components of that graph are the blocks. Found by scipy.sparse.csgraph.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from occontrol.scheduling.blocks.lanes import BlockGroup
from occontrol.scheduling.blocks.sweep import BlockSweep
from occontrol.scheduling.recursion import Recursion

SAME = 1e-14  # of the diagonal: an entry of L that whitened rows leave by rounding where they do not couple
SPLIT = 12  # states from which blocks are looked for
LARGEST = 24  # states of a block up to which lanes are faster than the dense loops


def coupled(recursion: Recursion) -> np.ndarray:
    """(n, n) whether two states are coupled directly.

    Parameters
    ----------
    recursion : Recursion
    """
    pattern = recursion.initial != 0
    for matrices in (recursion.transition, recursion.noise):
        pattern = pattern | np.any(matrices != 0, axis=0)
    rows, offsets = recursion.rows, recursion.offsets
    for a, b in pairwise(offsets):
        if b > a:
            part = rows[:, a:b]
            information = np.swapaxes(part, 1, 2) @ part
            size = np.sqrt(np.einsum("sii->si", information))
            pattern = pattern | np.any(np.abs(information) > SAME * size[:, :, None] * size[:, None, :], axis=0)
    return pattern | pattern.T


def components(recursion: Recursion) -> list[np.ndarray]:
    """The states of every block, ascending; one block where everything is coupled.

    Parameters
    ----------
    recursion : Recursion
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    count, label = connected_components(csr_array(coupled(recursion)), directed=False)
    return [np.flatnonzero(label == i) for i in range(count)]


def block_groups(recursion: Recursion, blocks: list[np.ndarray]) -> list[BlockGroup]:
    """The recursion as groups of blocks; weight number k M + j is that of sensor j in decision k.

    Parameters
    ----------
    recursion : Recursion
    blocks : (n,) the states of each, as `components` finds them
    """
    sizes = sorted({len(b) for b in blocks})
    return [_group(recursion, [b for b in blocks if len(b) == n]) for n in sizes]


def _group(recursion: Recursion, blocks: list[np.ndarray]) -> BlockGroup:
    r = recursion
    n, K, M = len(blocks[0]), len(r.steps), r.sensors
    index = np.array(blocks)
    rows_at, columns_at = index[:, :, None], index[:, None, :]

    def cut(matrices: np.ndarray) -> np.ndarray:
        """(U, N, N) -> (B, U, n, n)"""
        return np.ascontiguousarray(np.moveaxis(matrices[:, rows_at, columns_at], 1, 0))

    owner = np.arange(K) if r.owner is None else r.owner
    seen = [  # sensors of each block, and which of their rows touch it
        [(j, np.arange(a, b)) for j, (a, b) in enumerate(pairwise(r.offsets))
         if b > a and np.any(r.rows[:, a:b][:, :, states])]
        for states in blocks
    ]  # fmt: skip
    table, uses, at = [], [], 0
    touched = [
        [np.array([i for i in rows if np.any(r.rows[:, i][:, states])]) for _, rows in of_block]
        for of_block, states in zip(seen, blocks, strict=True)
    ]
    per_use = max((len(rows) for of_block in touched for rows in of_block), default=1)
    sets = len(r.rows)
    for b, (of_block, of_rows) in enumerate(zip(seen, touched, strict=True)):
        for (j, _), rows in zip(of_block, of_rows, strict=True):
            part = np.zeros((sets, per_use, n))
            part[:, : len(rows)] = r.rows[:, rows][:, :, blocks[b]]
            open_ = np.flatnonzero(r.available[owner, j] > 0)
            first = at + r.row_set[open_] * per_use
            uses.append(np.column_stack([np.full(len(open_), b), open_, owner[open_] * M + j, first]))
            table.append(part.reshape(-1, n))
            at += sets * per_use
    listed = np.concatenate(uses) if uses else np.zeros((0, 4), dtype=np.int64)
    return BlockGroup(
        initial=r.initial[rows_at, columns_at],
        terminal=r.terminal[rows_at, columns_at],
        transition=cut(r.transition),
        noise=cut(r.noise),
        predict=r.predict,
        running=cut(r.running) if len(r.running) else np.zeros((len(blocks), 0, n, n)),
        running_set=r.running_set,
        rows=np.concatenate(table) if table else np.zeros((1, n)),
        per_use=per_use,
        block=listed[:, 0], step=listed[:, 1], entry=listed[:, 2], row=listed[:, 3],
        whole=np.zeros(len(blocks), dtype=np.int64),
    )  # fmt: skip


def worth_splitting(recursion: Recursion, blocks: list[np.ndarray]) -> bool:
    """Whether blocks are small enough to be swept one by one.

    Parameters
    ----------
    recursion : Recursion
    blocks : (n,) the states of each
    """
    return len(blocks) > 1 and max(len(b) for b in blocks) <= min(LARGEST, recursion.states // 2)


def separated(recursion: Recursion) -> list[Recursion]:
    """Recursions of the blocks, with the same sensors and decisions; the recursion itself where it is no use.

    Prices stand in the first alone, so that costs and gradients are the sums of those of the parts.

    Parameters
    ----------
    recursion : Recursion
    """
    r = recursion
    if r.states < SPLIT:
        return [r]
    blocks = components(r)
    if not worth_splitting(r, blocks):
        return [r]
    found = []
    for states in blocks:
        at = np.ix_(states, states)
        seen = np.any(r.rows[:, :, states], axis=(0, 2))
        counts = [int(np.sum(seen[a:b])) for a, b in pairwise(r.offsets)]
        found.append(
            replace(
                r,
                initial=r.initial[at],
                transition=np.ascontiguousarray(r.transition[:, at[0], at[1]]),
                noise=np.ascontiguousarray(r.noise[:, at[0], at[1]]),
                rows=np.ascontiguousarray(r.rows[:, seen][:, :, states]),
                offsets=np.concatenate([[0], np.cumsum(counts)]).astype(r.offsets.dtype),
                running=np.ascontiguousarray(r.running[:, at[0], at[1]]),
                terminal=r.terminal[at],
                cost=r.cost if not found else np.zeros_like(r.cost),
            )
        )
    return found


def block_sweep(recursion: Recursion) -> BlockSweep | None:
    """The sweep over the blocks of a recursion; None where it does not fall into blocks that are small enough.

    Parameters
    ----------
    recursion : Recursion
    """
    blocks = components(recursion)
    if not worth_splitting(recursion, blocks):
        return None
    return BlockSweep(block_groups(recursion, blocks), recursion.steps, recursion.charges, recursion.decision_cost)

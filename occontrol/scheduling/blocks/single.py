"""One target at a time, in plain compiled loops: what trying single looks costs.

Targets are independent, so what a change of looks does is exact once the targets that it touches are swept again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numba import njit

from occontrol.scheduling.blocks.lanes import BlockGroup

_OPTIONS = {"cache": True, "nogil": True, "fastmath": {"contract", "nsz", "reassoc"}, "error_model": "numpy"}


@dataclass(frozen=True, eq=False)
class Singles:
    """All blocks in flat arrays, block by block.

    Parameters
    ----------
    sizes : (B, 6) n, rows of a use, where S0 (and W, R) and F begin, the pattern of predicts, and where Q begins
    matrices : S0, W and R of every block, n n each
    flows : F of all its spans, then Q, for every block
    predicts : (patterns, K+1) which span is whose
    first : (B, K+1) where the uses of every step begin
    entry, row : of the uses; `row` is where its rows begin in `rows`
    rows : flat
    blocks : (T+1,) where the blocks of every target begin; `sizes` is in that order
    steps, charges : (K,) and (K, 2), as in the recursion
    """

    sizes: np.ndarray
    matrices: np.ndarray = field(repr=False)
    flows: np.ndarray = field(repr=False)
    predicts: np.ndarray = field(repr=False)
    first: np.ndarray = field(repr=False)
    entry: np.ndarray = field(repr=False)
    row: np.ndarray = field(repr=False)
    rows: np.ndarray = field(repr=False)
    blocks: np.ndarray
    steps: np.ndarray
    charges: np.ndarray

    @property
    def arrays(self) -> tuple[np.ndarray, ...]:
        """As the compiled loops take them."""
        return (
            self.sizes, self.matrices, self.flows, self.predicts, self.first, self.entry, self.row, self.rows,
            self.blocks, self.steps, self.charges,
        )  # fmt: skip


def singles(
    groups: Sequence[BlockGroup], owners: Sequence[np.ndarray], targets: int, steps: np.ndarray, charges: np.ndarray
) -> Singles:
    """The blocks of all groups, sorted by target.

    Parameters
    ----------
    groups : BlockGroups with at most one running weight a block
    owners : (B,) target of each block, group by group
    targets : T
    steps : (K,) lengths
    charges : (K, 2) of the running weight
    """
    K, sizes, owner, matrices, flows, predicts, rows = len(steps), [], [], [], [], [], []
    uses = []
    at = to = back = 0
    for p, (group, of) in enumerate(zip(groups, owners, strict=True)):
        B, n, U = len(group), group.states, group.transition.shape[1]
        running = group.running if group.running.shape[1] else np.zeros((B, 1, n, n))
        matrices.append(np.stack([group.initial, group.terminal, running[:, 0]], axis=1).reshape(-1))
        flows.append(np.stack([group.transition, group.noise], axis=1).reshape(-1))
        number = np.arange(B)
        sizes.append(
            np.column_stack(
                [np.full(B, n), np.full(B, group.per_use), at + number * 3 * n * n, to + number * 2 * U * n * n,
                 np.full(B, p), to + (2 * number + 1) * U * n * n]
            )
        )  # fmt: skip
        at, to = at + len(matrices[-1]), to + len(flows[-1])
        predicts.append(group.predict)
        owner.append(of)
        shift = sum(map(len, sizes[:-1]))
        uses.append((group.block, group.step, group.entry, group.row.astype(np.int64) * n + back, shift))
        rows.append(group.rows.reshape(-1))
        back += group.rows.size
    whose = np.concatenate(owner)
    order = np.argsort(whose, kind="stable")
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.arange(len(order))
    block = np.concatenate([place[b.astype(np.int64) + shift] for b, _, _, _, shift in uses])
    step, entry, row = (np.concatenate([u[i] for u in uses]) for i in (1, 2, 3))
    B = len(order)
    key = block * K + step
    by = np.argsort(key, kind="stable")
    ends = np.cumsum(np.bincount(key, minlength=B * K))
    first = np.zeros((B, K + 1), dtype=np.int64)
    first[:, 1:] = ends.reshape(B, K)
    first[1:, 0] = first[:-1, -1]
    return Singles(
        np.concatenate(sizes)[order].astype(np.int64), np.concatenate(matrices), np.concatenate(flows),
        np.array(predicts, dtype=np.int64), first, entry[by].astype(np.int64), row[by], np.concatenate(rows),
        np.searchsorted(whose[order], np.arange(targets + 1)), np.ascontiguousarray(steps),
        np.ascontiguousarray(charges),
    )  # fmt: skip


@njit(**_OPTIONS)
def work_space(data):
    """S, T (n, n) and y (n,) for the largest block."""
    n = np.max(data[0][:, 0])
    return np.empty((n, n)), np.empty((n, n)), np.empty(n)


@njit(**_OPTIONS)
def _block_cost(b, x, data, work):
    """What block b costs with the weights x (E,)."""
    sizes, matrices, flows, predicts, first, entry, row, rows, _, steps, charges = data
    S, T, y = work
    n, per, m, f, pattern = sizes[b, 0], sizes[b, 1], sizes[b, 2], sizes[b, 3], sizes[b, 4]
    K, nn, noise = len(steps), n * n, sizes[b, 5]
    W, R = m + nn, m + 2 * nn
    for i in range(n):
        for j in range(n):
            S[i, j] = matrices[m + i * n + j]
    total = 0.0
    for k in range(K + 1):
        u = predicts[pattern, k] * nn
        for i in range(n):
            for j in range(n):
                s = 0.0
                for p in range(n):
                    s += flows[f + u + i * n + p] * S[p, j]
                T[i, j] = s
        for i in range(n):
            for j in range(i + 1):
                s = flows[noise + u + i * n + j]
                for p in range(n):
                    s += T[i, p] * flows[f + u + j * n + p]
                S[i, j] = S[j, i] = s
        if k == K:
            break
        total += charges[k, 0] * _trace(matrices, R, S, n)
        for a in range(first[b, k], first[b, k + 1]):
            w = steps[k] * x[entry[a]]
            if w > 0.0:
                for r in range(per):
                    c = row[a] + r * n
                    d = 0.0
                    for i in range(n):
                        s = 0.0
                        for j in range(n):
                            s += S[i, j] * rows[c + j]
                        y[i] = s
                        d += s * rows[c + i]
                    gain = w / (1.0 + w * d)
                    for i in range(n):
                        for j in range(n):
                            S[i, j] -= gain * y[i] * y[j]
        total += charges[k, 1] * _trace(matrices, R, S, n)
    return total + _trace(matrices, W, S, n)


@njit(**_OPTIONS)
def _trace(matrices, at, S, n):
    """tr(M S) of the matrix M that begins at `at`."""
    total = 0.0
    for i in range(n):
        for j in range(n):
            total += matrices[at + i * n + j] * S[i, j]
    return total


@njit(**_OPTIONS)
def target_cost(i, x, data, work):
    """What all blocks of target i cost with the weights x (E,), without prices of looks."""
    total = 0.0
    for b in range(data[8][i], data[8][i + 1]):
        total += _block_cost(b, x, data, work)
    return total


@njit(**_OPTIONS)
def all_costs(x, data, costs):
    """costs (T,) <- what every target costs with the weights x (E,)."""
    work = work_space(data)
    for i in range(len(costs)):
        costs[i] = target_cost(i, x, data, work)

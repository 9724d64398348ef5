"""Cost and gradient of a policy over blocks that nothing couples: the block form of scheduling/sweep.py.

Lemma. Where A, Xi, Sigma0 and every L_j = C_j' Theta_j^-1 C_j are block diagonal, so is the covariance for every
schedule. The weights W and R need not be: tr(W S) = sum_b tr(W_bb S_b), and only the diagonal blocks of the costate
enter, P_bb- = K_b' P_bb K_b, P_bb <- F_b' P_bb- F_b + R_bb. So

    J = sum_e price_e v_e + sum_b J_b(v),     dJ/dv_e = price_e - h sum_{b seen by e} tr(L_eb S_b+ P_bb S_b+)

and every block is swept by itself, forwards and backwards, in memory that stays in the cache.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from copy import copy
from dataclasses import replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from occontrol.scheduling.blocks.exchanges import BlockExchanges
from occontrol.scheduling.blocks.kernels import sweep_lanes
from occontrol.scheduling.blocks.lanes import BlockGroup, lanes_of
from occontrol.scheduling.vectors import WIDTH

WORTH_THREADS = 2e6  # lanes times steps times states squared, below which one thread is faster


def thread_count() -> int:
    """The processors that this process may use; NUMBA_NUM_THREADS, where it is set, limits them."""
    available = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    stated = os.environ.get("NUMBA_NUM_THREADS", "")
    return max(1, min(available, int(stated))) if stated.isdigit() else max(1, available)


class BlockSweep:
    """Cost and gradient of policies, with all blocks laid out once; an Objective.

    `forward_count` and `backward_count` count sweeps, `block_costs` holds what each block of the last sweep costs.

    Parameters
    ----------
    groups : BlockGroups, one for each size of block
    steps : (K,) lengths h
    charges : (K, 2) factors of tr(R S-) and tr(R S+) in the running cost
    price : (N, M) or (E, 1) what a weight of one costs by itself, alpha q h; its shape is that of the policies
    threads : how many may work at the same time; None: as many as there are processors
    """

    def __init__(
        self,
        groups: Sequence[BlockGroup],
        steps: np.ndarray,
        charges: np.ndarray,
        price: np.ndarray,
        threads: int | None = None,
    ):
        self.steps, self.charges = np.ascontiguousarray(steps), np.ascontiguousarray(charges)
        self.price = np.ascontiguousarray(price, dtype=float)
        self.lanes = [lanes_of(group, len(steps), price.size) for group in groups if len(group)]
        self.threads = thread_count() if threads is None else threads
        self.forward_count = self.backward_count = 0
        self._costs = [np.zeros((lanes.groups, WIDTH)) for lanes in self.lanes]
        self._weights = np.zeros(price.size + 1)
        self._pool = None

    @property
    def shape(self) -> tuple[int, int]:
        """That of the policies."""
        return self.price.shape  # type: ignore[return-value]

    @property
    def states(self) -> int:
        """n of the whole plant."""
        return sum(lanes.states * len(lanes.group) for lanes in self.lanes)

    @property
    def blocks(self) -> int:
        """How many blocks there are."""
        return sum(len(lanes.group) for lanes in self.lanes)

    @property
    def block_costs(self) -> list[np.ndarray]:
        """(B,) of every group: what its blocks cost in the last sweep, without prices of weights."""
        return [c.reshape(-1)[: len(lanes.group)] for c, lanes in zip(self._costs, self.lanes, strict=True)]

    @property
    def bytes(self) -> int:
        """Memory of what is laid out, without policies and gradients."""
        return sum(lanes.bytes for lanes in self.lanes)

    def without_running(self) -> BlockSweep:
        """The same with what is charged at the end alone, and without prices."""
        other = copy(self)
        other.lanes = [replace(lanes, R=lanes.R[:0]) for lanes in self.lanes]
        other.price, other._costs = np.zeros_like(self.price), [np.zeros_like(c) for c in self._costs]
        return other

    def release(self) -> None:
        """Forget the lists of uses, which are laid out by now: nothing but sweeps can follow."""
        none = np.zeros(0, dtype=np.int32)
        empty = {"block": none, "step": none, "entry": none, "row": none}
        self.lanes = [replace(lanes, group=replace(lanes.group, **empty)) for lanes in self.lanes]

    @cached_property
    def exchanges(self) -> BlockExchanges:
        """Of whole policies (K, M); only where every decision is one step."""
        return BlockExchanges([lanes.group for lanes in self.lanes], self.steps, self.charges, self.price)

    def cost(self, weights: np.ndarray) -> float:
        """J of a policy, `weights` of the shape of the prices (N, M)."""
        self.forward_count += 1
        self._run(weights, None)
        return self._total(weights)

    def cost_and_gradient(self, weights: np.ndarray) -> tuple[float, np.ndarray]:
        """J and dJ/dv (N, M) of a policy, `weights` (N, M)."""
        self.forward_count += 1
        self.backward_count += 1
        gradient = np.empty(self.price.size + 1)
        gradient[:-1] = self.price.reshape(-1)
        gradient[-1] = 0.0
        self._run(weights, gradient)
        return self._total(weights), gradient[:-1].reshape(self.shape)

    def _total(self, weights: np.ndarray) -> float:
        return float(np.vdot(self.price, weights)) + float(sum(np.sum(c) for c in self._costs))

    def _run(self, weights: np.ndarray, gradient: np.ndarray | None) -> None:
        self._weights[:-1] = np.ravel(weights)
        tasks = []
        for i, lanes in enumerate(self.lanes):
            work = lanes.groups * len(self.steps) * lanes.states**2 * WIDTH
            several = self.threads > 1 and work > WORTH_THREADS
            tasks += [[(i, *span) for span in _spans(lanes.cuts, self.threads if several else 1)]]
        for of_group in tasks:  # two groups may share weights
            if len(of_group) == 1:
                i, a, b = of_group[0]
                self._part(i, a, b, gradient)
                continue
            self._pool = self._pool or ThreadPoolExecutor(self.threads)
            for done in [self._pool.submit(self._part, i, a, b, gradient) for i, a, b in of_group]:
                done.result()

    def _part(self, i: int, first: int, last: int, gradient: np.ndarray | None) -> None:
        lanes, K = self.lanes[i], len(self.steps)
        n, rows, keep = lanes.states, lanes.group.per_use, gradient is not None
        kept = np.empty((K if keep else 0) * n * n * WIDTH)
        most = max(1, lanes.most * rows)
        work = np.empty((3 * n * n + 3 * n + 1 + (3 * n + 1) * most) * WIDTH)
        sweep_lanes(
            first, last, n, rows, lanes.initial, lanes.F, lanes.Q, lanes.group.predict, lanes.terminal, lanes.R,
            lanes.group.running_set, self.charges, self.steps, lanes.slots, lanes.entry, lanes.row,
            lanes.group.rows.reshape(-1), self._weights, keep, self._weights[:0] if gradient is None else gradient,
            self._costs[i].reshape(-1), kept, work, most,
        )  # fmt: skip


def _spans(cuts: np.ndarray, threads: int) -> list[tuple[int, int]]:
    """At most `threads` stretches of lane groups of about equal length, parted at cuts."""
    last = int(cuts[-1])
    near = np.searchsorted(cuts, np.arange(1, threads) * last / threads)
    bounds = np.unique(np.concatenate([[0], cuts[np.minimum(near, len(cuts) - 1)], [last]]))
    return [(int(a), int(b)) for a, b in pairwise(bounds)]

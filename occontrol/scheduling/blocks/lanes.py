"""Independent blocks of one size, laid out so that eight of them are eight lanes of one vector."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numba import njit

from occontrol.scheduling.vectors import WIDTH

_OPTIONS = {"cache": True, "nogil": True, "error_model": "numpy"}


@dataclass(frozen=True, eq=False)
class BlockGroup:
    """B blocks of n states each, which nothing couples, over the same K steps.

    Parameters
    ----------
    initial, terminal : (B, n, n) covariance before predict 0, and weight on that after predict K
    transition, noise : (B, U, n, n) distinct F and Q of the predicts
    predict : (K+1,) which of the U belongs to predict k
    running : (B, V, n, n) distinct R; V may be 0
    running_set : (K,) which of the V is charged at step k
    rows : (T, n) scaled rows Theta^{-1/2} C; the `per_use` rows of one use stand together, filled up with zeros
    per_use : rows of one use
    block, step, entry, row : (A,) the uses: a block may be measured at a step with weight number `entry`, and the
        scaled rows of that are rows[row : row + per_use]
    whole : (B,) blocks with the same number share weights; ascending
    """

    initial: np.ndarray
    terminal: np.ndarray
    transition: np.ndarray
    noise: np.ndarray
    predict: np.ndarray
    running: np.ndarray
    running_set: np.ndarray
    rows: np.ndarray
    per_use: int
    block: np.ndarray
    step: np.ndarray
    entry: np.ndarray
    row: np.ndarray
    whole: np.ndarray

    @property
    def states(self) -> int:
        """n"""
        return self.initial.shape[1]

    def __len__(self) -> int:
        return len(self.initial)


@dataclass(frozen=True, eq=False)
class Lanes:
    """A BlockGroup as the kernels read it.

    Parameters
    ----------
    group : what it was made of
    states, groups : n, and how many times eight blocks there are
    initial, terminal, F, Q, R : flat, the eight lanes last
    slots : (G, K+1) where the slots of a step begin
    entry, row : (S, WIDTH) weight and first row of every lane of a slot
    cuts : lane groups at which two threads may part, the first and the last among them
    """

    group: BlockGroup
    states: int
    groups: int
    initial: np.ndarray = field(repr=False)
    terminal: np.ndarray = field(repr=False)
    F: np.ndarray = field(repr=False)
    Q: np.ndarray = field(repr=False)
    R: np.ndarray = field(repr=False)
    slots: np.ndarray = field(repr=False)
    entry: np.ndarray = field(repr=False)
    row: np.ndarray = field(repr=False)
    cuts: np.ndarray = field(repr=False)

    @property
    def most(self) -> int:
        """The largest number of slots of a step."""
        return int(np.max(np.diff(self.slots, axis=1), initial=0))

    @property
    def bytes(self) -> int:
        """Memory of what is laid out."""
        arrays = (self.initial, self.terminal, self.F, self.Q, self.R, self.slots, self.entry, self.row)
        return sum(a.nbytes for a in arrays)


def lanes_of(group: BlockGroup, steps: int, entries: int) -> Lanes:
    """The blocks of a group as lanes.

    Parameters
    ----------
    group : BlockGroup
    steps : K
    entries : E, how many weights there are; E itself stands for none
    """
    B, G = len(group), -(-len(group) // WIDTH)
    slots = np.zeros((G, steps + 1), dtype=np.int64)
    count = np.zeros((B, steps), dtype=np.int32)
    block, step = np.asarray(group.block, np.int32), np.asarray(group.step, np.int32)
    _count(block, step, count, slots)
    total = int(slots[-1, -1]) if G else 0
    entry, row = np.full((total, WIDTH), entries, dtype=np.int32), np.zeros((total, WIDTH), dtype=np.int32)
    count[:] = 0
    _fill(block, step, np.asarray(group.entry, np.int32), np.asarray(group.row, np.int32), count, slots, entry, row)
    starts = np.arange(G) * WIDTH
    apart = group.whole[starts[1:]] != group.whole[starts[1:] - 1]
    return Lanes(
        group, group.states, G, _laid(group.initial), _laid(group.terminal), _laid(group.transition),
        _laid(group.noise), _laid(group.running), slots, entry, row,
        np.concatenate([[0], np.flatnonzero(apart) + 1, [G]]),
    )  # fmt: skip


def uses_of(lanes: Lanes, b: int, entries: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Step, weight number and first row of every use of one block, in the order of time.

    Parameters
    ----------
    lanes : Lanes
    b : number of the block
    entries : E, how many weights there are
    """
    g, lane = divmod(b, WIDTH)
    slots = lanes.slots[g]
    entry, row = lanes.entry[slots[0] : slots[-1], lane], lanes.row[slots[0] : slots[-1], lane]
    used = entry < entries
    return np.repeat(np.arange(len(slots) - 1), np.diff(slots))[used], entry[used], row[used]


def _laid(array: np.ndarray) -> np.ndarray:
    """(B, ..) -> flat (G, .., WIDTH), filled up with zeros."""
    B = len(array)
    G = -(-B // WIDTH)
    full = np.zeros((G * WIDTH, *array.shape[1:]))
    full[:B] = array
    return np.ascontiguousarray(np.moveaxis(full.reshape(G, WIDTH, *array.shape[1:]), 1, -1)).reshape(-1)


@njit(**_OPTIONS)
def _count(block, step, count, slots):
    """slots (G, K+1) <- the first slot of every step: as many slots as the busiest of the eight lanes needs."""
    G, K = slots.shape[0], slots.shape[1] - 1
    for a in range(len(block)):
        count[block[a], step[a]] += 1
    at = 0
    for g in range(G):
        for k in range(K):
            slots[g, k] = at
            most = 0
            for b in range(8 * g, min(8 * g + 8, count.shape[0])):
                most = max(most, count[b, k])
            at += most
        slots[g, K] = at


@njit(**_OPTIONS)
def _fill(block, step, entry, row, count, slots, entries, rows):
    """Put every use into the next slot of its lane."""
    for a in range(len(block)):
        b, k = block[a], step[a]
        s = slots[b // 8, k] + count[b, k]
        count[b, k] += 1
        entries[s, b % 8] = entry[a]
        rows[s, b % 8] = row[a]

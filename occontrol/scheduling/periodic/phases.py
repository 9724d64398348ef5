"""Which letters there are at which step, where that repeats: windows that come again and again.

Step k has the letters of phase k mod P. Cycles are then multiples of P long, shares are shares of every phase, and a
proof has a tree for every phase that a word can begin in.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np


@dataclass(frozen=True, eq=False)
class Phases:
    """The letters of every phase.

    Parameters
    ----------
    opened : (P, A) whether there is a letter at a phase; at least one at each

    Raises ValueError for a phase without a letter.
    """

    opened: np.ndarray

    def __post_init__(self) -> None:
        opened = np.ascontiguousarray(self.opened, dtype=bool)
        if opened.ndim != 2 or not np.all(np.any(opened, axis=1)):
            raise ValueError("every phase has a letter")
        object.__setattr__(self, "opened", opened)

    @property
    def count(self) -> int:
        """The number P of phases."""
        return len(self.opened)

    @cached_property
    def listed(self) -> tuple[tuple[int, ...], ...]:
        """The letters of every phase, in order."""
        return tuple(tuple(int(a) for a in np.flatnonzero(row)) for row in self.opened)

    @cached_property
    def patterns(self) -> tuple[np.ndarray, np.ndarray]:
        """The distinct rows of `opened` (C, A), and the share (C,) of the phases that have each."""
        rows, times = np.unique(self.opened, axis=0, return_counts=True)
        return rows, times / self.count

    def at(self, step: int) -> tuple[int, ...]:
        """The letters at a step."""
        return self.listed[step % self.count]

    def words(self, length: int) -> int:
        """How many words of a length there are that begin at phase 0."""
        found = 1
        for k in range(length):
            found *= len(self.at(k))
        return found

    def canonical(self, word: tuple[int, ...]) -> tuple[int, ...]:
        """The same cycle, as short as it can be written, moved by whole rounds to the first in the alphabet."""
        p, P = len(word), self.count
        for d in range(P, p + 1, P):
            if p % d == 0 and word == word[:d] * (p // d):
                word = word[:d]
                break
        return min(word[k:] + word[:k] for k in range(0, len(word), P))

    def drawn(self, random: np.random.Generator) -> tuple[int, ...]:
        """A word of one round of phases, drawn with `random`."""
        return tuple(int(random.choice(letters)) for letters in self.listed)

    def changed(self, pool: list[tuple[int, ...]], most: int, random: np.random.Generator) -> tuple[int, ...]:
        """A cycle made of one or two of a pool, a few letters exchanged; phases are kept.

        Parameters
        ----------
        pool : words that fit
        most : longest cycle
        random : generator
        """
        word, P = list(pool[int(random.integers(len(pool)))]), self.count
        if random.random() < 0.3:
            other = pool[int(random.integers(len(pool)))]
            shift = P * int(random.integers(len(other) // P))
            word += list(other[shift:] + other[:shift])
        for _ in range(int(random.integers(1, 4))):
            k = int(random.integers(len(word)))
            word[k] = int(random.choice(self.at(k)))
        return tuple(word) if len(word) <= most else ()


def always(letters: int) -> Phases:
    """One phase that has all `letters`."""
    return Phases(np.ones((1, letters), dtype=bool))

"""The bound on schedules of whole looks, by all targets together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from occontrol.core.spread import HERE, Spread
from occontrol.scheduling.blocks.resources import ResourceSet
from occontrol.scheduling.whole.certificate import Chunk, Tangents, answer, joined
from occontrol.scheduling.whole.courses import Course
from occontrol.scheduling.whole.prices import Answer, Found, Lines, raise_bound

FACTOR = 1.6  # between two scales of the first prices that are tried
ROUGH = 4e-3  # the gap with the floor alone
SPACING = 0.5, 0.75, 1.0, 1.3  # of the visits behind a level, in those of the plan at hand


@dataclass(frozen=True)
class Effort:
    """How much is spent on a bound.

    Parameters
    ----------
    rounds : prices that are tried
    gap : relative, what the lines of all plans still expect to gain
    exact : beginnings of a target up to which its minimum is exact
    levels : what was known before a visit is told apart by so many levels beside the floor, at most; 0: none
    """

    rounds: int = 60
    gap: float = 2e-3
    exact: int = 0
    levels: int = len(SPACING)


class WholeLooks:
    """All targets of a problem, to be asked at prices.

    Parameters
    ----------
    courses : of every target
    allowed : ResourceSet of the schedules
    tangents : of the relaxed optimum, or None
    effort : Effort
    spread : where the targets are asked
    """

    def __init__(
        self,
        courses: Sequence[Course],
        allowed: ResourceSet,
        tangents: Tangents | None,
        effort: Effort,
        spread: Spread = HERE,
    ):
        self.allowed, self.effort, self.spread = allowed, effort, spread
        self.stretch = np.repeat(np.arange(len(allowed.capacity)), np.diff(allowed.starts))
        self._hold(Chunk(courses, np.arange(len(courses)), self.stretch, tangents, effort.exact))

    def _hold(self, chunk: Chunk) -> None:
        self.chunk = chunk
        self._ask = self.spread.hold(answer, [chunk] if self.spread.count == 1 else chunk.parts(self.spread.count))

    @property
    def capacity(self) -> np.ndarray:
        """(S,) looks of every stretch."""
        return self.allowed.capacity

    def ask(self, prices: np.ndarray) -> Answer:
        """What all targets answer to prices (S,)."""
        return joined(self._ask(prices))

    def bound(self, start: np.ndarray, stop: Callable[[Found], bool] = lambda found: False) -> Found:
        """The largest bound that is found, from prices `start` (S,) on: from the floor, then with levels.

        Parameters
        ----------
        start : (S,) prices, such as those of the relaxed optimum
        stop : whether to leave earlier
        """
        e, lines = self.effort, self._lines()
        exactly = e.exact > 0 and self.chunk.exactly
        rough = max(e.gap, ROUGH) if e.levels and not exactly else e.gap
        found, best = self._scaled(start, lines)
        if not stop(found):
            found = _better(found, raise_bound(self.ask, lines, best, e.rounds - found.rounds, rough, stop))
        if e.levels and not exactly and not stop(found):
            self._hold(replace(self.chunk, every=self._every(found.prices)))
            found = _better(found, raise_bound(self.ask, self._lines(), found.prices, e.rounds, e.gap, stop))
        return found

    def _lines(self) -> Lines:
        return Lines(len(self.chunk.courses), self.capacity)

    def _every(self, prices: np.ndarray) -> list[tuple[int, ...]]:
        """Levels around how often each target is looked at, at prices."""
        given, found = self.ask(prices), []
        for course, line in zip(self.chunk.courses, given.plans, strict=True):
            between = len(course.interval) / (len(line.at) + 1)
            spaced = {max(1, round(x * between)) for x in SPACING[: self.effort.levels]}
            found.append(tuple(sorted(spaced | {1})))
        return found

    def _scaled(self, start: np.ndarray, lines: Lines) -> tuple[Found, np.ndarray]:
        """The best multiple of prices: D is concave along them."""
        found, scale = Found(start), 1.0
        for _ in range(8):
            prices = scale * start
            given = self.ask(prices)
            lines.add(given)
            found.rounds += 1
            value = float(np.sum(given.bounds) - prices @ self.capacity)
            if value <= found.bound:
                break
            found.bound, found.prices, found.bounds = value, prices, given.bounds
            scale *= FACTOR
        return found, found.prices


def _better(one: Found, other: Found) -> Found:
    """The larger bound of two, with the rounds of both."""
    found = other if other.bound >= one.bound else one
    return replace(found, rounds=one.rounds + other.rounds)


def relaxed_prices(gradient: np.ndarray, allowed: ResourceSet) -> np.ndarray:
    """(S,) what one more look on every stretch would save to first order.

    Parameters
    ----------
    gradient : (E, 1) of the cost of a relaxed optimum
    allowed : ResourceSet
    """
    found, g = np.zeros(len(allowed.capacity)), gradient[:, 0]
    for s, c in enumerate(allowed.capacity):
        a, b = int(allowed.starts[s]), int(allowed.starts[s + 1]) - 1
        if b - a > c:
            found[s] = max(0.0, -float(np.partition(g[a:b], c)[c]))
    return found

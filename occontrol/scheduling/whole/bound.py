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


@dataclass(frozen=True)
class Effort:
    """How much is spent on a bound.

    Parameters
    ----------
    rounds : prices that are tried
    gap : relative, what the lines of all plans still expect to gain
    exact : beginnings of a target up to which its minimum is exact
    buckets : labels of a visit that stay apart, in the last rounds; 0: none
    labels : in all, at most so many, or so many a visit, whichever is more
    per_visit : see labels
    """

    rounds: int = 60
    gap: float = 1e-3
    exact: int = 0
    buckets: int = 32
    labels: int = 400_000
    per_visit: int = 60


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
        self.allowed, self.effort = allowed, effort
        self.stretch = np.repeat(np.arange(len(allowed.capacity)), np.diff(allowed.starts))
        self.chunk = Chunk(courses, np.arange(len(courses)), self.stretch, tangents, effort.exact)
        self._ask = spread.hold(answer, [self.chunk] if spread.count == 1 else self.chunk.parts(spread.count))

    @property
    def capacity(self) -> np.ndarray:
        """(S,) looks of every stretch."""
        return self.allowed.capacity

    def ask(self, prices: np.ndarray, buckets: int = 0) -> Answer:
        """What all targets answer to prices (S,), with labels where there are buckets."""
        return joined(self._ask(prices, buckets))

    def bound(self, start: np.ndarray, stop: Callable[[Found], bool] = lambda found: False) -> Found:
        """The largest bound that is found, from prices `start` (S,) on: with the forgetful programme, then with labels.

        Parameters
        ----------
        start : (S,) prices, such as those of the relaxed optimum
        stop : whether to leave earlier
        """
        lines = Lines(len(self.chunk.courses), self.capacity)
        found, best = self._scaled(start, lines)
        e = self.effort
        if not stop(found):
            found = _better(found, raise_bound(self.ask, lines, best, e.rounds - found.rounds, e.gap, stop))
        if not e.buckets or (e.exact and self.chunk.exactly) or stop(found):
            return found
        spent, most = 0, max(e.labels, e.per_visit * sum(len(c.member) - 1 for c in self.chunk.courses))

        def with_labels(prices: np.ndarray) -> Answer:
            nonlocal spent
            given = self.ask(prices, e.buckets)
            spent += given.labels
            return given

        def enough(now: Found) -> bool:
            return stop(now) or spent + spent / now.rounds > most

        return _better(found, raise_bound(with_labels, lines, found.prices, e.rounds, e.gap, enough))

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

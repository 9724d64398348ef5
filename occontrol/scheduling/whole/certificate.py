"""What a few targets say to prices: bounds and how often they want to be looked at. Plain data in, plain data out.

    J* >= sum_i m_i(lam) - sum_s lam_s c_s,     lam >= 0,

whatever m_i is below what target i costs at prices lam. Targets may be asked anywhere, in any order and at any time;
what they answer to the same prices adds up. m_i is the larger of two bounds: that of whole looks (forgetful.py,
exact where the target is small), and that of the tangent of its cost at shares v of looks,

    m_i >= J_i(v) - g_i.v + sum_e min(0, g_e + lam_e).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from occontrol.scheduling.whole.courses import Course
from occontrol.scheduling.whole.forgetful import Plan, cost_of, plan
from occontrol.scheduling.whole.prefixes import Beginnings, beginnings
from occontrol.scheduling.whole.prices import Answer, Line
from occontrol.scheduling.whole.tables import Tables, tables


@dataclass(frozen=True, eq=False)
class Tangents:
    """A tangent of the cost of every target, where shares of looks are allowed.

    Parameters
    ----------
    base : (T,) J_i(v) - g_i.v, with what looks cost by themselves
    slope : (E,) g
    """

    base: np.ndarray
    slope: np.ndarray


@dataclass(frozen=True, eq=False)
class Chunk:
    """Some targets of a problem; picklable.

    Parameters
    ----------
    courses : of the targets
    numbers : (T,) their numbers in the whole problem
    stretch : (E,) number of the stretch of every look of the problem
    tangents : of all targets of the problem, or None
    exact : beginnings of a target up to which its minimum is exact; 0 for none
    every : of the levels of every target, see levels.py; without them the floor alone
    """

    courses: Sequence[Course]
    numbers: np.ndarray
    stretch: np.ndarray
    tangents: Tangents | None = None
    exact: int = 0
    every: Sequence[tuple[int, ...]] | None = None

    @cached_property
    def known(self) -> list[Beginnings | Tables]:
        """What each target is worked out from; made once."""
        every = [(1,)] * len(self.courses) if self.every is None else self.every
        return [beginnings(c, self.exact) or tables(c, e) for c, e in zip(self.courses, every, strict=True)]

    @cached_property
    def exactly(self) -> bool:
        """Whether all minima are exact."""
        return all(isinstance(t, Beginnings) for t in self.known)

    def parts(self, count: int) -> list[Chunk]:
        """The same targets in at most `count` chunks of about equal work, in their order."""
        work = np.cumsum([len(c.member) ** 2 for c in self.courses])
        cuts = np.searchsorted(work, work[-1] * np.arange(1, count) / count) + 1 if len(work) else []
        ends = np.unique(np.concatenate([[0], cuts, [len(self.courses)]])).astype(int)
        every = self.every
        return [
            replace(
                self, courses=self.courses[a:b], numbers=self.numbers[a:b], every=None if every is None else every[a:b]
            )
            for a, b in pairwise(ends)
        ]


def answer(chunk: Chunk, prices: np.ndarray) -> Answer:
    """Bounds and plans of targets at prices of looks.

    Parameters
    ----------
    chunk : Chunk
    prices : (S,) lam >= 0 of every stretch
    """
    each = prices[chunk.stretch]
    bounds, plans, lines = np.empty(len(chunk.courses)), [], []
    for i, (course, table) in enumerate(zip(chunk.courses, chunk.known, strict=True)):
        due = course.dues(each)
        if isinstance(table, Beginnings):
            bounds[i], visits = table.best(due)
        else:
            found = plan(course, table, due)
            bounds[i], visits = found.bound, found.visits
        taken = chunk.stretch[course.entry[course.looks_of(visits)]]
        plans.append(Line(real_cost(course, visits), taken, np.ones(len(taken))))
        shown = (plans[-1] if isinstance(table, Beginnings) else _mixture(chunk, course, found, each),)
        if chunk.tangents is not None:
            g = chunk.tangents.slope[course.entry]
            u = g + each[course.entry] < 0.0
            base, at = float(chunk.tangents.base[chunk.numbers[i]] + np.sum(g[u])), chunk.stretch[course.entry[u]]
            bounds[i] = max(bounds[i], base + float(np.sum(prices[at])))
            shown = (*shown, Line(base, at, np.ones(len(at))))
        lines.append(shown)
    return Answer(bounds, plans, lines)


def _mixture(chunk: Chunk, course: Course, found: Plan, each: np.ndarray) -> Line:
    """The line of what the forgetful programme says. Of several looks at once the cheapest two pay."""
    often = np.zeros(len(course.entry))
    due = course.price + each[course.entry]
    for v in np.flatnonzero(found.often):
        looks = course.look[course.member[v] : course.member[v + 1]]
        often[looks[np.argsort(due[looks])[:2]]] += found.often[v]
    used = np.flatnonzero(often)
    height = found.bound - float(often[used] @ each[course.entry[used]])
    return Line(height, chunk.stretch[course.entry[used]], often[used])


def joined(answers: Sequence[Answer]) -> Answer:
    """The answers of consecutive chunks as those of all their targets.

    Parameters
    ----------
    answers : to the same prices
    """
    if len(answers) == 1:
        return answers[0]
    return Answer(
        np.concatenate([given.bounds for given in answers]),
        [line for given in answers for line in given.plans],
        [lines for given in answers for lines in given.lines],
    )


def visit_counts(answers: Sequence[Answer], stretches: int) -> np.ndarray:
    """(S,) looks that the plans of all answers take on every stretch.

    Parameters
    ----------
    answers : of chunks
    stretches : S
    """
    found = np.zeros(stretches)
    for given in answers:
        for line in given.plans:
            np.add.at(found, line.at, line.share)
    return found


def combined(answers: Sequence[Answer], prices: np.ndarray, capacity: np.ndarray) -> float:
    """The lower bound that answers of all targets to the same prices prove.

    Parameters
    ----------
    answers : of chunks that hold every target once
    prices, capacity : (S,) of the stretches
    """
    return float(sum(np.sum(given.bounds) for given in answers) - prices @ capacity)


def real_cost(course: Course, visits: np.ndarray) -> float:
    """What a target costs with visits (n,), with what its looks cost by themselves.

    Parameters
    ----------
    course : Course
    visits : (n,) ascending
    """
    return cost_of(course, visits) + float(np.sum(course.price[course.looks_of(visits)]))

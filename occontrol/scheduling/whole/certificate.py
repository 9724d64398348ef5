"""What a few targets say to prices: bounds and how often they want to be looked at. Plain data in, plain data out.

    J* >= sum_i m_i(lam) - sum_s lam_s c_s,     lam >= 0,

whatever m_i is below what target i costs at prices lam. Targets may be asked anywhere, in any order and at any time;
what they answer to the same prices adds up. m_i is the larger of two bounds: that of whole looks (forgetful.py,
labels.py, exact where the target is small), and that of the tangent of its cost at shares v of looks,

    m_i >= J_i(v) - g_i.v + sum_e min(0, g_e + lam_e).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from occontrol.scheduling.whole.courses import Course
from occontrol.scheduling.whole.forgetful import cost_of, plan
from occontrol.scheduling.whole.labels import refined
from occontrol.scheduling.whole.prefixes import Beginnings, beginnings
from occontrol.scheduling.whole.prices import Answer
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
    """

    courses: Sequence[Course]
    numbers: np.ndarray
    stretch: np.ndarray
    tangents: Tangents | None = None
    exact: int = 0

    @cached_property
    def known(self) -> list[Beginnings | Tables]:
        """What each target is worked out from; made once."""
        return [beginnings(c, self.exact) or tables(c) for c in self.courses]

    @cached_property
    def exactly(self) -> bool:
        """Whether all minima are exact."""
        return all(isinstance(t, Beginnings) for t in self.known)

    def parts(self, count: int) -> list[Chunk]:
        """The same targets in at most `count` chunks of about equal work, in their order."""
        work = np.cumsum([len(c.member) ** 2 for c in self.courses])
        cuts = np.searchsorted(work, work[-1] * np.arange(1, count) / count) + 1 if len(work) else []
        ends = np.unique(np.concatenate([[0], cuts, [len(self.courses)]])).astype(int)
        return [
            Chunk(self.courses[a:b], self.numbers[a:b], self.stretch, self.tangents, self.exact)
            for a, b in pairwise(ends)
        ]


def answer(chunk: Chunk, prices: np.ndarray, buckets: int = 0) -> Answer:
    """Bounds and plans of targets at prices of looks.

    Parameters
    ----------
    chunk : Chunk
    prices : (S,) lam >= 0 of every stretch
    buckets : labels of a visit that stay apart (labels.py); 0: no labels
    """
    each = prices[chunk.stretch]
    bounds, costs, stretches, labels = np.empty(len(chunk.courses)), np.empty(len(chunk.courses)), [], 0
    for i, (course, table) in enumerate(zip(chunk.courses, chunk.known, strict=True)):
        due = course.dues(each)
        if isinstance(table, Beginnings):
            bounds[i], visits = table.best(due)
        else:
            found = plan(course, table, due)
            if buckets:
                ceiling = cost_of(course, found.visits) + float(np.sum(due[found.visits]))
                found, count = refined(course, table, due, ceiling, buckets, found)
                labels += count
            bounds[i], visits = found.bound, found.visits
        costs[i] = real_cost(course, visits)
        stretches.append(chunk.stretch[course.entry[course.looks_of(visits)]])
        if chunk.tangents is not None:
            g = chunk.tangents.slope[course.entry] + each[course.entry]
            bounds[i] = max(bounds[i], chunk.tangents.base[chunk.numbers[i]] + np.sum(np.minimum(g, 0.0)))
    return Answer(bounds, costs, stretches, labels)


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
        np.concatenate([given.costs for given in answers]),
        [stretch for given in answers for stretch in given.stretches],
        sum(given.labels for given in answers),
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
        for at in given.stretches:
            np.add.at(found, at, 1.0)
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

"""Anybody's cycle as a word: a schedule over one cycle, its changes at multiples of the step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from occontrol.core.errors import Collector, ProblemError, suggest
from occontrol.core.reading_schedule import Reading, readings_of
from occontrol.core.schedule import INTEGER, Schedule

if TYPE_CHECKING:
    from occontrol.families.athans.periodic.problem import PeriodicProblem

MOST_STEPS = 10_000
NEAR = 1e-6  # of a step: what times may be off


def cycle_from(problem: PeriodicProblem, entries: Sequence[Reading]) -> Schedule:
    """One cycle from what anybody wrote.

    Parameters
    ----------
    problem : PeriodicProblem
    entries : from the start of the cycle, 0; single steps, or segments of time for continuous sensing

    Raises ProblemError for times that are no multiples of the step, steps without an entry, wrong numbers of sensors.
    """
    found, steps, h, t = Collector(), [], problem.step, problem.variable
    for entry in entries:
        ends = (entry.start, entry.end if problem.sensing == "rate" else entry.end + h)
        first, last = (round(x / h) for x in ends)
        for x, k in zip(ends, (first, last), strict=True):
            if abs(x / h - k) > NEAR and not found.mistakes:
                what = f"the schedule changes at {t} = {x:.9g}, which is no multiple of the step {h:g}"
                found.add((), what, "one cycle, from 0 on")
        if not found.mistakes and not 0 <= first < last <= MOST_STEPS:
            found.add((), f"an entry goes from {t} = {ends[0]:.9g} to {ends[1]:.9g}", f"0 to {MOST_STEPS * h:g}")
        steps.append(replace(entry, start=first * h, end=(last - 1) * h))
        if found.mistakes:
            raise ProblemError([replace(m, place=entry.place) for m in found.mistakes])
    if not steps:
        raise ProblemError("the schedule has no entry", "one cycle, from 0 on")
    period = round(max(e.end for e in steps) / h) + 1
    names = tuple(problem.sensors.names)
    weights = readings_of(steps, h * np.arange(period), names, problem.select, t)
    return problem.make_schedule(h * np.arange(period + 1), weights)


def word_of(problem: PeriodicProblem, schedule: Schedule) -> np.ndarray:
    """The letters (p,) of a schedule over one cycle.

    Parameters
    ----------
    problem : PeriodicProblem
    schedule : on steps of one cycle, sensors in any order

    Raises ProblemError where a step uses sensors that are no choice of the problem, or only a share of one.
    """
    index = {frozenset(choice): a for a, choice in enumerate(problem.choices)}
    idle = {s.name for s in problem.sensors if s.is_idle}
    known, letters = set(problem.sensors.names), []
    for k, row in enumerate(schedule.weights):
        at = f"{problem.variable} = {schedule.edges[k]:.9g}"
        used = [name for name, x in zip(schedule.names, row, strict=True) if x > INTEGER]
        for name in used:
            if name not in known:
                raise ProblemError(f"there is no sensor '{name}'", suggest(name, list(known)))
        if any(abs(x - round(float(x))) > INTEGER for x in row):
            raise ProblemError(f"a sensor is used for a share of its time at {at}", "a cycle has whole steps")
        letter = index.get(frozenset(used) - idle)
        if letter is None:
            raise ProblemError(f"{'+'.join(used) or 'nothing'} at {at} is no choice of this problem", "see select")
        letters.append(letter)
    return np.array(letters, dtype=np.int64)

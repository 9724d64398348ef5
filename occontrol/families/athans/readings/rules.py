"""Rules on readings: which of them a clock knows, and what the search under rules asks of a problem.

In discrete time rules count in steps, with samples in readings; max_uses counts readings on both.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from occontrol.core.errors import ProblemError
from occontrol.families.athans.readings.fill import feasible_set
from occontrol.families.athans.readings.problem import ReadingsProblem
from occontrol.families.athans.rules.certify import broken, require_whole
from occontrol.families.athans.rules.frame import Frame
from occontrol.families.athans.rules.statement import resolve


def require_kept(problem: ReadingsProblem, weights: np.ndarray) -> np.ndarray:
    """The whole weights (E, M), with a sensor in places that a slew leaves empty; ProblemError for what they break.

    Parameters
    ----------
    problem : with rules
    weights : (E, M) of every decision
    """
    whole, allowed = require_whole(weights), feasible_set(problem)
    padded = whole.copy()
    empty = ~np.any(whole > 0, axis=1) & problem.slews
    padded[empty] = allowed.uniform()[empty]
    if wrong := [*allowed.check(padded), *broken(frame_of(problem), whole)]:
        raise ProblemError(wrong)
    return padded


def frame_of(problem: ReadingsProblem) -> Frame:
    """What rules ask of a problem of readings.

    Parameters
    ----------
    problem : ReadingsProblem with E decisions
    """
    clock, first = problem.clock, problem.first_readings
    each = np.diff(np.append(first, problem.readings)).astype(float)
    edges = np.append(first, problem.readings).astype(float) if problem.discrete else np.arange(len(first) + 1.0)
    rules = resolve(problem.rules, problem.sensors, problem.places, float(edges[-1]))
    rules = replace(rules, least=problem.select[0], reads=each, variable=clock.variable)
    prices = np.column_stack([s.cost.sample(clock.times)[:, 0, 0] for s in problem.sensors])
    kind = "the reading" if len(first) == problem.readings else "the epoch that begins"
    return Frame(
        rules,
        edges,
        problem.upper,
        np.add.reduceat(prices, first, axis=0),
        lambda k: f"{kind} at {clock.variable} = {clock.times[first[k]]:.6g}",
        f"{clock.variable} = {clock.times[-1]:.6g}",
    )

"""Anybody's choices, recomputed, beside the bound that the exact search proves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from occontrol.core import stopwatch
from occontrol.core.errors import Mistake, ProblemError
from occontrol.core.monitor import Monitor
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Solution, Status
from occontrol.families.vlambda.baselines import SequenceChooser
from occontrol.families.vlambda.methods import Optimal
from occontrol.families.vlambda.outcome import Outcome, Proof, cost_of
from occontrol.families.vlambda.result import assemble, numbers_of, recorded
from occontrol.families.vlambda.selection import run_selection

if TYPE_CHECKING:
    from occontrol.families.vlambda.problem import Problem

AGREEMENT = 1e-8  # relative; both costs come from the same recursion
PROVEN = 1e-9  # relative; a gap below it is rounding


@dataclass(frozen=True)
class Claims:
    """What a run folder states: its cost, its bound if any, and where its movable sensors were."""

    cost: float
    lower_bound: float | None
    chooser: SequenceChooser


def claims_of(problem: Problem, solution: Solution) -> Claims:
    """The claims of a Solution, for `certify` to check.

    Parameters
    ----------
    problem, solution : of the run
    """
    bound = numbers_of(solution).lower_bound
    return Claims(solution.cost, bound if isinstance(bound, float) else None, recorded(problem, solution))


def certify(problem: Problem, schedule: Schedule, claims: Claims | None = None) -> Solution:
    """Cost of anybody's choices, beside the bound that the exact search proves.

    Parameters
    ----------
    problem : Problem
    schedule : Schedule over k = 0 .. steps that changes only where an epoch begins and uses `select` sensors
    claims : of a run; a cost that cannot be reproduced, or a bound above a known cost, makes the status `disagrees`

    Raises ProblemError when the schedule is not of that kind. Movable sensors stand where the run had them, or are
    placed by the paper's rule; for them no bound is proven, because the search knows only a grid of locations.
    """
    began = stopwatch.seconds()
    chooser = _given(problem, schedule) if claims is None else claims.chooser
    selection = run_selection(problem.sampled, problem.starts, problem.select, chooser)
    cost = cost_of(problem, selection)
    best, proof, message = cost, None, "recomputed; no bound is proven with movable sensors"
    if not problem.movable:
        found = Optimal().run(problem, Monitor())
        best = min(cost, cost_of(problem, found.selection))
        if found.proof is not None:
            proof = Proof(min(found.proof.lower_bound, cost), found.proof.nodes)
        message = "recomputed; the bound is the exact search's"
    proven = proof is not None and cost - proof.lower_bound <= PROVEN * abs(cost)
    status = Status.CERTIFIED if proven else Status.FEASIBLE
    if claims is not None and abs(claims.cost - cost) > AGREEMENT * abs(cost):
        status, message = Status.DISAGREES, f"the run says cost {claims.cost:.10g}, its choices cost {cost:.10g}"
    elif claims is not None and claims.lower_bound is not None and claims.lower_bound > best * (1 + AGREEMENT):
        message = f"the run says that nothing costs less than {claims.lower_bound:.10g}, but {best:.10g} is reached"
        status = Status.DISAGREES
    return assemble(problem, Outcome(selection, status, message, proof), method="given", began=began, monitor=Monitor())


def _given(problem: Problem, schedule: Schedule) -> SequenceChooser:
    groups = []
    for e in range(problem.epochs):
        begin, end = float(problem.starts[e]), float(problem.starts[e + 1])
        inside = (schedule.edges[1:] > begin) & (schedule.edges[:-1] < end)
        weights = schedule.weights[inside]
        if not len(weights) or np.any(np.abs(weights - weights[0]) > 1e-9):
            wrong = "says nothing about" if not len(weights) else "changes inside of"
            what = f"the schedule {wrong} the epoch k = {begin:g} .. {end - 1:g}"
            raise ProblemError(Mistake((), what, f"choices are made every {problem.epoch} steps"))
        group = tuple(int(j) for j in np.flatnonzero(weights[0] > 0.5))
        if len(group) != problem.select or not np.allclose(weights[0][list(group)], 1.0):
            raise ProblemError(
                Mistake((), f"the schedule uses {len(group)} sensors at k = {begin:g}, select is {problem.select}")
            )
        groups.append(group)
    return SequenceChooser(tuple(groups))

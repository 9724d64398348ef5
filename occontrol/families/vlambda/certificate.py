"""Anybody's choices, recomputed, beside the bound that the exact search proves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from occontrol.core import stopwatch
from occontrol.core.claims import Claims, false_claims
from occontrol.core.errors import Mistake, ProblemError
from occontrol.core.monitor import Monitor
from occontrol.core.schedule import INTEGER, Schedule
from occontrol.core.solution import Solution, Status
from occontrol.families.vlambda.baselines import SequenceChooser
from occontrol.families.vlambda.methods import Optimal
from occontrol.families.vlambda.outcome import Outcome, Proof, cost_of, without_rounding
from occontrol.families.vlambda.result import assemble, numbers_of, recorded
from occontrol.families.vlambda.selection import run_selection
from occontrol.files.segments import as_read

if TYPE_CHECKING:
    from occontrol.families.vlambda.problem import Problem

PROVEN = 1e-9  # relative; a gap below it is rounding


def claims_of(problem: Problem, solution: Solution) -> Claims:
    """The claims of a Solution, for `certify` to check.

    Parameters
    ----------
    problem, solution : of the run
    """
    numbers = numbers_of(solution)
    bound, gap = (x if isinstance(x, float) else None for x in (numbers.lower_bound, numbers.relative_gap))
    return Claims(solution.cost, bound, None, gap, choices=recorded(problem, solution))


def certify(problem: Problem, schedule: Schedule, claims: Claims | None = None) -> Solution:
    """Cost of anybody's choices, beside the bound that the exact search proves.

    Parameters
    ----------
    problem : Problem
    schedule : Schedule over k = 0 .. steps that changes only where an epoch begins and uses `select` sensors
    claims : what somebody says of it; refuted claims make the status `disagrees`

    Raises ProblemError when the schedule is not of that kind, in the words of the reader of schedule files. Movable
    sensors stand where the run had them, or are placed by the paper's rule; for them no bound is proven, because the
    search knows only a grid of locations.
    """
    began = stopwatch.seconds()
    chooser = _given(problem, schedule)
    if claims is not None and claims.choices is not None and claims.choices.groups == chooser.groups:
        chooser = claims.choices  # locations included
    selection = run_selection(problem.sampled, problem.starts, problem.select, chooser)
    cost = cost_of(problem, selection)
    best, proof, message = cost, None, "recomputed; no bound is proven with movable sensors"
    if not problem.movable:
        found = Optimal().run(problem, Monitor())
        best = min(cost, cost_of(problem, found.selection))
        if found.proof is not None:
            proof = Proof(without_rounding(found.proof.lower_bound, cost), found.proof.nodes)
        message = "recomputed; the bound is the exact search's"
    proven = proof is not None and cost - proof.lower_bound <= PROVEN * abs(cost)
    status = Status.CERTIFIED if proven else Status.FEASIBLE
    if refuted := [] if claims is None else false_claims(claims, cost, best):
        status, message = Status.DISAGREES, "; ".join(refuted)
    return assemble(problem, Outcome(selection, status, message, proof), method="given", began=began, monitor=Monitor())


def _given(problem: Problem, schedule: Schedule) -> SequenceChooser:
    fitted = as_read(schedule, problem)
    if not fitted.is_integer:
        raise ProblemError("the schedule shares an epoch between sensors", "one choice of sensors per epoch")
    groups = []
    for e in range(problem.epochs):
        begin, end = float(problem.starts[e]), float(problem.starts[e + 1])
        weights = fitted.weights[(fitted.edges[1:] > begin) & (fitted.edges[:-1] < end)]
        if np.any(np.abs(weights - weights[0]) > INTEGER):
            what = f"the schedule changes inside of the epoch k = {begin:g} .. {end - 1:g}"
            raise ProblemError(Mistake((), what, f"choices are made every {problem.epoch} steps"))
        groups.append(tuple(int(j) for j in np.flatnonzero(weights[0] > 0.5)))
    return SequenceChooser(tuple(groups))

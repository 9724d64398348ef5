"""Anybody's cycle, judged: its cost for ever and a lower bound; of a run also its proof, checked anew by other code."""

from __future__ import annotations

import dataclasses

import numpy as np

from occontrol.core import stopwatch
from occontrol.core.claims import Claims, false_claims
from occontrol.core.errors import Mistake, ProblemError
from occontrol.core.monitor import Monitor
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Solution, Status
from occontrol.families.athans.certify import parts_of
from occontrol.families.athans.periodic.limits import broken
from occontrol.families.athans.periodic.method import Periodic
from occontrol.families.athans.periodic.problem import PeriodicProblem
from occontrol.families.athans.periodic.prove import averaged_of, grow_proof, setting_of, unbounded
from occontrol.families.athans.periodic.rounds import out_of_round
from occontrol.families.athans.periodic.solve import PROOF, assemble, shares_of
from occontrol.families.athans.periodic.words import cycle_from, word_of
from occontrol.families.athans.result import AthansResult
from occontrol.files.segments import as_read
from occontrol.scheduling.periodic.certificate import TreeProof, checked_bound, faults
from occontrol.scheduling.periodic.potential import cycle_of

OWN_NODES = 4_000  # words of a proof of our own, for a schedule that brings none
SAME = 1e-9

__all__ = ["certify", "claims_of", "cycle_from"]


def certify(problem: PeriodicProblem, schedule: Schedule, claims: Claims | None = None) -> Solution:
    """Cost, lower bound and gap of anybody's cycle, everything recomputed from problem and schedule.

    Parameters
    ----------
    problem : PeriodicProblem
    schedule : one cycle, sensors in any order
    claims : what a run says of it, with its proof; refuted claims make the status `disagrees`

    Returns a Solution with method "certify". Raises ProblemError for a schedule that is no cycle of this problem,
    InfeasibleError where its covariance has no limit.
    """
    began, monitor, setting = stopwatch.seconds(), Monitor(), setting_of(problem)
    word = word_of(problem, as_read(schedule, problem))
    names = list(problem.sensors.names)
    letters = [int(a) for a in word]
    wrong = out_of_round(problem, letters) + broken(problem.limits, problem.weights_of(letters), names, problem.step)
    if wrong:
        raise ProblemError([Mistake((), what) for what in wrong])
    cycle = cycle_of(setting.letters, word)
    if cycle is None:
        raise unbounded([problem.letters[a] for a in word])
    averaged = averaged_of(problem, setting)
    method = problem.method if isinstance(problem.method, Periodic) else Periodic()
    refuted: list[str] = []
    proof, tree_bound = None, None
    if claims is not None and claims.choices is not None:
        proof = claims.choices
        refuted = faults(proof, setting.filled.letters, setting.phases)
        if not refuted:
            tree_bound = checked_bound(proof, setting.filled.letters, setting.filled.smallest)
            tree_bound = None if not np.isfinite(tree_bound) else tree_bound
    elif claims is None:
        limits = dataclasses.replace(method, max_nodes=OWN_NODES, time_limit=None)
        tree, _ = grow_proof(setting, averaged, cycle, limits, monitor)
        if tree is not None:
            proof = tree.proof(setting.root)
            tree_bound = checked_bound(proof, setting.filled.letters, setting.filled.smallest)
    bounds = {"averaged": averaged.lower_bound, "tree": tree_bound}
    best = max(b for b in bounds.values() if b is not None)
    reached = cycle.cost - best <= method.relative_gap * abs(cycle.cost)
    shares = shares_of(problem, averaged.shares)
    solution = assemble(
        problem, "certify", setting, cycle, bounds, None if refuted else proof,
        Status.CERTIFIED if reached else Status.FEASIBLE, "", {}, shares, monitor, began, 0,
    )  # fmt: skip
    if claims is None or solution.certificate is None:
        return solution
    numbers: AthansResult = solution.numbers  # type: ignore[assignment]
    refuted += false_claims(claims, cycle.cost, cycle.cost, None, parts_of(numbers))
    stated = claims.lower_bound
    if stated is not None and not stated <= best + SAME * abs(best):
        refuted.append(f"the stated lower bound is {stated:.10g}, its proof gives {best:.10g}")
    if refuted:
        return dataclasses.replace(solution, status=Status.DISAGREES, message="; ".join(refuted))
    return solution


def claims_of(solution: Solution) -> Claims:
    """What a run says of its cycle, its proof among it.

    Parameters
    ----------
    solution : of the run
    """
    numbers: AthansResult = solution.numbers  # type: ignore[assignment]
    cost, bound = (None, None) if solution.certificate is None else (solution.cost, solution.certificate.lower_bound)
    gap = float(numbers.relative_gap) if isinstance(numbers.relative_gap, int | float) else None
    proof = None
    if all(name in solution.arrays for name in PROOF):
        proof = TreeProof(*(np.asarray(solution.arrays[name], dtype=float) for name in PROOF))
    return Claims(cost, bound, None, gap, parts_of(numbers), choices=proof)

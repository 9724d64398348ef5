"""Problems of continuous sensing with a criterion as objectives: the outputs at the end, variances at the edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occontrol.families.athans.criteria.objective import criterion_of
from occontrol.families.athans.criteria.statement import PEAK, CriterionChoice
from occontrol.families.athans.discretise import feasible_set
from occontrol.families.athans.integration.integrator import Integrator
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.numerics.transition import transitions
from occontrol.scheduling.criterion_sweep import CriterionObjective, CriterionSweep
from occontrol.scheduling.peak import PeakSweep, Watched
from occontrol.scheduling.recursion import Recursion


@dataclass(frozen=True, eq=False)
class Measured:
    """A problem with a criterion as the search sees it.

    Parameters
    ----------
    problem : in balanced states, with fixed steps
    integrator : of it
    output : (p, n) the outputs at the end of the horizon
    objective : the true one
    note : what is to be said about it
    """

    problem: SchedulingProblem
    integrator: Integrator
    output: np.ndarray
    objective: CriterionObjective
    note: str

    @property
    def limit(self) -> float | None:
        """Of a peak."""
        return None if self.problem.criterion is None else self.problem.criterion.limit


def measured_of(problem: SchedulingProblem) -> Measured:
    """A balanced and prepared problem made ready.

    Parameters
    ----------
    problem : with a criterion that is not the trace
    """
    integrator = Integrator(problem)
    output = _outputs_at_the_end(problem)
    folded = None if integrator.plain else integrator.fixed
    recursion = integrator.recursion if folded is None else folded.shared
    objective, note = objective_on(problem, recursion, output, integrator)
    return Measured(problem, integrator, output, objective, note)


def _outputs_at_the_end(problem: SchedulingProblem) -> np.ndarray:
    start, at = float(problem.edges[0]), float(problem.predict_at or 0.0)
    F, _ = transitions(problem.plant.A, problem.plant.noise, problem.elapsed[-1:], np.array([at - start]), start)
    return problem.output.at(at) @ F[0]


def objective_on(
    problem: SchedulingProblem, recursion: Recursion, output: np.ndarray, integrator: Integrator
) -> tuple[CriterionObjective, str]:
    """The true objective on some steps of integration, and what is to be said about it.

    Parameters
    ----------
    problem : with a criterion, in balanced states
    recursion : on the steps of the integrator
    output : (p, n) the outputs at the end of the horizon
    integrator : with a fixed number of steps
    """
    choice = problem.criterion or CriterionChoice()
    if choice.name == PEAK:
        return PeakSweep(recursion, _watched(problem, integrator)), ""
    criterion, note = criterion_of(choice, output, recursion, feasible_set(problem).uniform())
    return CriterionSweep(recursion, criterion), note


def _watched(problem: SchedulingProblem, integrator: Integrator) -> Watched:
    """tr(D Sigma D') at the edges, in terms of the covariance after the last update before each."""
    choice, edges = problem.criterion or CriterionChoice(), problem.edges
    since = -np.inf if choice.since is None else choice.since - 1e-9 * float(np.ptp(edges))
    at = np.flatnonzero(edges >= since)
    if integrator.plain:
        halves, last = integrator.halves, np.arange(problem.intervals)
    else:
        halves, mesh = integrator.fixed.halves, integrator.fixed.mesh
        last = np.searchsorted(mesh.owner, np.arange(problem.intervals), side="right") - 1
    n = problem.states
    W, c, step = np.zeros((len(at), n, n)), np.zeros(len(at)), np.full(len(at), -1)
    for i, k in enumerate(at):
        D = problem.output.at(float(edges[k]))
        if k == 0:
            c[i] = float(np.trace(D @ problem.plant.covariance @ D.T))
            continue
        half = halves.index[2 * last[k - 1] + 1]
        F, Q = halves.transition[half], halves.noise[half]
        step[i], W[i], c[i] = last[k - 1], F.T @ D.T @ D @ F, float(np.trace(D @ Q @ D.T))
    return Watched(step, W, c)

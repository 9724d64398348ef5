"""Filters and simulations of many targets: one matched filter a target, side by side.

The state of a row is that of all targets one after the other, in the order of the file.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from occontrol.core.errors import SolveFailed, UsageError
from occontrol.core.look_schedule import LookSchedule
from occontrol.core.measurement import Estimate, Measurement
from occontrol.core.solution import Solution
from occontrol.core.trajectory import Trajectory
from occontrol.families.athans.targets.one_target import target_problem, target_schedule
from occontrol.families.athans.targets.problem import TargetsProblem

MOST = 5e7  # times x states x states that the covariances may take


def looks_of(solution: Solution | None) -> LookSchedule:
    """The schedule of a solution; SolveFailed where there is none."""
    if solution is None or not isinstance(solution.schedule, LookSchedule):
        raise SolveFailed("the solution has no schedule of looks to follow")
    return solution.schedule


def _require_size(problem: TargetsProblem) -> None:
    if (problem.intervals + 1) * problem.states**2 > MOST:
        what = f"the covariances of {problem.targets} targets with {problem.states} states do not fit"
        raise UsageError(f"{what}\n  hint: filter fewer targets at a time, from a problem file that names them")


def simulate(problem: TargetsProblem, solution: Solution | None, seed: int = 0) -> tuple[list[Measurement], Trajectory]:
    """True trajectories of all targets and what the looks report of them, TARGET@RESOURCE.

    Parameters
    ----------
    problem : TargetsProblem
    solution : whose schedule is followed
    seed : of the random generator

    Returns measurements in the order of time, and the states (N+1, n) of all targets side by side.
    """
    from occontrol.families.athans.filter.simulate import simulate as simulate_one

    schedule = looks_of(solution)
    measurements, parts, times = [], [], problem.edges
    for i in range(problem.targets):
        one, own = target_problem(problem, i), target_schedule(problem, schedule, i)
        seen, truth = simulate_one(one, own, seed + i)
        measurements += seen
        parts.append(truth.values)
        times = truth.times
    return sorted(measurements, key=lambda m: m.time), Trajectory(times, np.hstack(parts))


def run_filter(
    problem: TargetsProblem,
    solution: Solution,
    measurements: Sequence[Measurement],
    model: str | None = None,
    gate: float | None = None,
) -> Estimate:
    """The estimates of all targets, side by side; nis and dimension are summed over the targets.

    Parameters
    ----------
    problem : TargetsProblem
    solution : whose schedule is followed
    measurements : of sensors TARGET@RESOURCE
    model : "split" or "exact", None the one that belongs to the schedule
    gate : probability beyond which samples are left out

    Raises UsageError where the covariances would not fit, ProblemError for samples that are not in the schedule.
    """
    from occontrol.families.athans.filter.kalman_bucy import run_filter as filter_one
    from occontrol.families.athans.filter.planned import default_model

    _require_size(problem)
    schedule, chosen = looks_of(solution), model or default_model(solution.result)
    mine: dict[str, list[Measurement]] = {name: [] for name in problem.target_names}
    for m in measurements:
        mine.setdefault(m.sensor.rsplit("@", 1)[0], []).append(m)
    found = []
    for i, name in enumerate(problem.target_names):
        one, own = target_problem(problem, i), target_schedule(problem, schedule, i)
        found.append(filter_one(one, own, mine.pop(name), chosen, gate))
    K, n = len(found[0].times), problem.states
    covariance, at = np.zeros((K, n, n)), 0
    for part in found:
        size = part.mean.shape[1]
        covariance[:, at : at + size, at : at + size] = part.covariance
        at += size
    nis = np.array([part.nis for part in found])
    measured = ~np.isnan(nis)
    notes = [f"{name}: {text}" for name, part in zip(problem.target_names, found, strict=True) for text in part.notes]
    return Estimate(
        times=found[0].times,
        mean=np.hstack([part.mean for part in found]),
        standard_deviation=np.hstack([part.standard_deviation for part in found]),
        predicted=np.zeros((K, 0)),
        predicted_deviation=np.zeros((K, 0)),
        nis=np.where(np.any(measured, axis=0), np.sum(np.where(measured, nis, 0.0), axis=0), np.nan),
        dimension=np.sum([part.dimension for part in found], axis=0),
        covariance=covariance,
        notes=tuple(notes[:5]) + ((f"and {len(notes) - 5} more remarks",) if len(notes) > 5 else ()),
    )

"""Plans flown again and again: what any family that simulates and filters can compare its methods by.

Each run simulates a truth and what the plan's sensors report of it, and filters that. Policies are the family's
methods, each planned once; the nominal plan is the problem's own. Families say what a run's error is
(`Family.squared_error`) and what is paid along a plan (`Family.paid`).
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from occontrol.core.errors import OccontrolError, UsageError
from occontrol.core.measurement import Estimate
from occontrol.core.monitor import Monitor
from occontrol.core.problem import BaseProblem
from occontrol.core.solution import Solution
from occontrol.core.trajectory import Trajectory
from occontrol.families.abilities import Work
from occontrol.scheduling.closed_loop.comparison import Comparison, Flown, Seeds, compare_runs
from occontrol.scheduling.closed_loop.outcomes import Outcomes

if TYPE_CHECKING:
    from occontrol.families.family import Family

SINGULAR = 1e-12  # of the largest variance: what is known better than that is known exactly
SHARES = {"relaxed", "collocation"}  # methods that may share the time between sensors, which nobody can fly

_plans: dict[tuple[int, str], tuple[BaseProblem, Solution]] = {}


def policies_of(family: Family, problem: BaseProblem, names: Sequence[str] | None) -> list[str]:
    """The policies to fly: those named, or the nominal plan and the methods that `compare` runs.

    Parameters
    ----------
    family : of the problem
    problem : the problem
    names : 'nominal' and names of methods, or None for all

    Raises UsageError for a name that is no method.
    """
    if names is None:
        own = family.choose(problem).name
        return ["nominal", *(n for n in family.compare_names(problem) if n != own and n not in SHARES)]
    for name in names:
        if name != "nominal":
            family.choose(problem, name)
    return list(names)


def compare(
    family: Family,
    problem: BaseProblem,
    solution: Solution,
    names: Sequence[str] | None,
    runs: int,
    seed: int,
    monitor: Monitor,
    work: Work | None = None,
) -> Comparison:
    """Runs of a family's methods side by side.

    Parameters
    ----------
    family : of the problem
    problem : the problem
    solution : the nominal plan
    names : of the policies; None: the nominal plan and the methods that `compare` runs and that can be flown
    runs : at most so many of each
    seed : of all of them
    monitor : Monitor
    work : does batches of seeds, for example in several processes; None: here, one after the other

    Raises UsageError for unknown policies, and what a method raises that is asked for by name.
    """
    chosen = policies_of(family, problem, names)
    if names is None:
        chosen = [name for name in chosen if _flies(family, problem, solution, name)]
        if not chosen:
            raise UsageError("no method of this problem makes a plan that can be flown\n  hint: name one, --policies")

    def fly(pieces: Sequence[Seeds]) -> Iterable[Flown]:
        return work(chosen, pieces) if work else (flown(family, problem, solution, chosen, piece) for piece in pieces)

    return compare_runs(str(problem.name), chosen, runs, seed, fly, monitor)


def flown(family: Family, problem: BaseProblem, solution: Solution, names: Sequence[str], seeds: Seeds) -> Flown:
    """Outcomes of a few runs of each policy, and the milliseconds of simulation and filter of a run.

    Parameters
    ----------
    family : of the problem
    problem : the problem
    solution : the nominal plan
    names : of the policies
    seeds : one a run; every policy of a run has the same
    """
    found, times = {}, {}
    for name in names:
        plan = _plan(family, problem, solution, name)
        rows, times[name] = [], []
        for seed in seeds:
            began = time.process_time()
            rows.append(_run(family, plan, int(seed.generate_state(1, np.uint64)[0] >> np.uint64(1))))
            times[name].append(1e3 * (time.process_time() - began))
        error, nees, nis, readings = (np.array(column) for column in zip(*rows, strict=True))
        none = np.zeros(len(rows))
        price = np.full(len(rows), family.paid(plan.problem, plan))
        found[name] = Outcomes(error, price, nees, nis, none, readings, none, none)
    return found, times


def _plan(family: Family, problem: BaseProblem, solution: Solution, name: str) -> Solution:
    """The plan of a policy; made once by every process."""
    if name == "nominal":
        return solution
    key = (id(problem), name)
    if key not in _plans:
        _plans[key] = problem, family.solve(problem, family.choose(problem, name), Monitor())
    return _plans[key][1]


def _flies(family: Family, problem: BaseProblem, solution: Solution, name: str) -> bool:
    try:
        plan = _plan(family, problem, solution, name)
        _run(family, plan, 0)
    except OccontrolError:
        if name == "nominal":
            raise
        return False
    return True


def _run(family: Family, plan: Solution, seed: int) -> tuple[float, float, float, float]:
    """Squared error, mean NEES per state, mean NIS per value, and the number of readings of one run."""
    measurements, truth = family.simulate(plan.problem, plan, seed)
    estimate = family.run_filter(plan.problem, plan, measurements)
    error = errors(estimate, truth)
    size, scale = normalised(error, estimate.covariance), error.shape[1]
    measured = estimate.dimension > 0
    values = float(np.sum(estimate.dimension[measured]))
    nis = float(np.sum(estimate.nis[measured])) / values if values else float("nan")
    squared = float(family.squared_error(plan.problem, estimate, truth))
    return squared if np.isfinite(squared) else np.inf, float(np.mean(size)) / scale, nis, float(len(measurements))


def errors(estimate: Estimate, truth: Trajectory) -> np.ndarray:
    """(K, n) truth less estimate at the times of an estimate, which are among those of the truth.

    Parameters
    ----------
    estimate : Estimate
    truth : Trajectory

    Raises ValueError where the truth is not known at a time.
    """
    at = np.searchsorted(truth.times, estimate.times)
    at = np.minimum(at, len(truth.times) - 1)
    if not np.array_equal(truth.times[at], estimate.times):
        raise ValueError("the truth is not known at the times of the estimate")
    return truth.values[at] - estimate.mean


def normalised(error: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(K,) e' P+ e of K errors; what the filter knows exactly is left out.

    Parameters
    ----------
    error : (K, n)
    covariance : (K, n, n)
    """
    deviation = np.sqrt(np.maximum(np.einsum("kii->ki", covariance), 0.0))
    safe = np.where(deviation > 0, deviation, 1.0)  # units of the states do not matter
    values, vectors = np.linalg.eigh(covariance / (safe[:, :, None] * safe[:, None, :]))
    along = np.einsum("kij,ki->kj", vectors, error / safe)
    known = values > SINGULAR * np.maximum(values[:, -1:], np.finfo(float).tiny)
    return np.sum(np.where(known, along**2 / np.where(known, values, 1.0), 0.0), axis=1)

"""What the objective of continuous sensing charges the error of one simulated run."""

from __future__ import annotations

import numpy as np

from occontrol.families.athans.filter.sampled_model import driven_transitions
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.numerics.linalg import symmetrise


def charged(problem: SchedulingProblem, error: np.ndarray, times: np.ndarray) -> float:
    """int e' R e dt + |D Phi(Tp, T) e(T)|^2 of an error e (K, n) at the edges `times` (K,).

    The integral is that of trapezoids; its mean over many runs is what the objective charges the covariance.

    Parameters
    ----------
    problem : SchedulingProblem
    error : (K, n) truth less estimate
    times : (K,) of the filter, from the start to the end of the horizon
    """
    at, end = float(problem.predict_at), float(times[-1])  # type: ignore[arg-type]
    D = problem.output.at(at)
    phi = driven_transitions(problem.plant, np.zeros(1), np.array([at - end]), end)[0][0]
    found = float(np.sum((D @ phi @ error[-1]) ** 2))
    if problem.running is not None:
        R = symmetrise(problem.running.sample(times))
        found += float(np.trapezoid(np.einsum("ki,kij,kj->k", error, R, error), times))
    return found

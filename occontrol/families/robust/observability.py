"""Uniform robust observability of a problem: up to when, and what to say where it ends too soon.

It holds on [t0, T] when X exists there and X(t0) < X0; no sensor enters (see game.py). Definiteness is a matter of
eigenvalues, so callers hand over problems in balanced states (balanced.py).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from occontrol.core.errors import SolveFailed
from occontrol.families.robust.escape import escape_time, first_lost, free_weights, gain_that_fits, horizon, smallest
from occontrol.families.robust.result import UnobservableResult

if TYPE_CHECKING:
    from occontrol.families.robust.problem import Problem

MOST_HORIZONS = 20.0  # horizons that a time-varying plant is followed for its observability horizon


def observability(problem: Problem) -> tuple[float | None, float | None]:
    """The supremum of T with X on [t0, T] and X(t0) < X0, and how far a time-varying plant was followed.

    Parameters
    ----------
    problem : Problem

    Returns (horizon or None, followed-to or None); a constant plant is decided for all T.
    """
    start, end = float(problem.edges[0]), float(problem.edges[-1])
    if problem.plant_flow.constant:
        return horizon(problem.plant_flow, problem.plant.weight, start), None
    limit = start + MOST_HORIZONS * (end - start)
    try:
        return horizon(problem.plant_flow, problem.plant.weight, start, limit), limit
    except SolveFailed:  # the formulas end somewhere beyond the problem's own horizon
        return horizon(problem.plant_flow, problem.plant.weight, start, end), end


def uniformly_observable(problem: Problem) -> bool:
    """Whether the set of possible states stays bounded on the horizon for all measurements, whatever the sensors.

    Parameters
    ----------
    problem : Problem
    """
    free = free_weights(problem.plant_flow, problem.edges)
    return free is not None and smallest(problem.plant.weight - free[0]) > 0


def share_of_weight(weight: np.ndarray, X: np.ndarray) -> float:
    """The largest eigenvalue of X0^-1 X, whatever the units: uniform observability needs less than 1.

    Parameters
    ----------
    weight, X : X0 (n, n) and X (n, n) at the start
    """
    from scipy.linalg import eigh

    return float(eigh(X, weight, eigvals_only=True)[-1])


def unobservable(problem: Problem, sequence: Sequence[int] | None = None) -> tuple[UnobservableResult, str]:
    """Which test of uniform robust observability fails, when, and what would mend it: numbers and a sentence.

    Parameters
    ----------
    problem : Problem whose plant is not uniformly robustly observable
    sequence : (N,) the schedule that was asked for, if one was
    """
    plant, edges = problem.plant, problem.edges
    reach, _ = observability(problem)
    factor = gain_that_fits(problem.plant_flow, plant.weight, edges)
    lost = first_lost(problem.plant_flow, edges)
    free = free_weights(problem.plant_flow, edges)
    if lost is not None:
        why = f"X, followed back from t = {edges[-1]:g}, escapes at t = {lost:.10g}"
    else:
        share = np.inf if free is None else share_of_weight(plant.weight, free[0])
        why = f"X({edges[0]:g}) is not below the weight: it reaches {share:.6g} times the weight"
    named = f"{reach:.12g}" if reach is not None else "unknown"
    message = (
        f"not uniformly robustly observable on [{edges[0]:.12g}, {edges[-1]:.12g}], whatever the sensors: {why}. "
        f"The observability horizon is t = {named}: end before it, or multiply K by less than {factor:.10g}."
    )
    escape = None
    if sequence is not None:
        escape = escape_time(problem.flow, plant.weight, edges, sequence)
        if escape is None:
            message += (
                " With this schedule P itself lives to the end: the plant is robustly, not uniformly, observable."
            )
        else:
            message += f" With this schedule P escapes at t = {escape:.12g}."
    numbers = UnobservableResult(
        name=problem.name,
        observability_horizon=reach,
        X_initial=None if free is None else free[0].tolist(),
        gain_factor=factor,
        X_escape_time=lost,
        escape_time=escape,
        followed=sequence is not None,
    )
    return numbers, message

"""The methods that a user can name for one precision program, as option objects, and `choose`, which runs one."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from occontrol.core.errors import Collector
from occontrol.core.monitor import Monitor
from occontrol.core.solution import Status
from occontrol.families.precision.moments import posterior_covariance
from occontrol.families.precision.program import PrecisionProgram, PrecisionResult, relative_margin, solve_program


def _check(relative_gap: float, max_iterations: int = 1, time_limit: float | None = None) -> None:
    found = Collector()
    if not 0 < relative_gap < 1:
        found.add(("relative_gap",), f"relative_gap is {relative_gap:g}", "between 0 and 1, for example 1e-6")
    if max_iterations < 1:
        found.add(("max_iterations",), f"max_iterations is {max_iterations}", "at least 1")
    if time_limit is not None and not time_limit > 0:
        found.add(("time_limit",), f"time_limit is {time_limit:g}", "seconds, more than 0")
    found.raise_if_any()


@dataclass(frozen=True)
class Barrier:
    """Interior-point steps on the precisions alone; Clarabel follows where they stall.

    Parameters
    ----------
    relative_gap : (objective - proven bound)/objective to be reached
    max_iterations : Newton steps
    time_limit : seconds, None is no limit
    """

    relative_gap: float = 1e-6
    max_iterations: int = 100
    time_limit: float | None = None
    name: str = field(default="barrier", init=False)

    def __post_init__(self) -> None:
        _check(self.relative_gap, self.max_iterations, self.time_limit)


@dataclass(frozen=True)
class ClarabelRoute:
    """Clarabel on the matrix inequality, for up to 80 rows; seconds at 60, where the barrier needs hundredths.

    Parameters
    ----------
    relative_gap : (objective - proven bound)/objective to be reached
    max_iterations : of Clarabel
    form : reduced (I + L'SL >= W' Delta^-1 W) or factor ([[P^d - P, 0], [0, I]] + sum lambda_i f_i f_i' >= 0)
    time_limit : seconds, None is no limit
    """

    relative_gap: float = 1e-6
    max_iterations: int = 200
    form: str = "reduced"
    time_limit: float | None = None
    name: str = field(default="clarabel", init=False)

    def __post_init__(self) -> None:
        _check(self.relative_gap, self.max_iterations, self.time_limit)
        if self.form not in ("reduced", "factor"):
            found = Collector()
            found.add(("form",), f"form is '{self.form}'", "form: reduced | factor")
            found.raise_if_any()


@dataclass(frozen=True)
class Uniform:
    """The baseline: the least precision, the same for every sensor (or its cap if lower), that meets the bound."""

    name: str = field(default="uniform", init=False)


METHODS = {"barrier": Barrier, "clarabel": ClarabelRoute, "uniform": Uniform}
Method = Barrier | ClarabelRoute | Uniform


def choose(program: PrecisionProgram, method: Method, monitor: Monitor | None = None) -> PrecisionResult:
    """Solve the program with the method."""
    monitor = monitor or Monitor()
    if isinstance(method, Uniform):
        return uniform(program, monitor)
    route = "barrier" if isinstance(method, Barrier) else {"reduced": "clarabel", "factor": "factor"}[method.form]
    return solve_program(program, route, method.relative_gap, 1e-12, method.max_iterations, monitor)


def uniform(program: PrecisionProgram, monitor: Monitor | None = None) -> PrecisionResult:
    """One level for all sensors: lambda_i = min(level, cap_i), by bisection on the posterior: its margin rises with it.

    The lower bound is that of the optimal precisions, so that its gap is the price of not choosing.
    """
    optimal = solve_program(program, "barrier", monitor=monitor)
    if optimal.precisions is None or optimal.objective == 0:
        return optimal
    free = np.isnan(program.fixed)

    def at(level: float) -> np.ndarray:
        return np.where(free, np.minimum(level, program.caps), np.nan_to_num(program.fixed))

    def met(level: float) -> bool:
        return relative_margin(posterior_covariance(program.moments, at(level)), program.bound) >= -1e-12

    usable = free & (program.caps > 0)
    high = float(np.max(optimal.precisions[usable]))
    # the largest of the optimal precisions for everybody is enough, up to rounding
    for _ in range(60):
        if met(high):
            break
        high *= 1.5
    else:
        return replace(optimal, status=Status.FAILED, precisions=None, message="No common precision meets the bound.")
    low = 0.0
    while high - low > 1e-12 * high:
        middle = (low + high) / 2
        low, high = (low, middle) if met(middle) else (middle, high)
    precisions = at(high)
    posterior = posterior_covariance(program.moments, precisions)
    objective = float(program.prices @ precisions)
    return replace(
        optimal,
        status=Status.FEASIBLE,
        message=f"The least common precision is {high:.6g}; free choice saves {1 - optimal.objective / objective:.1%}.",
        precisions=precisions,
        objective=objective,
        margin=float(np.linalg.eigvalsh(program.bound - posterior)[0]),
        relative_margin=relative_margin(posterior, program.bound),
        posterior=posterior,
        route="bisection",
    )

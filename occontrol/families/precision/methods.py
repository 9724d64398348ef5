"""The methods for one precision program as values: frozen dataclasses of options that check and run themselves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from occontrol.core.errors import Mistake, ProblemError
from occontrol.core.method import check_options
from occontrol.core.monitor import Monitor
from occontrol.core.solution import Status
from occontrol.families.precision.moments import posterior_covariance
from occontrol.families.precision.program import Outcome, Program, relative_margin, solve_program

if TYPE_CHECKING:
    from occontrol.families.precision.problem import Problem


class ProgramMethod:
    """What the methods of this family share: `run` solves the program of one batch."""

    name: ClassVar[str]
    time_limit: float | None = None  # seconds for all batches; an option of those that may take long

    def check(self, problem: Problem) -> Sequence[Mistake]:
        """What is wrong with the options for `problem`, paths below `method`."""
        return ()

    def run(self, program: Program, monitor: Monitor) -> Outcome:
        """Solve one program.

        Parameters
        ----------
        program : Program
        monitor : Monitor
        """
        raise NotImplementedError


def _check(method: ProgramMethod, relative_gap: float) -> None:
    check_options(method, positive=("relative_gap", "time_limit"), whole={"max_iterations": 1})
    if not relative_gap < 1:
        what = f"relative_gap of method {method.name} is {relative_gap!r}"
        raise ProblemError(Mistake(("relative_gap",), what, "between 0 and 1, for example 1e-6"))


@dataclass(frozen=True)
class Barrier(ProgramMethod):
    """Interior-point steps on the precisions alone; Clarabel follows where they stall.

    Parameters
    ----------
    relative_gap : (objective - proven bound)/objective to be reached
    max_iterations : Newton steps
    time_limit : seconds, None is no limit
    """

    name: ClassVar[str] = "barrier"
    relative_gap: float = 1e-6
    max_iterations: int = 100
    time_limit: float | None = None

    def __post_init__(self) -> None:
        _check(self, self.relative_gap)

    def run(self, program: Program, monitor: Monitor) -> Outcome:
        """Solve one program by the barrier."""
        return solve_program(program, "barrier", self.relative_gap, max_iterations=self.max_iterations, monitor=monitor)


@dataclass(frozen=True)
class ClarabelRoute(ProgramMethod):
    """Clarabel on the matrix inequality, for up to 80 rows; seconds at 60, where the barrier needs hundredths.

    Parameters
    ----------
    relative_gap : (objective - proven bound)/objective to be reached
    max_iterations : of Clarabel
    form : reduced (I + L'SL >= W' Delta^-1 W) or factor ([[P^d - P, 0], [0, I]] + sum lambda_i f_i f_i' >= 0)
    time_limit : seconds, None is no limit
    """

    name: ClassVar[str] = "clarabel"
    relative_gap: float = 1e-6
    max_iterations: int = 200
    form: str = "reduced"
    time_limit: float | None = None

    def __post_init__(self) -> None:
        _check(self, self.relative_gap)
        check_options(self, one_of={"form": ("reduced", "factor")})

    def run(self, program: Program, monitor: Monitor) -> Outcome:
        """Solve one program by Clarabel."""
        route = {"reduced": "clarabel", "factor": "factor"}[self.form]
        return solve_program(program, route, self.relative_gap, max_iterations=self.max_iterations, monitor=monitor)


@dataclass(frozen=True)
class Uniform(ProgramMethod):
    """The baseline: the least precision, the same for every sensor (or its cap if lower), that meets the bound."""

    name: ClassVar[str] = "uniform"

    def run(self, program: Program, monitor: Monitor) -> Outcome:
        """lambda_i = min(level, cap_i), the level by bisection on the posterior, whose margin rises with it.

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
            message = "No common precision meets the bound."
            return replace(optimal, status=Status.FAILED, precisions=None, message=message)
        low = 0.0
        while high - low > 1e-12 * high:
            middle = (low + high) / 2
            low, high = (low, middle) if met(middle) else (middle, high)
        precisions = at(high)
        posterior = posterior_covariance(program.moments, precisions)
        objective = float(program.prices @ precisions)
        saved = 1 - optimal.objective / objective
        return replace(
            optimal,
            status=Status.FEASIBLE,
            message=f"The least common precision is {high:.6g}; free choice saves {saved:.1%}.",
            precisions=precisions,
            objective=objective,
            margin=float(np.linalg.eigvalsh(program.bound - posterior)[0]),
            relative_margin=relative_margin(posterior, program.bound),
            posterior=posterior,
            route="bisection",
        )


METHODS: dict[str, type[ProgramMethod]] = {m.name: m for m in (Barrier, ClarabelRoute, Uniform)}

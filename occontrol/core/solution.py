"""What a solve returns: plain data, no live solver, so that it pickles and can be written to disk."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Any, Protocol

import numpy as np

from occontrol.core import stopwatch
from occontrol.core.kinds import PlainDict, PlainMapping
from occontrol.core.monitor import Monitor
from occontrol.core.printed import rounded_down
from occontrol.core.problem import BaseProblem
from occontrol.core.result import PlainResult, ResultData
from occontrol.core.schedule import Schedule
from occontrol.core.trajectory import Trajectory
from occontrol.core.versions import KEY, SCHEMA_VERSION, versions


class Status(enum.StrEnum):
    """How a solve ended; the text says which knob to turn."""

    CERTIFIED = "certified"
    FEASIBLE = "feasible"
    INFEASIBLE = "infeasible"
    LIMIT = "limit"
    INTERRUPTED = "interrupted"
    FAILED = "failed"
    DISAGREES = "disagrees"

    @property
    def exit_code(self) -> int:
        """The command line's exit code (interrupted: 130, or 143 when ended by SIGTERM)."""
        return _EXIT[self]

    @property
    def text(self) -> str:
        """One sentence for the user."""
        return _TEXT[self]


_EXIT = {
    Status.CERTIFIED: 0,
    Status.FEASIBLE: 0,
    Status.INFEASIBLE: 4,
    Status.LIMIT: 5,
    Status.INTERRUPTED: 130,
    Status.FAILED: 6,
    Status.DISAGREES: 7,
}
_TEXT = {
    Status.CERTIFIED: "The bound is proven and reached its target.",
    Status.FEASIBLE: "A usable result; its distance from the optimum is what the bound says.",
    Status.INFEASIBLE: "No schedule exists.",
    Status.LIMIT: "A limit came before the target gap; raise max_iterations or time_limit, or relax relative_gap.",
    Status.INTERRUPTED: "Interrupted; this is the best so far.",
    Status.FAILED: "The solver ended with nothing usable.",
    Status.DISAGREES: "The independent check disagrees; use a finer grid, and do not trust the cost.",
}


ALLOWANCE = 1e-9  # of |cost|: by so much rounding may put a bound above the cost


@dataclass(frozen=True)
class Certificate:
    """A cost and a proven lower bound on the optimal cost.

    A bound above the cost within the allowance is rounding and becomes the cost. One farther above proves that
    something is wrong with the numbers: it stays as it is, `contradicts` is true, and whoever makes a Solution of it
    gives the status `disagrees` with `text`.

    Parameters
    ----------
    cost : J of the policy, in cost units
    lower_bound : in cost units; no policy of the same problem costs less
    allowance : share of `size` by which rounding may put the bound above the cost; it has done its work once the two
        numbers stand, so equal certificates may have had different ones
    absolute : whether the cost holds a logarithm: it may then be 0 or less, and gaps are not divided by it
    """

    cost: float
    lower_bound: float
    allowance: float = field(default=ALLOWANCE, compare=False)
    absolute: bool = False

    def __post_init__(self) -> None:
        if self.cost < self.lower_bound <= self.cost + self.allowance * self.size:
            object.__setattr__(self, "lower_bound", self.cost)

    @property
    def size(self) -> float:
        """What gaps are shares of: |cost|, or 1 where the cost holds a logarithm."""
        return 1.0 if self.absolute else abs(self.cost)

    @property
    def contradicts(self) -> bool:
        """Whether the bound lies above the cost by more than rounding."""
        return self.lower_bound > self.cost

    @property
    def text(self) -> str:
        """What the user reads when the certificate contradicts itself; empty otherwise."""
        if not self.contradicts:
            return ""
        return (
            f"the lower bound {self.lower_bound:.10g} lies above the cost {self.cost:.10g}: rounding has spoilt the "
            "numbers, use shorter intervals or other units"
        )

    @property
    def gap(self) -> float:
        """cost - lower_bound, in cost units."""
        return self.cost - self.lower_bound

    @property
    def relative_gap(self) -> float:
        """(cost - lower_bound)/|cost|, 0 when both vanish; cost - lower_bound where the cost holds a logarithm."""
        return self.gap / self.size if self.size else (0.0 if self.gap == 0 else float("inf"))

    def as_dict(self) -> dict[str, float]:
        """The three numbers as they stand in result.json."""
        return {"cost": self.cost, "lower_bound": self.lower_bound, "relative_gap": self.relative_gap}


def gap_words(gap: float, absolute: bool = False, digits: int = 3) -> str:
    """A gap for people: a share in percent, or a difference where the cost holds a logarithm.

    Parameters
    ----------
    gap : as in `Certificate.relative_gap`
    absolute : whether it is a difference
    digits : significant ones
    """
    return f"gap {gap:.{digits}g} (a difference)" if absolute else f"gap {100 * gap:.{digits}g} %"


@dataclass(frozen=True, eq=False, repr=False)
class Solution:
    """The outcome of one method on one problem.

    Parameters
    ----------
    family, method : str
    status, message : how it ended, in the vocabulary of `Status`
    iterations : int
    seconds : wall time of the solve in seconds, without compiling
    numbers : the family's frozen result (cost, lower_bound, schedule, ...); `result` shows the same by name
    arrays : the family's arrays, as in arrays.npz
    schedule : Schedule or None
    certificate : Certificate of the discretised problem, or None
    history : one record per reported iteration: {iteration, cost, lower_bound, seconds}
    versions : of this package and of the libraries below it
    problem : the problem that was solved, so that a solution can be drawn and filtered by itself
    """

    family: str
    method: str
    status: Status
    message: str
    iterations: int
    seconds: float
    numbers: ResultData = field(default_factory=lambda: PlainResult({}))
    arrays: Mapping[str, np.ndarray] = field(default_factory=dict)
    schedule: Schedule | None = None
    certificate: Certificate | None = None
    history: tuple[Mapping[str, float], ...] = ()
    versions: Mapping[str, str] = field(default_factory=lambda: versions())
    problem: Any = field(default=None, repr=False)

    @cached_property
    def result(self) -> PlainMapping:
        """What result.json holds of the family's numbers, by name and read-only: solution.result["cost"]."""
        return MappingProxyType(self.numbers.as_dict())

    def __getstate__(self) -> PlainDict:
        return {name: value for name, value in self.__dict__.items() if name != "result"}  # a view does not pickle

    @property
    def covariance(self) -> Trajectory:
        """Error covariance at the nodes; KeyError for families that have none."""
        return Trajectory(self.arrays["times"], self.arrays["covariance"])

    @property
    def cost(self) -> float:
        """The cost of the discretised problem; AttributeError for families whose result has none."""
        return float(self.numbers.cost)

    def __repr__(self) -> str:
        parts = [self.family, str(self.status)]
        if (c := self.certificate) is not None:
            pair = [f"cost {c.cost:.5g}", f"bound {rounded_down(c.lower_bound, 5)}"]
            parts += [*pair, gap_words(c.relative_gap, c.absolute, 2)]
        return f"<{' '.join(parts)}>"

    def _repr_html_(self) -> str:
        """A table for notebooks."""
        from html import escape

        rows = [("problem", str(getattr(self.problem, "name", ""))), ("method", self.method)]
        rows += [("status", f"{self.status}: {self.message or self.status.text}")]
        if self.certificate is not None:
            rows += [(key.replace("_", " "), f"{value:.8g}") for key, value in self.certificate.as_dict().items()]
        cells = (f"<tr><th>{escape(key)}</th><td>{escape(value)}</td></tr>" for key, value in rows)
        return f"<table>{''.join(cells)}</table>"

    def as_dict(self) -> PlainDict:
        """The content of result.json."""
        return {
            KEY: SCHEMA_VERSION,
            "family": self.family,
            "status": str(self.status),
            "message": self.message,
            "method": self.method,
            "iterations": self.iterations,
            "seconds": self.seconds,
            **self.numbers.as_dict(),
            "history": [dict(record) for record in self.history],
            "versions": dict(self.versions),
        }


def make_solution(
    *,
    problem: BaseProblem,
    method: str,
    status: Status,
    message: str,
    numbers: ResultData,
    monitor: Monitor,
    began: float,
    iterations: int = 0,
    arrays: Mapping[str, np.ndarray] | None = None,
    schedule: Schedule | None = None,
    certificate: Certificate | None = None,
) -> Solution:
    """The Solution of one method on one problem, the same way in every family.

    Parameters
    ----------
    problem : what was solved
    method : its name
    status, message : how it ended
    numbers : the family's result
    monitor : what watched the method; its history goes with the solution
    began : stopwatch.seconds() at the start
    iterations : of the method, in whatever it counts
    arrays : what arrays.npz will hold, by name; for example edges (N+1,)
    schedule : on which the numbers are, if there is one
    certificate : cost and proven bound, if there is one; where it contradicts itself the status is `disagrees`, and the
        message says so, after what another check has found
    """
    if certificate is not None and certificate.contradicts:
        found = message if status is Status.DISAGREES else ""
        message = "; ".join(part for part in (found, certificate.text) if part)
        status = Status.DISAGREES
    return Solution(
        family=problem.family,
        method=method,
        status=status,
        message=message,
        iterations=iterations,
        seconds=stopwatch.seconds() - began,
        numbers=numbers,
        arrays=arrays or {},
        schedule=schedule,
        certificate=certificate,
        history=tuple(monitor.history),
        problem=problem,
    )


class Tradeoff(Protocol):
    """The front of observation cost against prediction error, one solution for each cost weight."""

    @property
    def status(self) -> Status:
        """How the tracing ended."""
        ...

    def as_dict(self) -> PlainDict:
        """The content of tradeoff.json."""
        ...

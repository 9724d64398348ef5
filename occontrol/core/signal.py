"""Matrix-valued functions of time: constant, given by expressions, or tabulated.

A Signal answers `at(t)`, `sample(times)` and `breaks(start, end)` (times between which it is smooth), knows its shape,
and can be written back into a problem document. In discrete time the variable is the step k.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from occontrol.core.clock import tolerance
from occontrol.core.errors import Mistake, ProblemError
from occontrol.core.expression import parse_expression
from occontrol.core.jumps import conditions, jump_times
from occontrol.core.kinds import CasadiFunction, MatrixLike, Plain
from occontrol.core.poles import find_pole

BEHIND = 4.0  # units in the last place of a time, by which a formula with jumps is asked later


class Signal:
    """A matrix that may depend on time; see ConstantSignal, ExpressionSignal, TableSignal."""

    shape: tuple[int, int]
    constant: bool = False

    def at(self, t: float) -> np.ndarray:
        """The (rows, columns) matrix at time t."""
        return self.sample(np.array([t], dtype=float))[0]

    def sample(self, times: np.ndarray) -> np.ndarray:
        """The (K, rows, columns) matrices at `times` (K,), in the unit of time."""
        raise NotImplementedError

    def breaks(self, start: float, end: float) -> np.ndarray:
        """Jumps and bends (K,), at least those between `start` and `end`, all in the unit of time."""
        return np.empty(0)

    def document(self) -> Plain:
        """What stands for this signal in a problem file."""
        raise NotImplementedError


@dataclass(frozen=True, eq=False)
class ConstantSignal(Signal):
    """The same matrix at all times. value : (rows, columns), in the unit of the quantity it stands for"""

    value: np.ndarray
    constant = True

    @property
    def shape(self) -> tuple[int, int]:  # type: ignore[override]
        return self.value.shape  # type: ignore[return-value]

    def at(self, t: float) -> np.ndarray:
        return self.value

    def sample(self, times: np.ndarray) -> np.ndarray:
        """The same matrix, (K, rows, columns), for each of `times` (K,), in the unit of time."""
        return np.broadcast_to(self.value, (len(times), *self.value.shape))

    def document(self) -> Plain:
        return self.value.tolist()


@dataclass(frozen=True, eq=False)
class ExpressionSignal(Signal):
    """Entries are numbers or formulas of `variable`."""

    entries: tuple[tuple[float | str, ...], ...]
    variable: str = "t"

    def __post_init__(self) -> None:
        mistakes = []
        for i, row in enumerate(self.entries):
            for j, entry in enumerate(row):
                if isinstance(entry, str):
                    try:
                        parse_expression(entry, (self.variable,))
                    except ProblemError as error:
                        mistakes += [m.under(i, j) for m in error.mistakes]
        if mistakes:
            raise ProblemError(mistakes)

    @property
    def shape(self) -> tuple[int, int]:  # type: ignore[override]
        return len(self.entries), len(self.entries[0]) if self.entries else 0

    @cached_property
    def _function(self) -> CasadiFunction:
        import casadi

        symbol = casadi.SX.sym(self.variable)
        flat = [
            parse_expression(e, (self.variable,)).casadi({self.variable: symbol})
            if isinstance(e, str)
            else casadi.SX(e)
            for row in self.entries
            for e in row
        ]
        return casadi.Function("signal", [symbol], [casadi.vertcat(*flat)])

    def sample(self, times: np.ndarray) -> np.ndarray:
        """The formulas, (K, rows, columns), at `times` (K,), in the unit of time."""
        times = np.asarray(times, dtype=float)
        if len(times) == 0:  # CasADi would take it for one time
            return np.empty((0, *self.shape))
        if self._jumping and self.variable == "t":  # at a jump stands what comes behind it, as in tables
            times = times + BEHIND * np.spacing(np.abs(times))
        values = np.array(self._function(times.reshape(1, -1)))
        return np.ascontiguousarray(values.T).reshape(len(times), *self.shape)

    @cached_property
    def _jumping(self) -> tuple[str, ...]:
        """The formulas that may jump."""
        texts = dict.fromkeys(entry for row in self.entries for entry in row if isinstance(entry, str))
        return tuple(text for text in texts if conditions(parse_expression(text, (self.variable,))))

    def breaks(self, start: float, end: float) -> np.ndarray:
        """Jumps (K,) between `start` and `end`, in the unit of time; ProblemError where they cannot be told."""
        if not self._jumping or self.variable != "t":
            return np.empty(0)
        return np.unique(np.concatenate([jump_times(text, "t", start, end) for text in self._jumping]))

    def pole(self, times: np.ndarray) -> tuple[float, int, int] | None:
        """(time, row, column) of the first entry that is infinite between `times` (K,), where all are finite."""
        formulas = {entry for row in self.entries for entry in row if isinstance(entry, str)}
        poles = {f: find_pole(parse_expression(f, (self.variable,)), self.variable, times) for f in formulas}
        found = []
        for i, row in enumerate(self.entries):
            for j, entry in enumerate(row):
                time = poles.get(entry) if isinstance(entry, str) else None
                found += [] if time is None else [(time, i, j)]
        return min(found, default=None)

    def __getstate__(self) -> dict:
        return {"entries": self.entries, "variable": self.variable}

    def __setstate__(self, state: dict) -> None:
        self.__dict__.update(state)

    def document(self) -> Plain:
        return [list(row) for row in self.entries]


@dataclass(frozen=True, eq=False)
class TableSignal(Signal):
    """Matrices at given times, joined by straight lines ("linear") or held until the next time ("previous").

    times, values : (K,) in the unit of time, (K, rows, columns) in the unit of the quantity they stand for
    """

    times: np.ndarray
    values: np.ndarray
    interpolation: str = "linear"
    _flat: np.ndarray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        times, values = np.asarray(self.times, dtype=float), np.asarray(self.values, dtype=float)
        if times.ndim != 1 or len(times) < 1 or values.ndim != 3 or len(values) != len(times):
            raise ProblemError(
                Mistake((), f"the table has {len(values)} matrices for {times.size} times", "one matrix per time")
            )
        if not (np.all(np.isfinite(times)) and np.all(np.isfinite(values))):
            raise ProblemError(Mistake((), "the table holds a value that is not finite"))
        if np.any(np.diff(times) <= 0):
            bad = int(np.argmax(np.diff(times) <= 0)) + 1
            raise ProblemError(
                Mistake(("times",), f"times must increase: entry {bad + 1} is {times[bad]:g} after {times[bad - 1]:g}")
            )
        if self.interpolation not in ("linear", "previous"):
            raise ProblemError(
                Mistake(("interpolation",), f"unknown interpolation '{self.interpolation}'", "linear or previous")
            )
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "_flat", values.reshape(len(values), -1))
        # one matrix held for ever is a constant that happens to live in a file
        object.__setattr__(self, "constant", len(times) == 1 and self.interpolation == "previous")

    @property
    def shape(self) -> tuple[int, int]:  # type: ignore[override]
        return self.values.shape[1:]  # type: ignore[return-value]

    def breaks(self, start: float, end: float) -> np.ndarray:
        """Jumps and bends (K,), at least those between `start` and `end`, all in the unit of time."""
        return self.times

    def covers(self, start: float, end: float) -> bool:
        """Whether [start, end] lies inside the table ("previous" may be held beyond its last time)."""
        slack = tolerance(end - start, start, end)
        return bool(
            self.times[0] <= start + slack and (self.interpolation == "previous" or self.times[-1] >= end - slack)
        )

    def sample(self, times: np.ndarray) -> np.ndarray:
        """The table, (K, rows, columns), at `times` (K,), in the unit of time; they may lie between its own."""
        t = np.asarray(times, dtype=float)
        left = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, len(self.times) - 1)
        if self.interpolation == "previous" or len(self.times) == 1:
            return self.values[left]
        left = np.minimum(left, len(self.times) - 2)
        span = self.times[left + 1] - self.times[left]
        share = np.clip((t - self.times[left]) / span, 0.0, 1.0)[:, None]
        flat = self._flat[left] * (1 - share) + self._flat[left + 1] * share
        return flat.reshape(len(t), *self.shape)

    def document(self) -> Plain:
        return {"times": self.times.tolist(), "values": self.values.tolist(), "interpolation": self.interpolation}


def as_signal(value: MatrixLike, variable: str = "t") -> Signal:
    """A Signal from a number, a formula, a nested list, an array, or a Signal.

    A number or a single formula is 1x1. A flat list is refused: it could be a row or a column.

    Parameters
    ----------
    value : (rows, columns), in the unit of the quantity that the signal stands for
    variable : the name of time, or of the step, in formulas

    Raises ProblemError where `value` is no matrix of finite real numbers and formulas.
    """
    if isinstance(value, Signal):
        return value
    if isinstance(value, int | float | str | np.number):
        value = [[value]]
    if isinstance(value, np.ndarray):
        rows: Any = value.reshape(1, 1) if value.ndim == 0 else value
        if rows.dtype.kind not in "fiu":
            raise ProblemError(Mistake((), "the array does not hold real numbers"))
    else:
        if not isinstance(value, list | tuple):
            raise ProblemError(Mistake((), "expected a matrix: a list of rows", "write [[1, 0], [0, 1]]"))
        rows = [list(row) if isinstance(row, list | tuple | np.ndarray) else row for row in value]
        if any(not isinstance(row, list) for row in rows):
            raise ProblemError(Mistake((), "expected a list of rows", "write [[1, 0], [0, 1]]; one row is [[1, 0]]"))
        if len({len(row) for row in rows}) > 1:
            raise ProblemError(Mistake((), f"rows have different lengths: {[len(r) for r in rows]}"))
        for i, row in enumerate(rows):
            for j, entry in enumerate(row):
                if isinstance(entry, bool) or not isinstance(entry, int | float | str | np.number):
                    raise ProblemError(Mistake((i, j), f"entry [{i + 1},{j + 1}] is not a number or a formula"))
        if any(isinstance(entry, str) for row in rows for entry in row):
            return ExpressionSignal(
                tuple(tuple(e if isinstance(e, str) else float(e) for e in row) for row in rows), variable
            )
    rows = np.array(rows, dtype=float)
    if rows.ndim != 2:
        raise ProblemError(Mistake((), "expected a matrix: a list of rows", "write [[1, 0], [0, 1]]"))
    if not np.all(np.isfinite(rows)):
        raise ProblemError(Mistake((), "the matrix holds a value that is not finite"))
    rows.setflags(write=False)
    return ConstantSignal(rows)

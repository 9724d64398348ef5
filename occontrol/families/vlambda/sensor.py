"""Sensors of discrete-time plants, some of which can be moved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from occontrol.core.errors import Collector, Mistake, ProblemError, plural
from occontrol.core.expression import parse_expression
from occontrol.core.jumps import require_still
from occontrol.core.kinds import CasadiFunction, Kept, MatrixLike, Plain
from occontrol.core.signal import Signal, as_signal


@dataclass(frozen=True, eq=False)
class LocatedMatrix:
    """A matrix whose entries are numbers or formulas of the step k and the location p1, p2, ..

    Parameters
    ----------
    entries : rows of numbers or formulas
    coordinates : how many of p1, p2, .. there are

    Raises ProblemError at the entry that uses another name.
    """

    entries: tuple[tuple[float | str, ...], ...]
    coordinates: int

    def __post_init__(self) -> None:
        found = Collector()
        rows = []
        for i, row in enumerate(self.entries):
            if not isinstance(row, list | tuple | np.ndarray):
                raise ProblemError(
                    Mistake((), "expected a list of rows", "write [[1, 0], [0, 1]]; one row is [[1, 0]]")
                )
            rows.append(tuple(entry if isinstance(entry, str) else float(entry) for entry in row))
            for j, entry in enumerate(rows[-1]):
                with found.under(i, j):
                    if isinstance(entry, str):
                        require_still(parse_expression(entry, self.variables))
                    elif not np.isfinite(entry):
                        raise ProblemError(Mistake((), "the matrix holds a value that is not finite"))
        if len({len(row) for row in rows}) > 1:
            raise ProblemError(Mistake((), f"rows have different lengths: {[len(row) for row in rows]}"))
        object.__setattr__(self, "entries", tuple(rows))
        found.raise_if_any()

    @property
    def variables(self) -> tuple[str, ...]:
        """("k", "p1", "p2", ..)"""
        return ("k", *(f"p{i + 1}" for i in range(self.coordinates)))

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)"""
        return len(self.entries), len(self.entries[0]) if self.entries else 0

    @cached_property
    def function(self) -> CasadiFunction:
        """CasADi function of k (1, N) and p (coordinates, N); one column of row-major entries per column."""
        import casadi

        step, place = casadi.SX.sym("k"), casadi.SX.sym("p", self.coordinates)
        symbols = {"k": step} | {f"p{i + 1}": place[i] for i in range(self.coordinates)}
        flat = [
            parse_expression(entry, self.variables).casadi(symbols) if isinstance(entry, str) else casadi.SX(entry)
            for row in self.entries
            for entry in row
        ]
        return casadi.Function("located", [step, place], [casadi.vertcat(*flat)])

    def sample(self, steps: np.ndarray, locations: np.ndarray) -> np.ndarray:
        """(N, rows, columns) at N steps and locations (N, coordinates)."""
        values = np.array(self.function(np.reshape(steps, (1, -1)).astype(float), np.asarray(locations, dtype=float).T))
        return np.ascontiguousarray(values.T).reshape(len(values.T), *self.shape)

    def __getstate__(self) -> dict:
        return {"entries": self.entries, "coordinates": self.coordinates}

    def __setstate__(self, state: dict) -> None:
        self.__dict__.update(state)

    def document(self) -> Plain:
        """What stands for this matrix in a problem file."""
        return [list(row) for row in self.entries]


@dataclass(frozen=True, eq=False)
class Region:
    """Where a movable sensor may be: a box, and formulas of p1, p2, .. and k that must not exceed 0.

    Parameters
    ----------
    bounds : (d, 2) lowest and highest value of each coordinate
    constraints : formulas c(p, k); the location is allowed where every c <= 0
    """

    bounds: Kept[Sequence[Sequence[float]] | np.ndarray, np.ndarray]
    constraints: Sequence[str] = ()

    def __post_init__(self) -> None:
        found = Collector()
        try:
            bounds = np.array(self.bounds, dtype=float)
        except (TypeError, ValueError):
            bounds = np.empty(0)
        shape: tuple[int, ...] = bounds.shape
        if len(shape) != 2 or shape[1] != 2 or not shape[0]:
            raise ProblemError(Mistake(("bounds",), "expected one [low, high] pair per coordinate", "bounds: [[0, 1]]"))
        for i in range(len(bounds)):
            low, high = float(bounds[i, 0]), float(bounds[i, 1])
            if not (np.isfinite(low) and np.isfinite(high)):
                found.add(("bounds", i), f"the bounds of p{i + 1} are not finite")
            elif low > high:
                found.add(("bounds", i), f"the bounds of p{i + 1} are [{low:g}, {high:g}]", "the lower one comes first")
        if isinstance(self.constraints, str):
            object.__setattr__(self, "constraints", (self.constraints,))
        object.__setattr__(self, "bounds", bounds)
        object.__setattr__(self, "constraints", tuple(self.constraints))
        variables = ("k", *(f"p{i + 1}" for i in range(len(bounds))))
        for i, text in enumerate(self.constraints):
            with found.under("constraints", i):
                require_still(parse_expression(text, variables))
        found.raise_if_any()

    @property
    def coordinates(self) -> int:
        """How many coordinates a location has."""
        return len(self.bounds)

    @cached_property
    def limits(self) -> LocatedMatrix:
        """The constraints as one column of formulas."""
        return LocatedMatrix(tuple((text,) for text in self.constraints), self.coordinates)

    def allowed(self, step: float, locations: np.ndarray, slack: float = 0.0) -> np.ndarray:
        """(N,) whether each of `locations` (N, d) satisfies every constraint (the box is not looked at)."""
        if not self.constraints:
            return np.ones(len(locations), dtype=bool)
        values = self.limits.sample(np.full(len(locations), step), locations)[:, :, 0]
        return np.all(values <= slack, axis=1)

    def __getstate__(self) -> dict:
        return {"bounds": self.bounds, "constraints": self.constraints}

    def __setstate__(self, state: dict) -> None:
        self.__dict__.update(state)


@dataclass(frozen=True, eq=False)
class DiscreteSensor:
    """One measurement subsystem of a discrete-time plant.

    y(k) = H(k) x(k) + v(k),   cov v(k) = R(k);   of a movable one H(p, k), R(p, k)

    Parameters
    ----------
    name : str, unique among the sensors of a problem
    H : (m, n) number, rows, array, formulas of k (and of p1, p2, .. if movable), or a Signal
    R : (m, m) covariance, symmetric positive definite
    location : Region of a movable sensor, or None

    Raises ProblemError for a wrong shape or an unknown name in a formula.
    Oshman (1994), equation (2) and remark 5.
    """

    name: str
    H: Kept[MatrixLike | LocatedMatrix, Any]
    R: Kept[MatrixLike | LocatedMatrix, Any]
    location: Region | None = field(default=None)

    def __post_init__(self) -> None:
        found = Collector()
        for name in ("H", "R"):
            value = getattr(self, name)
            with found.under(name):
                object.__setattr__(self, name, self._matrix(value))
        found.raise_if_any()
        m = self.rows
        if m == 0 or self.H.shape[1] == 0:
            raise ProblemError(Mistake(("H",), f"H of sensor '{self.name}' has no entries"))
        if self.R.shape != (m, m):
            rows, columns = self.R.shape
            what = f"R of sensor '{self.name}' is {rows}x{columns}, its H has {plural(m, 'row')}"
            raise ProblemError(Mistake(("R",), what, f"it must be {m}x{m}"))

    def _matrix(self, value: MatrixLike | LocatedMatrix) -> Signal | LocatedMatrix:
        if isinstance(value, LocatedMatrix):
            return value
        if self.location is None:
            return as_signal(value, "k")
        if isinstance(value, int | float | str) and not isinstance(value, bool):
            value = [[value]]
        if hasattr(value, "document"):
            signal = as_signal(value, "k")
            if not signal.constant:
                what = f"a matrix of the movable sensor '{self.name}' is tabulated"
                raise ProblemError(Mistake((), what, "write formulas of k and p1, p2, .."))
            value = signal.at(0.0)
        rows: Any = value.tolist() if isinstance(value, np.ndarray) else value
        return LocatedMatrix(
            tuple(tuple(row) if isinstance(row, list) else row for row in rows), self.location.coordinates
        )

    @property
    def rows(self) -> int:
        """The number m of values that one measurement has."""
        return self.H.shape[0]

    @property
    def movable(self) -> bool:
        """Whether the sensor's location is chosen too."""
        return self.location is not None

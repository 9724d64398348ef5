"""Matrices of models and looks for all targets of a table at once; mistakes are noted where they are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occontrol.core.checks import check_covariance, check_shape
from occontrol.core.clock import nearest_edge
from occontrol.core.errors import Path, plural
from occontrol.core.expression import parse_expression
from occontrol.core.jumps import deciding, jump_times
from occontrol.core.signal import Signal
from occontrol.families.athans.targets.formulas import evaluate, in_time, uses
from occontrol.families.athans.targets.tables import Columns
from occontrol.files.schema.common import Context

FIXED = "for ever there is one plant: numbers and columns, not formulas of t"


@dataclass(frozen=True, eq=False)
class Times:
    """The grid that everything is evaluated on: `edges` (N+1,), `middle` (N,) and `steps` (N,) of the intervals.

    With `fixed` nothing may change with time.
    """

    edges: np.ndarray
    middle: np.ndarray
    steps: np.ndarray
    fixed: bool = False


class MatrixColumns:
    """Reads matrices whose entries may be formulas of the columns of a table.

    Parameters
    ----------
    times : Times
    context : where mistakes are noted
    """

    def __init__(self, times: Times, context: Context):
        self.times, self.context, self.found = times, context, context.found

    def fixed(self, value: object, path: Path, numbers: Columns, G: int) -> np.ndarray | None:
        """(G, rows, columns) of something that does not change in time."""
        rows = self._rows(value, path, numbers, False)
        return None if rows is None else self._finite(alike(evaluate(rows, numbers)[:, 0], G), path)

    def shared(self, value: object, path: Path, numbers: Columns, G: int) -> np.ndarray | Signal | None:
        """(G, n, n), or a Signal that all targets share where it depends on time."""
        if is_table(value):
            return None if self._moves(path) else self.context.signal(value, *path)
        rows = self._rows(value, path, numbers, True)
        if rows is None:
            return None
        used = uses(rows, ("t", *numbers))
        if "t" in used and self._moves(path):
            return None
        if "t" not in used:
            return self._finite(alike(evaluate(rows, numbers)[:, 0], G), path)
        if used != {"t"}:
            what = f"{self.context.name(path)} depends on t and on the column '{sorted(used - {'t'})[0]}'"
            self.found.add(path, what, "plants may depend on time, or on columns, not on both")
            return None
        return in_time(rows)

    def varying(self, value: object, path: Path, columns: Columns, S: int) -> np.ndarray | None:
        """(S, 1 or N, rows, columns) of something that may change from interval to interval."""
        if is_table(value):
            signal = None if self._moves(path) else self.context.signal(value, *path)
            if signal is None:
                return None
            return np.broadcast_to(signal.sample(self.times.middle), (S, len(self.times.middle), *signal.shape))
        rows = self._rows(value, path, columns, True)
        if rows is None:
            return None
        moving = "t" in uses(rows, ("t", *columns))
        if moving and (self._moves(path) or self._jumps_inside(rows, path, columns)):
            return None
        values = evaluate(rows, columns, self.times.middle if moving else None)
        return self._finite(np.broadcast_to(values, (S, *values.shape[1:])), path)

    def _jumps_inside(self, rows: list[list[float | str]], path: Path, columns: Columns) -> bool:
        """Whether a formula jumps inside an interval, over which looks are held; noted."""
        edges, hint = self.times.edges, "jumps in time stand at edges of the horizon, the same for all targets"
        for text in (entry for row in rows for entry in row if isinstance(entry, str)):
            for own, names in deciding(parse_expression(text, ("t", *columns))):
                if "t" not in names:
                    continue
                others, what = sorted(names - {"t"}), ""
                if others:
                    what = f"compares t with the column '{others[0]}'"
                else:
                    times = jump_times(own, "t", float(edges[0]), float(edges[-1]))
                    inside = times[~nearest_edge(times, edges)[1]] if len(times) else times
                    what = f"jumps at t = {inside[0]:.9g}, inside an interval" if len(inside) else ""
                if what:
                    self.found.add(path, f"{self.context.name(path)} {what}", hint)
                    return True
        return False

    def require_square(self, value: np.ndarray | Signal, path: Path, n: int, covariance: bool = False) -> None:
        """Note where `value` (G, n, n), or a Signal, has another shape or is no covariance; at `path`."""
        name = self.context.name(path)
        shape = value.shape if isinstance(value, Signal) else value.shape[1:]
        wrong = check_shape(name, shape, n, n, path, f"the model has {plural(n, 'state')}")  # type: ignore[arg-type]
        self.found.mistakes += wrong
        if wrong or not covariance:
            return
        values = value.sample(self.times.middle) if isinstance(value, Signal) else value
        self.require_covariances(values, path)

    def require_covariances(self, values: np.ndarray, path: Path, definite: bool = False) -> None:
        """Note the first of `values` (K, n, n) that is no covariance."""
        swapped = np.swapaxes(values, 1, 2)
        spectrum = np.linalg.eigvalsh((values + swapped) / 2)
        least = 1e-12 * spectrum[:, -1] if definite else 0.0
        doubtful = (spectrum[:, 0] <= least) if definite else (spectrum[:, 0] < least)
        for i in np.flatnonzero(doubtful | (np.max(np.abs(values - swapped), axis=(1, 2)) > 0)):
            if found := check_covariance(self.context.name(path), values[i], path, definite):
                self.found.mistakes += found
                return

    def _rows(self, value: object, path: Path, numbers: Columns, time: bool) -> list[list[float | str]] | None:
        return self.context.rows(value, *path, variables=("t", *numbers) if time else tuple(numbers))

    def _moves(self, path: Path) -> bool:
        """Note that something changes with time where nothing may; whether that is so."""
        if self.times.fixed:
            self.found.add(path, f"{self.context.name(path)} changes with t", FIXED)
        return self.times.fixed

    def _finite(self, values: np.ndarray, path: Path) -> np.ndarray | None:
        if np.all(np.isfinite(values)):
            return values
        i = int(np.argwhere(~np.isfinite(values))[0][0])
        self.found.add(path, f"{self.context.name(path)} is not finite in row {i + 1}")
        return None


def is_table(value: object) -> bool:
    """Whether a matrix of the document is a table in time."""
    return isinstance(value, dict) and bool({"times", "file"} & set(value))


def semidefinite(values: np.ndarray) -> np.ndarray:
    """`values` (G, n, n), weights, without what lies below zero within the tolerance of the check: J stays convex."""
    eigenvalues, vectors = np.linalg.eigh((values + np.swapaxes(values, 1, 2)) / 2)
    below = np.flatnonzero(eigenvalues[:, 0] < 0)
    if not len(below):
        return values
    found = values.copy()
    kept = vectors[below] * np.maximum(eigenvalues[below], 0.0)[:, None, :]
    found[below] = kept @ np.swapaxes(vectors[below], 1, 2)
    return found


def alike(values: np.ndarray, G: int) -> np.ndarray:
    """(G, ..) of values (1 or G, ..): the same for every target where nothing depends on columns."""
    return np.array(np.broadcast_to(values, (G, *values.shape[1:])))

"""Matrices of a target model: numbers, formulas of t and of the columns of a table, or tables in time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from occontrol.core.expression import parse_expression
from occontrol.core.signal import ExpressionSignal, Signal

CHUNK = 1_000_000  # points at which formulas are evaluated at once


def uses(rows: Sequence[Sequence[float | str]], variables: tuple[str, ...]) -> set[str]:
    """The variables that the formulas among rows use.

    Parameters
    ----------
    rows : of numbers and formulas
    variables : names that they may use
    """
    found: set[str] = set()
    for row in rows:
        for entry in row:
            if isinstance(entry, str):
                found |= parse_expression(entry, variables).used
    return found


def evaluate(
    rows: Sequence[Sequence[float | str]], columns: Mapping[str, np.ndarray], times: np.ndarray | None = None
) -> np.ndarray:
    """The matrices (G, K, rows, columns) that rows of numbers and formulas give, K = 1 without times.

    Parameters
    ----------
    rows : of numbers and formulas
    columns : (G,) values by name
    times : (K,) values of t
    """
    import casadi

    G = len(next(iter(columns.values()))) if columns else 1
    K = 1 if times is None else len(times)
    shape = len(rows), len(rows[0])
    constant = np.array([[0.0 if isinstance(e, str) else e for e in row] for row in rows])
    found = np.empty((G, K, *shape))
    found[:] = constant
    variables = ("t", *columns)
    symbols = {name: casadi.SX.sym(name) for name in variables}
    for i, row in enumerate(rows):
        for j, entry in enumerate(row):
            if not isinstance(entry, str):
                continue
            expression = parse_expression(entry, variables)
            used = [name for name in variables if name in expression.used]
            if not used:
                found[:, :, i, j] = float(casadi.evalf(casadi.SX(expression.casadi(symbols))))
                continue
            function = casadi.Function("entry", [symbols[name] for name in used], [expression.casadi(symbols)])
            values = [
                np.broadcast_to(
                    np.asarray(times if name == "t" else columns[name], dtype=float)[
                        (None, slice(None)) if name == "t" else (slice(None), None)
                    ],
                    (G, K),
                ).reshape(-1)
                for name in used
            ]
            flat = np.empty(G * K)
            for a in range(0, G * K, CHUNK):
                part = function(*(v[a : a + CHUNK][None] for v in values))
                flat[a : a + CHUNK] = np.array(part).reshape(-1)
            found[:, :, i, j] = flat.reshape(G, K)
    return found


def in_time(rows: Sequence[Sequence[float | str]]) -> Signal:
    """Rows of numbers and formulas of t alone, as a Signal."""
    return ExpressionSignal(tuple(tuple(row) for row in rows))

"""Times at which a formula is infinite although it is finite on every sample, such as 1/(t - 0.3) on a grid around 0.3.

A formula can only be infinite where a divisor, the base of a power, the argument of a logarithm or the cosine in a
tangent vanishes. Those subformulas are sampled; every change of sign is bisected and every dip of their size is
narrowed down to neighbouring floats, and the formula itself is looked at there. Zeros that cancel, as in sin(t)/t,
leave it small and are no poles.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from occontrol.core.expression import Expression

GROWTH = 1e4  # a pole of order 1/4 is 1e4 times larger one float beside it than a grid step away
TINY = 1e-7
MOST_ZEROS = 200  # zeros looked at
_SHRINK = (3 - 5**0.5) / 2


def suspects(tree: ast.expr) -> list[tuple[ast.expr, str]]:
    """Subformulas at whose zeros the formula may be infinite, each with what it is.

    '/' is a divisor, 'log' the argument of a logarithm, 'cos' that of a tangent, whose cosine is to be looked at.
    """
    found: list[tuple[ast.expr, str]] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Div):
            found += [(f, "/") for f in _factors(node.right)]
        elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow) and not isinstance(node.right, ast.Constant):
            found += [(f, "/") for f in _factors(node.left)]
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            if node.func.id in ("log", "log10"):
                found += [(f, "log") for f in _factors(node.args[0])]
            elif node.func.id == "tan":
                found.append((node.args[0], "cos"))
    return [(f, g) for f, g in found if not isinstance(f, ast.Constant)]


def _factors(node: ast.expr) -> list[ast.expr]:
    """Factors of which one must vanish when the node does."""
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult):
        return _factors(node.left) + _factors(node.right)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow | ast.Div):
        return _factors(node.left)
    if isinstance(node, ast.UnaryOp):
        return _factors(node.operand)
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in ("abs", "sqrt"):
        return _factors(node.args[0])
    return [node]


def find_pole(expression: Expression, variable: str, times: np.ndarray) -> float | None:
    """The first time between the samples at which the formula of one variable is infinite, or None.

    Parameters
    ----------
    expression : formula that is finite at all `times`
    variable : the name of its variable
    times : (K,) increasing, in the unit of time; zeros closer together than a step may be missed
    """
    if len(times) < 2 or not expression.suspects:
        return None
    import casadi

    symbol = casadi.SX.sym(variable)
    zeros, value = expression.casadi_suspects({variable: symbol}), expression.casadi({variable: symbol})
    function = casadi.Function("suspects", [symbol], [casadi.vertcat(*zeros), value])

    def evaluate(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        below, whole = function(np.asarray(t).reshape(1, -1))
        return np.array(below), np.abs(np.array(whole)).ravel()

    with np.errstate(all="ignore"):
        below, whole = evaluate(times)
        poles = []
        for row, (_, outer) in enumerate(expression.suspects):
            for low, high, k in _zeros(row, below[row], times, evaluate):
                # a few floats aside, because 0/0 is no number even where the quotient has a limit
                z, value = evaluate(np.array([low - 4 * np.spacing(low), high + 4 * np.spacing(high)]))
                if outer == "log":
                    infinite = np.min(np.abs(z[row])) < TINY * np.max(np.abs(below[row][k]))
                else:
                    infinite = not np.max(value) <= GROWTH * max(np.max(whole[k]), 1e-300)
                poles += [float(low)] if infinite else []
    return min(poles, default=None)


Evaluate: TypeAlias = "Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]"
"""Times (K,) -> the suspects (rows, K), and the size (K,) of the formula."""


def _zeros(row: int, z: np.ndarray, times: np.ndarray, evaluate: Evaluate) -> Iterator[tuple[float, float, np.ndarray]]:
    """(low, high, the samples around them): neighbouring floats at which z changes its sign, or is smallest."""
    crossing = np.flatnonzero(z[:-1] * z[1:] < 0)[:MOST_ZEROS]
    if len(crossing):
        low, high, left = times[crossing], times[crossing + 1], np.sign(z[crossing])
        for _ in range(80):
            middle = (low + high) / 2
            same = np.sign(evaluate(middle)[0][row]) == left
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        yield from ((a, b, np.array([k, k + 1])) for a, b, k in zip(low, high, crossing, strict=True))
    size = np.abs(z)
    dip = (size[1:-1] <= size[:-2]) & (size[1:-1] <= size[2:]) & (size[1:-1] < np.maximum(size[:-2], size[2:]))
    dips = 1 + np.flatnonzero(dip & (z[:-2] * z[2:] > 0))[:MOST_ZEROS]
    if len(dips):
        low, high = times[dips - 1], times[dips + 1]
        for _ in range(100):
            a, b = low + _SHRINK * (high - low), high - _SHRINK * (high - low)
            left_smaller = np.abs(evaluate(a)[0][row]) <= np.abs(evaluate(b)[0][row])
            low, high = np.where(left_smaller, low, a), np.where(left_smaller, b, high)
        yield from ((a, b, np.array([k - 1, k + 1])) for a, b, k in zip(low, high, dips, strict=True))

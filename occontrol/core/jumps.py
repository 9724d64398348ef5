"""Times at which a formula jumps: where a comparison changes its answer, and where step, sign, floor and ceil jump.

Every jump happens where an argument g(t) crosses 0 (a whole number, in floor and ceil). Where g is a + b t the time is
computed in rational arithmetic and rounded once. Otherwise the horizon is cut until every piece either certainly holds
no crossing, or g certainly rises or falls all along it (see enclosure.py); then one crossing at most is left, and it is
pinned down to neighbouring floats. Where neither can be had, a comparison or step is refused. So no jump is missed.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from fractions import Fraction
from itertools import pairwise

import numpy as np

from occontrol.core.enclosure import enclose
from occontrol.core.errors import ProblemError
from occontrol.core.expression import CONSTANTS, Expression, function_of, parse_expression

MOST = 2000  # jumps of one formula on a horizon
MOST_PIECES = 4096  # that may be undecided at the same time
ULPS = 4.0  # a piece so short is a place
SAME = 1e-12  # of the horizon, within which two jumps are one
NARROW = 1e-9  # of the horizon, within which nothing may jump twice
_OLD = ("sign", "floor", "ceil")  # may stay unfound: the first formulas had them, and integrators look for kinks
MOST_KNOWN = 4096  # formulas whose jumps are remembered, for the longest horizon asked for
_known: dict[tuple[str, str], tuple[float, float, tuple[float, ...]]] = {}
HINT = "compare t with a number (t < 5), or give a table with interpolation: previous"


def conditions(expression: Expression) -> list[tuple[str, ast.expr]]:
    """(what, g) of every jump in a formula, inner ones first; `what` is the function, or 'compare'.

    Parameters
    ----------
    expression : checked formula
    """
    return list(_conditions(expression.tree))


def _conditions(node: ast.AST) -> Iterator[tuple[str, ast.expr]]:
    for child in ast.iter_child_nodes(node):
        yield from _conditions(child)
    if isinstance(node, ast.Compare):
        for a, b in pairwise((node.left, *node.comparators)):
            yield "compare", ast.BinOp(a, ast.Sub(), b)
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in ("step", *_OLD):
        yield node.func.id, node.args[0]


def deciding(expression: Expression) -> list[tuple[str, set[str]]]:
    """(formula, its variables) of everything that a comparison or a step of a formula depends on.

    Parameters
    ----------
    expression : checked formula

    Each formula jumps when its comparison, or step, does.
    """
    found = [g for what, g in conditions(expression) if what not in _OLD]
    known = set(expression.variables)
    named = ({node.id for node in ast.walk(g) if isinstance(node, ast.Name)} & known for g in found)
    return [(f"step({ast.unparse(g)})", names) for g, names in zip(found, named, strict=True)]


def require_still(expression: Expression) -> None:
    """Raise ProblemError where a comparison or a step depends on anything but k.

    Parameters
    ----------
    expression : checked formula of what a run only knows while it runs
    """
    by = sorted({name for _, names in deciding(expression) for name in names} - {"k"})
    if by:
        hint = "use what is smooth, such as tanh(20*(x - 1)); a comparison may depend on k in discrete time"
        raise ProblemError(f"formula '{expression.text}' jumps as '{by[0]}' changes", hint)


def jump_times(text: str, variable: str, start: float, end: float) -> np.ndarray:
    """All times (K,) between start and end at which a formula may jump, increasing.

    Parameters
    ----------
    text : formula of one variable
    variable : its name
    start, end : in the unit of time

    Raises ProblemError where a comparison or a step crosses at times that cannot be told, or more than 2000 times.
    """
    known = _known.get((text, variable))
    if known is None or start < known[0] or end > known[1]:
        if len(_known) >= MOST_KNOWN:
            _known.clear()
        known = _known[text, variable] = (start, end, _located(text, variable, start, end))
    times = np.array(known[2])
    return times[(times > start) & (times < end)]


def _located(text: str, variable: str, start: float, end: float) -> tuple[float, ...]:
    expression, found = parse_expression(text, (variable,)), set()
    for what, g in conditions(expression):
        try:
            times = _crossings(g, what in ("floor", "ceil"), start, end, sorted(found))
            found |= set(_apart(times, start, end))
        except ProblemError as error:
            if what not in _OLD:
                shown = text if len(text) <= 60 else text[:57] + "..."
                raise ProblemError(f"formula '{shown}' {error.mistakes[0].what}", HINT) from None
    return tuple(sorted(found))


def _linear(node: ast.expr) -> tuple[Fraction, Fraction] | None:
    """(a, b) of a + b t, exactly; None where the formula is nothing of the kind."""
    if isinstance(node, ast.Constant):
        return Fraction(float(node.value)), Fraction(0)  # type: ignore[arg-type]
    if isinstance(node, ast.Name):
        return (Fraction(CONSTANTS[node.id]), Fraction(0)) if node.id in CONSTANTS else (Fraction(0), Fraction(1))
    if isinstance(node, ast.UnaryOp):
        inside = _linear(node.operand)
        minus = -1 if isinstance(node.op, ast.USub) else 1
        return None if inside is None or isinstance(node.op, ast.Not) else (minus * inside[0], minus * inside[1])
    if not isinstance(node, ast.BinOp):
        return None
    left, right = _linear(node.left), _linear(node.right)
    if left is None or right is None:
        return None
    (a, b), (c, d) = left, right
    if isinstance(node.op, ast.Add):
        return a + c, b + d
    if isinstance(node.op, ast.Sub):
        return a - c, b - d
    if isinstance(node.op, ast.Mult) and not (b and d):
        return a * c, a * d + b * c
    return (a / c, b / c) if isinstance(node.op, ast.Div) and not d and c else None


def _crossings(g: ast.expr, whole: bool, start: float, end: float, knots: list[float]) -> list[float]:
    """Times in [start, end] at which g crosses 0, or any whole number; `knots` are jumps of what g is made of."""
    straight = _linear(g)
    if straight is not None:
        a, b = straight
        if not b:
            return []
        first, last = sorted((a + b * Fraction(start), a + b * Fraction(end)))
        levels = range(-(-first.numerator // first.denominator), last.numerator // last.denominator + 1)
        if whole and len(levels) > MOST:
            raise ProblemError(f"jumps {len(levels)} times, more than {MOST}")
        times = [float((n - a) / b) for n in (levels if whole else (0,))]
        return [t for t in times if start <= t <= end]
    return _isolated(g, whole, start, end, knots)


def _isolated(g: ast.expr, whole: bool, start: float, end: float, knots: list[float]) -> list[float]:
    span = end - start
    marks = np.array([start, *[t for t in knots if start < t < end], end])
    aside = SAME / 10 * span + np.zeros(len(marks))
    aside[0] = aside[-1] = 0.0
    low, high = (marks + aside)[:-1], (marks - aside)[1:]
    keep = high > low
    low, high = low[keep], high[keep]
    found: list[float] = []
    while len(low):
        bounds = enclose(g, low, high, CONSTANTS)
        bottom, top = bounds.value
        level, highest = (np.ceil(bottom), np.floor(top)) if whole else (np.zeros(len(low)), np.zeros(len(low)))
        maybe = (level <= highest) if whole else (bottom <= 0) & (top >= 0)
        one = maybe & (level == highest) & ((bounds.slope[0] > 0) | (bounds.slope[1] < 0))
        found += _bisected(g, low[one], high[one], level[one])
        short = maybe & ~one & (high - low <= ULPS * np.spacing(np.maximum(np.abs(low), np.abs(high)) + span))
        found += [float(t) for t in (low[short] + high[short]) / 2]
        rest = maybe & ~one & ~short
        if len(found) > MOST_PIECES:
            raise ProblemError(f"jumps more than {MOST} times")
        if np.sum(rest) > MOST_PIECES:
            at = float(low[rest][0])
            raise ProblemError(f"jumps too often, or at times that cannot be told for certain, near {at:.6g}")
        middle = (low[rest] + high[rest]) / 2
        low, high = np.concatenate([low[rest], middle]), np.concatenate([middle, high[rest]])
    return found


def _bisected(g: ast.expr, low: np.ndarray, high: np.ndarray, level: np.ndarray) -> list[float]:
    """Where g, which rises or falls all along each piece, crosses its level; pieces without a crossing have none.

    The formula is evaluated as it is when it is used, so what is found is the float at which its answer changes.
    """
    if not len(low):
        return []
    evaluate = function_of(g)

    def side(t: np.ndarray) -> np.ndarray:
        return np.sign(evaluate(t) - level)

    left, right = side(low), side(high)
    crosses = ~(left * right > 0)
    a, b = low.copy(), high.copy()
    while True:
        middle = a + (b - a) / 2
        if not np.any((middle > a) & (middle < b)):
            return [float(t) for t in b[crosses]]
        same = side(middle) == left
        a, b = np.where(same, middle, a), np.where(same, b, middle)


def _apart(times: list[float], start: float, end: float) -> list[float]:
    """Places inside the horizon, each once; ProblemError where two are too close for any integration between."""
    span, result = end - start, [start]
    for t in sorted(times):
        if min(t - result[-1], end - t) > SAME * span:
            result.append(t)
    close = np.diff(result[1:]) < NARROW * span
    if np.any(close):
        raise ProblemError(f"jumps twice within {NARROW:g} of the horizon near {result[1 + int(np.argmax(close))]:.6g}")
    if len(result) > MOST + 1:
        raise ProblemError(f"jumps {len(result) - 1} times, more than {MOST}")
    return result[1:]

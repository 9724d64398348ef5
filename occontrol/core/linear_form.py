"""Rows of a matrix written by the names of the states: 'vx - vy' is +1 for vx, -1 for vy and 0 for the others."""

from __future__ import annotations

import ast
from collections.abc import Sequence

from occontrol.core.errors import ProblemError
from occontrol.core.expression import parse_expression, value_of

HINT = "a row by names is a sum of states times numbers, such as 'x - 2*y'; a row by numbers is [[1, -2]]"


def linear_form(text: str, names: Sequence[str], variables: Sequence[str]) -> list[float | str]:
    """One entry per state: a number, or a formula where the factor depends on a variable.

    Parameters
    ----------
    text : a formula that is linear in the states, without a constant part
    names : of the states
    variables : what factors may depend on

    Raises ProblemError where `text` is not linear in the states, or names something else.
    """
    states = [name for name in names if name not in variables]
    expression = parse_expression(text, (*states, *variables))
    terms = _terms(expression.tree, text.strip(), frozenset(states))
    row: list[float | str] = []
    for name in names:
        factors = terms.get(name, [])
        whole = " + ".join(factors) or "0"
        varies = parse_expression(whole, tuple(variables)).used
        row.append(whole if varies else value_of(whole))
    return row


def _terms(node: ast.expr, text: str, states: frozenset[str]) -> dict[str, list[str]]:
    """The factors of every state, as formulas."""
    if isinstance(node, ast.Name) and node.id in states:
        return {node.id: ["1"]}
    if isinstance(node, ast.UnaryOp):
        inside = _terms(node.operand, text, states)
        return _each(inside, "-({})") if isinstance(node.op, ast.USub) else inside
    if isinstance(node, ast.BinOp):
        left, right = _uses(node.left, states), _uses(node.right, states)
        if isinstance(node.op, ast.Add | ast.Sub):
            result = _terms(node.left, text, states)
            others = _terms(node.right, text, states)
            for name, factors in (_each(others, "-({})") if isinstance(node.op, ast.Sub) else others).items():
                result.setdefault(name, []).extend(factors)
            return result
        if isinstance(node.op, ast.Mult) and left != right:
            inner, factor = (node.left, node.right) if left else (node.right, node.left)
            return _each(_terms(inner, text, states), f"({ast.get_source_segment(text, factor)})*({{}})")
        if isinstance(node.op, ast.Div) and left and not right:
            return _each(_terms(node.left, text, states), f"({{}})/({ast.get_source_segment(text, node.right)})")
    what = "is not linear in the states" if _uses(node, states) else "has a part without a state"
    raise ProblemError(f"'{text if len(text) <= 60 else text[:57] + '...'}' {what}", HINT)


def _uses(node: ast.expr, states: frozenset[str]) -> bool:
    return any(isinstance(each, ast.Name) and each.id in states for each in ast.walk(node))


def _each(terms: dict[str, list[str]], form: str) -> dict[str, list[str]]:
    return {name: [form.format(factor) for factor in factors] for name, factors in terms.items()}

"""Scalar expressions such as '0.95*(sin(0.01*t)+0.1)', through an AST whitelist straight to CasADi.

Nothing is ever evaluated by Python: the text is parsed to a syntax tree, every node is checked against a short list,
and the tree is rebuilt from CasADi operations. Numbers become floats at once, so '9**9**9' overflows to infinity
instead of occupying the machine.
"""

from __future__ import annotations

import ast
import keyword
import math
import operator
import unicodedata
import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, lru_cache, reduce

import numpy as np

from occontrol.core.errors import ProblemError, suggest
from occontrol.core.kinds import Casadi
from occontrol.core.poles import suspects

MAX_LENGTH = 10_000
MAX_DEPTH = 100
MAX_NODES = 5_000

CONSTANTS = {"pi": math.pi, "e": math.e}

# name: (CasADi function, fewest arguments, most arguments); most = 0 means any number
FUNCTIONS: dict[str, tuple[str, int, int]] = {
    **{
        name: (name, 1, 1)
        for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh", "exp", "log", "sqrt", "sign", "floor")
    },
    **{name: (name, 1, 1) for name in ("asin", "acos", "atan", "asinh", "acosh", "atanh", "log10", "ceil", "erf")},
    "abs": ("fabs", 1, 1),
    "atan2": ("atan2", 2, 2),
    "hypot": ("hypot", 2, 2),
    "min": ("fmin", 2, 0),
    "max": ("fmax", 2, 0),
    "step": ("step", 1, 1),
    "if_else": ("if_else", 3, 3),
}
_BINARY = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
_COMPARE = {ast.Lt: operator.lt, ast.LtE: operator.le, ast.Gt: operator.gt, ast.GtE: operator.ge}
_CONDITION = "a condition is t < 5, or several of them joined by and, or, not"


TIME = ("t", "k")  # what formulas call time and step


def reserved(name: str) -> str:
    """What a name already stands for in formulas; empty where it is free.

    Parameters
    ----------
    name : a word
    """
    if name in FUNCTIONS:
        return "a function of formulas"
    if name in CONSTANTS:
        return f"the number {CONSTANTS[name]:.6g} in formulas"
    if name in TIME:
        return "time in formulas"
    return "a word of formulas" if keyword.iskeyword(name) else ""


def _fail(text: str, what: str, hint: str = "") -> ProblemError:
    shown = text if len(text) <= 60 else text[:57] + "..."
    return ProblemError(f"expression '{shown}' {what}", hint)


def _parse(text: str) -> ast.expr:
    if len(text) > MAX_LENGTH:
        raise _fail(
            text, f"has {len(text)} characters, the limit is {MAX_LENGTH}", "use a table: {times: ..., values: ...}"
        )
    if not text.isascii():  # Python would read look-alikes as the letters that they resemble
        strange = next(c for c in text if not c.isascii())
        what = f"contains '{strange}' ({unicodedata.name(strange, 'a character without a name').lower()})"
        raise _fail(text, what, "write formulas in plain ASCII letters, digits and signs")
    depth = deepest = 0
    for c in text:
        depth += (c in "([{") - (c in ")]}")
        deepest = max(deepest, depth)
    if deepest > MAX_DEPTH:
        raise _fail(text, f"nests {deepest} parentheses, the limit is {MAX_DEPTH}")
    try:
        with warnings.catch_warnings():  # '1if t else 2' would print one
            warnings.simplefilter("ignore")
            tree = ast.parse(text.strip(), mode="eval").body
    except (RecursionError, MemoryError):
        what = "has too many terms in a row or is nested too deeply"
        raise _fail(text, what, "use a table: {times: ..., values: ...}") from None
    except (SyntaxError, ValueError) as error:
        what = "is not a formula" if text.strip() else "is empty"
        raise _fail(text, what, f"syntax: {getattr(error, 'msg', error)}") from None
    count, level, nodes = 0, 0, [tree]
    while nodes:
        level += 1
        count += len(nodes)
        if count > MAX_NODES:
            raise _fail(text, f"has more than {MAX_NODES} terms", "use a table: {times: ..., values: ...}")
        if level > 4 * MAX_DEPTH:
            # long sums lean to the left, one level a term
            raise _fail(
                text, f"has more than {4 * MAX_DEPTH} terms in a row", "group terms with parentheses, or use a table"
            )
        nodes = [child for node in nodes for child in ast.iter_child_nodes(node)]
    return tree


class Expression:
    """A checked scalar formula of named variables.

    Parameters
    ----------
    text : str
        The formula: + - * / **, parentheses, numbers, pi, e, the functions in `FUNCTIONS`, and comparisons, which are
        1 where they hold and 0 elsewhere; core/jumps.py knows when they change.
    variables : sequence of str
        The names that it may use, e.g. ("t",).

    Raises ProblemError when anything else stands in the text.
    """

    def __init__(self, text: str, variables: Sequence[str] = ("t",)):
        self.text, self.variables = text, tuple(variables)
        self.tree = _parse(text)
        self.used: frozenset[str] = frozenset()
        self._check()

    def _check(self) -> None:
        used = set()
        callees = set()
        for node in ast.walk(self.tree):
            if isinstance(node, ast.Constant):
                if isinstance(node.value, bool) or not isinstance(node.value, int | float):
                    raise _fail(self.text, f"contains {node.value!r}, which is not a number")
                try:
                    finite = math.isfinite(float(node.value))
                except OverflowError:
                    finite = False
                if not finite:
                    raise _fail(self.text, "contains a number that is not finite")
            elif isinstance(node, ast.Call):
                if not isinstance(node.func, ast.Name) or node.keywords:
                    raise _fail(
                        self.text,
                        "calls something that is not a plain function",
                        "functions: " + ", ".join(sorted(FUNCTIONS)),
                    )
                name, given = node.func.id, len(node.args)
                if name not in FUNCTIONS:
                    hint = suggest(name, sorted(FUNCTIONS), "known names")
                    raise _fail(self.text, f"calls the unknown function '{name}'", hint)
                _, fewest, most = FUNCTIONS[name]
                if given < fewest or (most and given > most):
                    wanted = str(fewest) if most == fewest else f"at least {fewest}"
                    raise _fail(self.text, f"gives {name} {given} argument{'s' * (given != 1)}, it takes {wanted}")
                callees.add(node.func)
                if name == "if_else":
                    self._condition(node.args[0], "decides by something that is no comparison")
            elif isinstance(node, ast.Compare):
                if not all(type(op) in _COMPARE for op in node.ops):
                    raise _fail(self.text, "compares otherwise than by <, <=, > or >=", "write 2 <= t <= 3 for a span")
            elif isinstance(node, ast.BoolOp) or (isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not)):
                for part in node.values if isinstance(node, ast.BoolOp) else [node.operand]:
                    self._condition(part, "joins something that is no comparison")
            elif isinstance(node, ast.Name):
                if node in callees:
                    continue
                if node.id in self.variables:
                    used.add(node.id)
                elif node.id not in CONSTANTS:
                    hint = suggest(node.id, [*self.variables, *CONSTANTS], "known names")
                    if node.id in FUNCTIONS:
                        hint = f"'{node.id}' is a function: write {node.id}(...)"
                    raise _fail(self.text, f"uses the unknown name '{node.id}'", hint)
            elif isinstance(node, ast.BinOp):
                if type(node.op) not in _BINARY:
                    hint = "write ** for a power" if isinstance(node.op, ast.BitXor) else "operators: + - * / **"
                    raise _fail(self.text, "uses an operator that is not allowed", hint)
            elif isinstance(node, ast.UnaryOp):
                if not isinstance(node.op, ast.USub | ast.UAdd | ast.Not):
                    raise _fail(self.text, "uses an operator that is not allowed", "operators: + - * / **")
            elif isinstance(node, ast.Attribute):
                raise _fail(
                    self.text, f"uses '.{node.attr}': attributes are not allowed", "write sin(t), not math.sin(t)"
                )
            elif not isinstance(node, ast.operator | ast.unaryop | ast.expr_context | ast.cmpop | ast.boolop):
                hint = "write if_else(t < 5, this, other)" if isinstance(node, ast.IfExp) else ""
                raise _fail(self.text, f"contains something that is not a formula ({type(node).__name__})", hint)
        self.used = frozenset(used)

    def _condition(self, node: ast.expr, what: str) -> None:
        if not (
            isinstance(node, ast.Compare | ast.BoolOp)
            or (isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not))
        ):
            raise _fail(self.text, what, _CONDITION)

    def casadi(self, symbols: dict[str, Casadi]) -> Casadi:
        """The formula rebuilt over CasADi symbols, one for each name in `variables`."""
        return _build(self.tree, symbols)

    @cached_property
    def suspects(self) -> list[tuple[ast.expr, str]]:
        """Subformulas at whose zeros the formula may be infinite."""
        return suspects(self.tree)

    def casadi_suspects(self, symbols: dict[str, Casadi]) -> list[Casadi]:
        """The suspects over CasADi symbols."""
        import casadi

        built = [(_build(node, symbols), outer) for node, outer in self.suspects]
        return [casadi.cos(node) if outer == "cos" else node for node, outer in built]


def _build(node: ast.expr, symbols: dict[str, Casadi]) -> Casadi:
    """A checked syntax tree over CasADi symbols."""
    import casadi

    if isinstance(node, ast.Constant):
        return casadi.SX(float(node.value))  # type: ignore[arg-type]
    if isinstance(node, ast.Name):
        return symbols[node.id] if node.id in symbols else casadi.SX(CONSTANTS[node.id])
    if isinstance(node, ast.BinOp):
        return _BINARY[type(node.op)](_build(node.left, symbols), _build(node.right, symbols))
    if isinstance(node, ast.UnaryOp):
        operand = _build(node.operand, symbols)
        if isinstance(node.op, ast.Not):
            return casadi.logic_not(operand)
        return -operand if isinstance(node.op, ast.USub) else operand
    if isinstance(node, ast.BoolOp):
        join = casadi.logic_and if isinstance(node.op, ast.And) else casadi.logic_or
        return reduce(join, [_build(part, symbols) for part in node.values])
    if isinstance(node, ast.Compare):
        values = [_build(part, symbols) for part in (node.left, *node.comparators)]
        held = [_COMPARE[type(op)](a, b) for a, op, b in zip(values, node.ops, values[1:], strict=False)]
        return reduce(casadi.logic_and, held)
    assert isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
    values = [_build(a, symbols) for a in node.args]
    if node.func.id == "step":
        return values[0] >= 0
    if node.func.id == "if_else":
        return casadi.if_else(*values)
    function = getattr(casadi, FUNCTIONS[node.func.id][0])
    result = function(*values[:2]) if len(values) > 1 else function(values[0])
    for value in values[2:]:
        result = function(result, value)
    return result


def function_of(node: ast.expr) -> Callable[[np.ndarray], np.ndarray]:
    """Times (K,) -> values (K,) of a checked formula, or a part of one, that knows one variable.

    Parameters
    ----------
    node : its syntax tree
    """
    import casadi

    symbol = casadi.SX.sym("t")
    names = {n.id for n in ast.walk(node) if isinstance(n, ast.Name)} - CONSTANTS.keys() - FUNCTIONS.keys()
    function = casadi.Function("part", [symbol], [_build(node, dict.fromkeys(names, symbol))])
    return lambda times: np.array(function(np.asarray(times).reshape(1, -1))).ravel()


def value_of(text: str, values: Mapping[str, float] | None = None) -> float:
    """The number that a formula is, with numbers in place of names.

    Parameters
    ----------
    text : a formula of nothing but `values`
    values : the names that it may use, each in its own unit

    Raises ProblemError where `text` is not a formula of these.
    """
    import casadi

    symbols = {name: casadi.SX(value) for name, value in (values or {}).items()}
    result = parse_expression(text, tuple(symbols)).casadi(symbols)
    return float(casadi.Function("number", [], [result])()["o0"])


@lru_cache(maxsize=4096)
def parse_expression(text: str, variables: tuple[str, ...] = ("t",)) -> Expression:
    """`Expression(text, variables)`, remembered: problem files repeat the same few formulas."""
    return Expression(text, variables)

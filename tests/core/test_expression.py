"""Formulas: the same numbers as Python's own mathematics, and nothing but numbers."""

import ast
import math

import casadi
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from occontrol.core.errors import ProblemError
from occontrol.core.expression import CONSTANTS, FUNCTIONS, Expression, parse_expression
from occontrol.core.poles import find_pole

PYTHON = {name: getattr(math, name, None) for name in FUNCTIONS}
PYTHON |= {"abs": abs, "min": min, "max": max, "sign": lambda x: (x > 0) - (x < 0), "__builtins__": {}, **CONSTANTS}
PYTHON |= {"step": lambda x: float(x >= 0), "if_else": lambda c, a, b: a if c else b}


def value(text: str, **variables: float) -> float:
    symbols = {name: casadi.SX.sym(name) for name in variables}
    formula = parse_expression(text, tuple(variables)).casadi(symbols)
    return float(casadi.Function("f", list(symbols.values()), [formula])(*variables.values()))


@pytest.mark.parametrize("name", sorted(FUNCTIONS))
def test_every_function_is_python_s(name):
    x = 1.3 if name == "acosh" else 0.7
    arguments = {1: "x", 2: "x, 0.4", 3: "x < 0.5, x, 0.4"}[FUNCTIONS[name][1]]
    assert value(f"{name}({arguments})", x=x) == pytest.approx(
        eval(f"{name}({arguments})", PYTHON, {"x": x}), rel=1e-14
    )


@pytest.mark.parametrize(
    "text",
    [
        "0.95*(sin(0.01*t)+0.1)",
        "-t**2",
        "2**-t",
        "2**3**t",
        "-(-t)",
        "+t - -t",
        "1e-3*t/3/4",
        "max(t, 2, pi) - min(t, e)",
        "  t  ",
    ],
)
def test_precedence_is_python_s(text):
    assert value(text, t=1.7) == pytest.approx(eval(text.strip(), PYTHON, {"t": 1.7}), rel=1e-15)


def numbers() -> st.SearchStrategy[str]:
    return st.floats(0.1, 10).map(repr) | st.integers(1, 9).map(str) | st.sampled_from(["t", "pi", "e"])


formulas = st.recursive(
    numbers(),
    lambda inner: (
        st.tuples(inner, st.sampled_from("+-*/"), inner).map(lambda x: f"({x[0]} {x[1]} {x[2]})")
        | st.tuples(st.sampled_from(["sin", "cos", "tanh", "atan", "erf", "abs"]), inner).map(
            lambda x: f"{x[0]}({x[1]})"
        )
        | inner.map(lambda x: f"-{x}")
    ),
    max_leaves=12,
)


@settings(max_examples=60, deadline=None)
@given(formulas, st.floats(-3, 3))
def test_random_formulas_are_python_s(text, t):
    try:
        wanted = eval(text, PYTHON, {"t": t})
    except ZeroDivisionError:
        return
    assert value(text, t=t) == pytest.approx(wanted, rel=1e-9, abs=1e-9)


@settings(max_examples=300, deadline=None)
@given(st.text(alphabet="t1.e+-*/() ,sincox[]{}_'\"=<>:~^@!&|%\\\n#λ", max_size=40))
def test_any_text_is_a_formula_or_a_mistake(text):
    try:
        formula = Expression(text)
    except ProblemError as error:
        assert str(error).startswith("expression '")
        return
    allowed = (ast.BinOp, ast.UnaryOp, ast.Call, ast.Name, ast.Constant, ast.operator, ast.unaryop, ast.expr_context)
    assert all(isinstance(node, allowed) for node in ast.walk(ast.parse(text.strip(), mode="eval").body))
    assert formula.used <= {"t"}


@settings(max_examples=300, deadline=None)
@given(
    st.sampled_from(
        [
            "().__class__",
            "t.__init__",
            "exec('1')",
            "eval('1')",
            "__import__('os')",
            "open('x')",
            "globals()",
            "lambda: t",
        ]
        + [
            "[t for t in (1,)]",
            "{t: 1}",
            "{t}",
            "(t, t)",
            "t[0]",
            "t if t else t",
            "t and t",
            "not t",
            "t == 1",
            "t in t",
            "f'{t}'",
        ]
        + [
            "(t := 1)",
            "sin(*[1])",
            "sin(x=1)",
            "sin.real(1)",
            "t @ t",
            "t // 1",
            "t % 2",
            "t << 1",
            "~t",
            "'t'",
            "b't'",
        ]
        + [
            "...",
            "None",
            "yield t",
            "await t",
            "t; t",
            "import os",
            "1j",
            "print",
            "str(t)",
            "abs(t)(1)",
            "getattr(t, 'x')",
        ]
    ),
    st.sampled_from(["{}", "1 + {}", "sin({})", "({})*t", "-{}", "max(1, {})", "t**({})"]),
)
def test_everything_that_is_not_arithmetic_is_refused(attack, around):
    with pytest.raises(ProblemError):
        Expression(around.format(attack))


def test_other_variables():
    assert value("x1*x2 + t", x1=2.0, x2=3.0, t=1.0) == 7
    assert Expression("k + 1", ("k",)).used == {"k"}
    with pytest.raises(ProblemError, match="uses the unknown name 't'\n  hint: known names: k, pi, e"):
        Expression("t", ("k",))


@pytest.mark.parametrize(
    ("text", "pole"),
    [
        ("1/(t-0.3)", 0.3),
        ("5 - 2/(3*t-1)", 1 / 3),
        ("tan(t)", math.pi / 2),
        ("1/(1-cos(t-1))", 1.0),
        ("(t-pi)**-2", math.pi),
        ("1/(-(t-pi)**4)", math.pi),
        ("1/sqrt(abs(t-pi))", math.pi),
        ("log((t-pi)**2)", math.pi),
        ("log10(abs(sin(t/2)))", 2 * math.pi),
        ("1/sin(100*t)", math.pi / 100),
        ("sin(t)/t", None),
        ("sin(t-1/3)/(t-1/3)", None),
        ("(1-cos(t-pi))/(t-pi)**2", None),
        ("1/(2+sin(t))", None),
        ("log(1.0001+cos(t))", None),
        ("tanh(t)/(1+t**2)", None),
        ("t**2 - 4*t", None),
    ],
)
def test_poles_between_samples(text, pole):
    times = np.linspace(0, 10, 801) + 1e-4
    formula = parse_expression(text)
    values = [value(text, t=t) for t in times[::100]]
    assert np.all(np.isfinite(values))
    found = find_pole(formula, "t", times)
    assert found is None if pole is None else found == pytest.approx(pole, abs=1e-7)

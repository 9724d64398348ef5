"""Jumps of formulas: found where arithmetic and an outside root finder put them, and never missed."""

from __future__ import annotations

from fractions import Fraction

import casadi
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from occontrol.core.enclosure import enclose
from occontrol.core.errors import ProblemError
from occontrol.core.expression import CONSTANTS, parse_expression
from occontrol.core.jumps import jump_times, require_still
from occontrol.core.signal import ExpressionSignal

numbers = st.floats(-5, 5).map(lambda x: f"({x!r})")
formulas = st.recursive(
    st.just("t") | numbers,
    lambda inner: (
        st.tuples(inner, st.sampled_from("+-*/"), inner).map(lambda x: f"({x[0]} {x[1]} {x[2]})")
        | st.tuples(st.sampled_from(["sin", "cos", "exp", "tanh", "atan", "abs", "step", "-", "floor"]), inner).map(
            lambda x: f"{x[0]}({x[1]})"
        )
        | st.tuples(st.sampled_from(["sqrt", "log"]), inner).map(lambda x: f"{x[0]}(1.5 + sin({x[1]}))")
        | st.tuples(inner, st.sampled_from(["**2", "**3", "**-1"])).map(lambda x: f"({x[0]}){x[1]}")
        | st.tuples(st.sampled_from(["min", "max"]), inner, inner).map(lambda x: f"{x[0]}({x[1]}, {x[2]})")
        | st.tuples(inner, inner, inner).map(lambda x: f"if_else({x[0]} < {x[1]}, {x[2]}, {x[1]})")
    ),
    max_leaves=6,
)


@settings(max_examples=80, deadline=None)
@given(formulas, st.floats(-4, 4), st.floats(1e-3, 2))
def test_values_and_slopes_lie_in_their_enclosures(text: str, low: float, width: float) -> None:
    expression, t = parse_expression(text), casadi.SX.sym("t")
    formula = expression.casadi({"t": t})
    function = casadi.Function("f", [t], [formula, casadi.jacobian(formula, t)])
    times = np.linspace(low, low + width, 41)
    values, slopes = (np.array(part).ravel() for part in function(times.reshape(1, -1)))
    behind, before = (np.array(function((times + h).reshape(1, -1))[0]).ravel() for h in (1e-7, -1e-7))
    # at a kink there is no slope, whatever the derivative of min(t, 0) at 0 is said to be
    with np.errstate(invalid="ignore"):
        for side in ((behind - values) / 1e-7, (values - before) / 1e-7):
            slopes[~(np.abs(side - slopes) < 1e-3 * (1 + np.abs(slopes)))] = np.nan
    bounds = enclose(expression.tree, times[:1], times[-1:], CONSTANTS)
    for seen, (bottom, top) in ((values, bounds.value), (slopes, bounds.slope)):
        seen = seen[np.isfinite(seen)]
        slack = 1e-12 * (1 + np.abs(seen))
        assert np.all((bottom[0] <= seen + slack) & (seen - slack <= top[0]))


@settings(max_examples=100, deadline=None)
@given(
    st.floats(-1e3, 1e3).filter(lambda a: abs(a) > 1e-3), st.floats(-1e3, 1e3), st.sampled_from(["<", "<=", ">", ">="])
)
def test_a_linear_crossing_is_the_nearest_double(slope: float, level: float, sign: str) -> None:
    wanted = Fraction(level) / Fraction(slope)
    found = jump_times(f"3 + 2*({slope!r}*t {sign} {level!r})", "t", float(wanted) - 1, float(wanted) + 1)
    assert found.tolist() == [float(wanted)]


@pytest.mark.parametrize(
    ("text", "crossing", "levels"),
    [
        ("step(sin(t))", np.sin, [0]),
        ("2*(cos(3*t) < exp(-t))", lambda t: np.cos(3 * t) - np.exp(-t), [0]),
        ("step(t**3 - 8)*t", lambda t: t**3 - 8, [0]),
        ("if_else(tanh(t - 2) >= 0.25, t, 1/t)", lambda t: np.tanh(t - 2) - 0.25, [0]),
        ("floor(t*t/7)", lambda t: t * t / 7, range(1, 15)),
        ("sign(max(t - 3, 5 - t) - 1.5)", lambda t: np.maximum(t - 3, 5 - t) - 1.5, [0]),
        ("step(log(1 + t) - 1) + ceil(0.7*t)", None, []),
    ],
)
def test_other_crossings_are_those_of_a_root_finder(text: str, crossing, levels) -> None:
    start, end = 0.05, 9.9
    if crossing is None:
        wanted = sorted([float(np.e - 1), *(n / 0.7 for n in range(1, 7) if n / 0.7 < end)])
    else:
        grid, wanted = np.linspace(start, end, 20001), []
        for level in levels:
            side = np.sign(crossing(grid) - level)
            at = np.flatnonzero(side[1:] * side[:-1] < 0)
            wanted += [brentq(lambda t, n=level: crossing(t) - n, grid[i], grid[i + 1], xtol=1e-15) for i in at]
    found = jump_times(text, "t", start, end)
    assert len(found) == len(wanted) > 0
    assert found == pytest.approx(sorted(wanted), rel=3e-15)


def test_what_repeats_is_found_by_its_whole_numbers() -> None:
    daytime = "6 <= t - 24*floor(t/24) < 18"
    assert jump_times(daytime, "t", 0.0, 60.0).tolist() == [6.0, 18.0, 24.0, 30.0, 42.0, 48.0, 54.0]


@pytest.mark.parametrize("text", ["1 + 2*(0.3*t >= 0.9)", "step(sin(t))", "t < 5", "5 >= t", "step(0.7 - 0.1*t)"])
def test_at_a_jump_stands_what_comes_behind_it(text: str) -> None:
    signal = ExpressionSignal(((text,),))
    for t in signal.breaks(0.0, 9.0):
        before, at, behind = signal.sample(np.array([t - 1e-9, t, t + 1e-9])).ravel()
        assert at == behind != before


def test_a_touch_is_no_crossing_or_refused() -> None:
    assert len(jump_times("step((t - 3)**2)", "t", 0.0, 10.0)) <= 1
    with pytest.raises(ProblemError, match="jumps twice within"):
        jump_times("step(sin(t) - 1)", "t", 0.0, 10.0)
    # an old function may jump where nobody can tell, as it always could
    assert len(jump_times("sign(erf(t - 1))", "t", 0.0, 10.0)) == 0


def test_comparisons_of_steps_need_no_edges_and_states_may_not_decide() -> None:
    signal = ExpressionSignal((("if_else(k < 3, 1, 2)",),), "k")
    assert signal.sample(np.arange(5.0)).ravel().tolist() == [1, 1, 1, 2, 2] and not len(signal.breaks(0, 5))
    require_still(parse_expression("x*(k < 3)", ("x", "k")))
    with pytest.raises(ProblemError, match="jumps as 'x' changes"):
        require_still(parse_expression("if_else(x < 1, x, 1)", ("x", "k")))

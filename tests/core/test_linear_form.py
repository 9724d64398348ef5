"""Rows by the names of the states, and what the states are called in files and pictures."""

from __future__ import annotations

import numpy as np
import pytest

import occontrol as oc
from occontrol.core.errors import ProblemError
from occontrol.core.linear_form import linear_form
from occontrol.core.state_labels import state_labels, state_names, state_units

NAMES = ("x", "y", "vx", "vy")


@pytest.mark.parametrize(
    ("text", "row"),
    [
        ("x", [1, 0, 0, 0]),
        ("vx - vy", [0, 0, 1, -1]),
        ("-(x - 2*y)/4 + x", [0.75, 0.5, 0, 0]),
        ("3*(vx + vy)*2 - -x", [1, 0, 6, 6]),
        ("x*sqrt(4) - (y - (x - y))", [3, -2, 0, 0]),
        ("x - x", [0, 0, 0, 0]),
    ],
)
def test_a_row_by_names_has_the_coefficients_of_the_formula(text: str, row: list[float]) -> None:
    assert linear_form(text, NAMES, ("t",)) == row
    point = np.array([0.3, -1.7, 2.9, 0.41])  # Python's own reading of the same text
    assert row @ point == pytest.approx(eval(text, {"sqrt": np.sqrt, **dict(zip(NAMES, point, strict=True))}))


def test_factors_may_depend_on_time() -> None:
    row = linear_form("sin(t)*x - y/(1+t) + 2*vx", NAMES, ("t",))
    assert row[2:] == [2.0, 0.0]
    at = [oc_value(row[i], 0.7) for i in range(2)]
    assert at == pytest.approx([np.sin(0.7), -1 / 1.7], rel=1e-15)


def oc_value(text: object, t: float) -> float:
    return float(oc.Sensor("s", [[text]], [[1.0]]).C.at(t)[0, 0])


@pytest.mark.parametrize("text", ["x*y", "x**2", "sin(x)", "1/x", "x + 1", "3", "min(x, y)", "x/(y)"])
def test_what_is_not_linear_is_refused(text: str) -> None:
    with pytest.raises(ProblemError, match=r"is not linear in the states|has a part without a state"):
        linear_form(text, NAMES, ("t",))


def test_the_names_of_a_plant_are_the_users_or_numbered() -> None:
    plant = oc.LinearPlant([[0, 1], [0, 0]], [[0, 0], [0, 1]], [[1, 0], [0, 1]], names=("x", "v"), units=("m", ""))
    assert (state_names(plant), state_units(plant), state_labels(plant)) == (["x", "v"], ["m", ""], ["x [m]", "v"])
    plain = oc.LinearPlant([[0]], [[1]], [[1]])
    assert (state_names(plain), state_units(plain), state_names(3)) == (["x1"], [""], ["x1", "x2", "x3"])


@pytest.mark.parametrize(
    ("names", "what"),
    [
        (("x",), "states has 1 entry, the plant has 2 states"),
        (("x", "x"), "the state name 'x' stands twice"),
        (("x", "t"), "the state name 't' is time in formulas"),
        (("sin", "v"), "the state name 'sin' is a function of formulas"),
        (("x", "if"), "the state name 'if' is a word of formulas"),
        (("sd_x", "v"), "the state name 'sd_x' is kept for a column of result files"),
        (("x2", "x1"), "the state name 'x2' is kept for a column"),
        (("a b", "v"), "the name of state 1 is 'a b'"),
    ],
)
def test_names_that_cannot_stand_are_refused(names: tuple[str, ...], what: str) -> None:
    with pytest.raises(ProblemError, match=what):
        oc.LinearPlant([[0, 1], [0, 0]], [[0, 0], [0, 1]], [[1, 0], [0, 1]], names=names)

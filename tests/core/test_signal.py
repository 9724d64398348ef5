"""Signals and the checks on them."""

import pickle

import numpy as np
import pytest

from occontrol.core.checks import check_covariance, check_covariance_signal, check_finite
from occontrol.core.errors import ProblemError
from occontrol.core.signal import ConstantSignal, ExpressionSignal, TableSignal, as_signal

TIMES = np.linspace(0, 10, 41)


@pytest.mark.parametrize(
    ("given", "shape"),
    [
        (2, (1, 1)),
        ("t", (1, 1)),
        ([[1, 2]], (1, 2)),
        ([[1], ["t"]], (2, 1)),
        (np.eye(3), (3, 3)),
        (np.float64(2), (1, 1)),
    ],
)
def test_what_becomes_a_signal(given, shape):
    signal = as_signal(given)
    assert signal.shape == shape and signal.at(1.5).shape == shape and signal.sample(TIMES).shape == (41, *shape)
    assert np.array_equal(as_signal(signal.document()).sample(TIMES), signal.sample(TIMES))
    assert np.array_equal(pickle.loads(pickle.dumps(signal)).sample(TIMES), signal.sample(TIMES))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ([1, 2], "expected a list of rows"),
        ([[1, 2], [3]], r"rows have different lengths: \[2, 1\]"),
        ([[1, None]], r"entry \[1,2\] is not a number or a formula"),
        ([[True]], r"entry \[1,1\] is not a number or a formula"),
        (True, r"entry \[1,1\] is not a number or a formula"),
        ([[float("nan")]], "not finite"),
        (np.array([["a"]]), "does not hold real numbers"),
        (np.array([[1j]]), "does not hold real numbers"),
        (np.zeros((2, 2, 2)), "expected a matrix"),
        ({"diag": [1]}, "expected a matrix"),
        (None, "expected a matrix"),
        ([["t", "sine(t)"]], "unknown function 'sine'"),
    ],
)
def test_what_does_not(given, words):
    with pytest.raises(ProblemError, match=words):
        as_signal(given)


def test_constants_are_the_user_s_no_more():
    mine = np.eye(2)
    signal = as_signal(mine)
    mine[0, 0] = 7
    assert signal.at(0)[0, 0] == 1
    with pytest.raises(ValueError):
        signal.at(0)[0, 0] = 7


def test_tables():
    linear = TableSignal([0, 1, 3], np.array([0, 2, 6.0]).reshape(3, 1, 1))
    held = TableSignal([0, 1, 3], np.array([0, 2, 6.0]).reshape(3, 1, 1), "previous")
    assert linear.sample([0, 0.25, 1, 2, 3])[:, 0, 0].tolist() == [0, 0.5, 2, 4, 6]
    assert held.sample([0, 0.25, 1, 2, 3, 4])[:, 0, 0].tolist() == [0, 0, 2, 2, 6, 6]
    assert linear.covers(0, 3) and not linear.covers(0, 3.1) and held.covers(0, 9) and not held.covers(-1, 2)


def test_one_formula_object_and_the_table_of_its_values_agree():
    formula = ExpressionSignal((("sin(t)", 1.0), ("t**2", "exp(-t)")))
    table = TableSignal(TIMES, formula.sample(TIMES))
    assert np.array_equal(table.sample(TIMES), formula.sample(TIMES))
    assert np.allclose(formula.at(2.0), [[np.sin(2), 1], [4, np.exp(-2)]], rtol=1e-15)


def test_finite_means_between_the_samples_too():
    assert check_finite("A", as_signal("1/(2+sin(t))"), TIMES, ("A",)) == []
    (mistake,) = check_finite("A", as_signal([[0, "1/(t-1/3)"]]), TIMES, ("A",))
    assert mistake.what == "A is not finite at t = 0.333333: entry [1,2] is infinite" and mistake.path == ("A",)
    (mistake,) = check_finite("A", as_signal("sqrt(t-3)"), TIMES, ("A",))
    assert mistake.what == "A is not finite at t = 0: entry [1,1] is nan"
    narrow = as_signal("sqrt((t-5.11)**2 - 0.01)")  # no number only on (5.01, 5.21), between coarse samples
    assert check_finite("A", narrow, np.array([0, 5, 10.0]), ("A",))[0].what.startswith("A is not finite at t = 5.0")


def test_definite_everywhere():
    good = as_signal([["2+sin(t)", 0.5], [0.5, 1]])
    assert check_covariance_signal("noise", good, TIMES, ()) == []
    (m,) = check_covariance_signal("noise", as_signal([["t-2", 0], [0, 1]]), TIMES, ())
    assert m.what == "noise is not positive semidefinite at t = 0: its smallest eigenvalue is -2"
    (m,) = check_covariance_signal("noise", as_signal([["t", 0], [0, 1]]), TIMES, (), definite=True)
    assert m.what == "noise is not positive definite at t = 0: its smallest eigenvalue is 0"
    (m,) = check_covariance_signal("noise", as_signal([[1, "t"], [0, 200]]), TIMES, ())
    assert m.what.startswith("noise is not symmetric at t = 0.0195312: entry [1,2] is")
    spike = TableSignal([0, 5.05, 5.1, 5.15, 10], np.array([1, 1, -1, 1, 1.0]).reshape(5, 1, 1))
    (m,) = check_covariance_signal("noise", spike, TIMES, ())
    assert m.what == "noise is not positive semidefinite at t = 5.1: its smallest eigenvalue is -1"


@pytest.mark.parametrize(
    ("matrix", "words"),
    [
        ([[1, 2], [2, 1]], "not positive semidefinite: its smallest eigenvalue is -1"),
        ([[-1e-30]], "not positive semidefinite: its smallest eigenvalue is -1e-30"),
        ([[1, 1e-8], [0, 1]], "not symmetric"),
        ([[1, 0]], "is 1x2, it must be square"),
        ([[np.inf]], "is not finite"),
    ],
)
def test_covariances_that_are_none(matrix, words):
    (mistake,) = check_covariance("X", np.array(matrix, dtype=float), ())
    assert words in mistake.what


@pytest.mark.parametrize("matrix", [[[0]], [[1, 1], [1, 1]], [[1, 1e-10], [0, 1]], [[1e12, 0], [0, 1e-12]]])
def test_covariances_that_are_close_to_the_edge(matrix):
    assert check_covariance("X", np.array(matrix, dtype=float), ()) == []


def test_constant_signal_needs_no_times():
    assert check_finite("A", ConstantSignal(np.eye(2)), np.empty(0), ()) == []

"""The measure of docstrings says no to small bad examples."""

from __future__ import annotations

import ast

import pytest

from tests.docstring_measure import public_functions, says_shape, without_unit

SPOILT = '''
def move(state: np.ndarray, P: np.ndarray, edges: np.ndarray) -> None:
    """Move `state` (n,) by P.

    Parameters
    ----------
    edges : (N+1,) increasing
    """
    if P is None:
        raise ValueError("no P")
    else:
        raise trouble("edges")


class Plant:
    """A plant.

    noise : (n, n) intensity
    """

    def __init__(self, noise: np.ndarray, mean: np.ndarray):
        self.noise = noise

    def sample(self, times: np.ndarray) -> np.ndarray:
        """The matrices at `times` (K,)."""
        raise NotImplementedError

    def _hidden(self, x: np.ndarray) -> None:
        raise ValueError


class Fast(Plant):
    """A fast plant."""

    def sample(self, times: np.ndarray) -> np.ndarray:
        return times


class Mute(Plant):
    """A mute plant."""

    def sample(self, times: np.ndarray) -> np.ndarray:
        """Nothing but the matrices (or definite ones)."""
        return times
'''


def test_the_measure_says_no_to_small_bad_examples() -> None:
    tree = ast.parse(SPOILT)
    classes = {node.name: node for node in tree.body if isinstance(node, ast.ClassDef)}
    move, plant, sample, fast, mute = public_functions(tree, classes)
    assert move.without_shape() == ["P"]
    assert sorted(move.unnamed_raises()) == ["ValueError", "trouble"]
    assert plant.without_shape() == ["mean"]
    assert (sample.without_shape(), sample.unnamed_raises()) == ([], [])
    assert fast.without_shape() == []  # it overrides what says it
    assert mute.without_shape() == ["times"]
    assert [line.split()[-1] for line in without_unit(tree)] == ["edges", "noise", "mean", "times", "times", "times"]
    better = ast.parse(SPOILT.replace("(N+1,) increasing", "(N+1,) increasing times").replace("intensity", "1/time"))
    assert [line.split()[-1] for line in without_unit(better)] == ["mean", "times", "times", "times"]


@pytest.mark.parametrize(
    "shape", ["(N,)", "(N, M)", "(N+1, n, n)", "(..., n)", "(E, s)", "(n(n+1)/2,)", "(..., r(r+1)/2)", "(q*m,)"]
)
def test_these_are_shapes(shape: str) -> None:
    assert says_shape("x", f"x : {shape} numbers")
    assert says_shape("x", f"The sum of `x` {shape}.")


@pytest.mark.parametrize(
    "text", ["x : (or definite) matrix", "x : numbers", "The sum of y (N, M)", "max (N,)", "x : (N)"]
)
def test_these_are_none(text: str) -> None:
    assert not says_shape("x", text)

"""What a jumping-mode plant refuses, with the words that the user reads."""

from __future__ import annotations

import numpy as np
import pytest

from occontrol.core.errors import ProblemError
from occontrol.families.hybrid.guard import Guard, Threshold
from occontrol.families.hybrid.plant import JumpPlant, Mode
from occontrol.families.hybrid.sensor import JumpSensor

TWO = [Mode("a", np.eye(2), np.eye(2)), Mode("b", 0.9 * np.eye(2), np.eye(2))]
HALF = [[0.5, 0.5], [0.5, 0.5]]


def refused(build, *parts: str, path=None) -> ProblemError:
    with pytest.raises(ProblemError) as caught:
        build()
    text = str(caught.value)
    for part in parts:
        assert part in text
    if path is not None:
        assert path in [m.path for m in caught.value.mistakes]
    return caught.value


def plant(**changes):
    return JumpPlant(**{"modes": TWO, "covariance": np.eye(2), "transition_matrix": HALF, **changes})


def test_what_is_left_out():
    made = plant()
    assert np.array_equal(made.probabilities, [0.5, 0.5])
    assert np.array_equal(made.mean, [0, 0])
    assert made.names == ["a", "b"]
    assert np.array_equal(TWO[0].F.at(0), np.eye(2))


@pytest.mark.parametrize(
    ("changes", "words", "path"),
    [
        (
            {"transition_matrix": [[1.5, -0.5], [0.5, 0.5]]},
            "row 1 of the transition matrix (from 'a') has the negative entry -0.5 for 'b'",
            ("transition", "matrix", 0, 1),
        ),
        (
            {"transition_matrix": [[0.5, 0.5], [0.5, 0.4]]},
            "row 2 of the transition matrix (from 'b') sums to 0.9, not to 1",
            ("transition", "matrix", 1),
        ),
        ({"transition_matrix": [[1.0]]}, "the transition matrix is 1x1, it must be 2x2", ("transition", "matrix")),
        ({"transition_matrix": None}, "transition has no matrix and no guards", ("transition",)),
        ({"guards": []}, "transition has both a matrix and guards", ("transition",)),
        ({"threshold": Threshold([1], [[1]])}, "a threshold belongs to guards", ("transition", "threshold")),
        ({"probabilities": [0.7, 0.7]}, "probabilities sums to 1.4, not to 1", ("initial", "probabilities")),
        ({"probabilities": [1.2, -0.2]}, "negative entry -0.2 for 'b'", ("initial", "probabilities", 1)),
        ({"probabilities": [1.0]}, "probabilities has 1 entry, it must have 2", ("initial", "probabilities")),
        ({"mean": [1, 2, 3]}, "mean has 3 entries, it must have 2", ("initial", "mean")),
        ({"covariance": [[1, 2], [2, 1]]}, "covariance is not positive semidefinite", ("initial", "covariance")),
        ({"covariance": [[1, 0.5], [0, 1]]}, "covariance is not symmetric", ("initial", "covariance")),
        ({"modes": [TWO[0], TWO[0]]}, "the name 'a' is used twice", ("modes", 1, "name")),
        (
            {"modes": [TWO[0], Mode("c", [[1]], [[1]])]},
            "A of mode 'c' is 1x1, mode 'a' has 2 states",
            ("modes", 1, "A"),
        ),
        ({"modes": []}, "there is no mode", ("modes",)),
    ],
)
def test_refusals(changes, words, path):
    refused(lambda: plant(**changes), words, path=path)


def test_rows_may_be_off_by_rounding_and_are_made_exact():
    made = plant(transition_matrix=[[1 / 3 + 1e-10, 2 / 3], [0.1 + 0.2, 0.7]])
    assert np.asarray(made.transition_matrix).sum(axis=1) == pytest.approx([1, 1], abs=1e-15)


def test_unreachable_modes_are_named():
    words = "mode 'b' can never be reached: it has no probability at k = 0 and no way leads to it"
    refused(lambda: plant(transition_matrix=np.eye(2), probabilities=[1, 0]), words, path=("modes", 1))
    three = [*TWO, Mode("c", np.eye(2), np.eye(2))]
    chain = [[0.5, 0.5, 0], [0, 0.5, 0.5], [0, 0, 1]]
    assert plant(modes=three, transition_matrix=chain, probabilities=[1, 0, 0]).names == ["a", "b", "c"]
    refused(
        lambda: plant(modes=three, transition_matrix=chain, probabilities=[0, 1, 0]), "mode 'a' can never be reached"
    )


def test_unreachable_by_guards():
    guards = [Guard("b", "a", [[1, 0]], [0])]
    refused(lambda: plant(transition_matrix=None, guards=guards, probabilities=[1, 0]), "mode 'b' can never be reached")
    assert plant(transition_matrix=None, guards=guards).guards == tuple(guards)


def test_guard_dimensions():
    def guarded(guard, threshold=None):
        return plant(transition_matrix=None, guards=[guard], threshold=threshold)

    path = ("transition", "guards", 0)
    hint = "one per state (2), then one per entry of the threshold's mean (1)"
    wide = Guard("a", "b", [[1, 0]], [0])
    refused(lambda: guarded(wide, Threshold([0.0], [[1]])), "has 2 columns, it must have 3", hint, path=(*path, "L"))
    refused(lambda: guarded(Guard("a", "c", [[1, 0]], [0])), "names the unknown mode 'c'", path=(*path, "to"))
    refused(lambda: guarded(Guard("A", "b", [[1, 0]], [0])), "names the unknown mode 'A'", path=(*path, "from"))
    refused(lambda: Guard("a", "b", [[1, 0], [0, 1]], [0]), "b of the guard from 'a' to 'b' has length 1, L has 2 rows")
    refused(lambda: Guard("a", "b", [[1, 0]], [np.nan]), "is not finite")
    refused(lambda: Guard("a", "b", [["k", 0]], [0]), "depends on k", "guards are constant")
    refused(lambda: Guard("a", "b", np.ones((27, 2)), np.ones(27)), "27 rows, at most 26")
    refused(lambda: Threshold([0, 1], [[1]]), "covariance of the threshold is 1x1, its mean has length 2")
    refused(lambda: Threshold([0], [[-1]]), "not positive semidefinite")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"A": [[1, 0]], "W": [[1]]}, "A of mode 'm' is 1x2, it must be 1x1"),
        ({"A": [[1]], "W": np.eye(2)}, "W of mode 'm' is 2x2, it must be 1x1"),
        ({"A": [[1]], "F": [[1, 1]], "W": [[1]]}, "W of mode 'm' is 1x1, it must be 2x2"),
        ({"A": [[1]], "F": [[1], [1]], "W": [[1]]}, "F of mode 'm' is 2x1, it must have 1 row"),
        ({"A": [[1]], "W": [[1]], "B": [[1]]}, "B of mode 'm' is given without input"),
        ({"A": [[1]], "W": [[1]], "input": [1]}, "input of mode 'm' is given without B"),
        ({"A": [[1]], "W": [[1]], "B": [[1]], "input": [1, 2]}, "input of mode 'm' is 2x1, it must be 1x1"),
    ],
)
def test_shapes_of_a_mode(arguments, words):
    refused(lambda: Mode("m", **arguments), words)


def test_shapes_of_a_sensor():
    refused(lambda: JumpSensor("s", [[1, 0]], np.eye(2)), "R of sensor 's' is 2x2, its C has 1 row")
    refused(lambda: JumpSensor("s", np.zeros((0, 2)), np.zeros((0, 0))), "C of sensor 's' has no entries")


@pytest.mark.parametrize("digits", [16, 9])
def test_probabilities_are_divided_by_their_sum_once(digits):
    """What a run folder holds is read again: a second division must not change the last bits."""
    generator = np.random.default_rng(5)
    for count in (2, 7, 20):
        modes = [Mode(str(i), np.eye(2), np.eye(2)) for i in range(count)]
        rows = np.round(generator.dirichlet(np.ones(count), count), digits)
        rows[:, 0] = 1.0 - rows[:, 1:].sum(axis=1) + 3e-10 * (digits == 9)
        once = JumpPlant(modes, np.eye(2), probabilities=rows[0], transition_matrix=rows)
        twice = JumpPlant(modes, np.eye(2), probabilities=once.probabilities, transition_matrix=once.transition_matrix)
        assert np.array_equal(once.transition_matrix, twice.transition_matrix)
        assert np.array_equal(once.probabilities, twice.probabilities)
        assert np.max(np.abs(once.transition_matrix.sum(axis=1) - 1)) < 1e-14

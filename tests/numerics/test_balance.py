"""One diagonal of powers of two for all time: the balance, its uniqueness, and what scaling keeps."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from occontrol.core.scaled_signal import scaled
from occontrol.core.signal import ExpressionSignal, TableSignal, as_signal
from occontrol.numerics.balance import StateUnits, balancing


def random_pencil(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    def semidefinite() -> np.ndarray:
        G = rng.normal(size=(n, rng.integers(1, n + 1))) * (rng.random((n, 1)) < 0.6)
        return np.abs(G @ G.T) * 10.0 ** rng.integers(-6, 6)

    rate = np.abs(rng.normal(size=(n, n))) * 10.0 ** rng.integers(-5, 5, size=(n, n)) * (rng.random((n, n)) < 0.5)
    return rate, semidefinite(), semidefinite()


def counted(rate: np.ndarray, driven: np.ndarray, observed: np.ndarray) -> np.ndarray:
    """States that noise reaches or that are seen: the others have no size."""
    reached, seen = np.diag(driven) > 0, np.diag(observed) > 0
    for _ in range(len(rate)):
        reached, seen = reached | np.any((rate > 0) & reached, axis=1), seen | np.any((rate.T > 0) & seen, axis=1)
    return reached | seen


@pytest.mark.parametrize("power", [1, 2])
def test_the_result_does_not_depend_on_the_units_one_starts_from(power):
    rng = np.random.default_rng(5)
    for _ in range(30):
        n = int(rng.integers(1, 8))
        parts = random_pencil(rng, n)
        e = 2.0 ** rng.integers(-60, 61, size=n)
        rate, driven, observed = parts
        other = balancing(rate * e[:, None] / e, driven * np.outer(e, e), observed / np.outer(e, e), power)
        here = counted(*parts)
        np.testing.assert_array_equal(other[here], (balancing(*parts, power) * e)[here])


def test_what_drives_a_state_and_what_it_drives_are_alike():
    rng = np.random.default_rng(6)
    n = 5
    rate, scale = np.abs(rng.normal(size=(n, n))), 10.0 ** rng.uniform(-6, 6, size=n)
    G, C = rng.normal(size=(n, n)), rng.normal(size=(n, n))
    X, Y = np.abs(G @ G.T) * np.outer(scale, scale), np.abs(C.T @ C) / np.outer(scale, scale)
    rate = rate * scale[:, None] / scale
    d = balancing(rate, X, Y)
    assert set(np.frexp(d)[0].tolist()) == {0.5}  # powers of two
    a, x, y = rate * d / d[:, None], X / np.outer(d, d), Y * np.outer(d, d)
    np.fill_diagonal(a, 0.0)
    ratio = (a.sum(axis=0) + y.sum(axis=1)) / (a.sum(axis=1) + x.sum(axis=1))
    # rounding each log2 d by up to a half changes the ratio by up to 2^4 where all neighbours move the other way
    assert np.all((ratio > 1 / 6) & (ratio < 6))


@pytest.mark.parametrize(("driven", "seen", "expected"), [(2.0**20, 2.0**-40, 2.0**15), (2.0**-60, 0.0, 2.0**-30)])
def test_one_state_by_hand(driven, seen, expected):
    # X/d^2 = Y d^2; driven only: X/d^2 = 1
    assert balancing(np.zeros((1, 1)), np.array([[driven]]), np.array([[seen]]))[0] == expected


def test_squares_give_the_least_frobenius_norm():
    rng = np.random.default_rng(8)
    rate, X, Y = np.abs(rng.normal(size=(3, 3))), np.diag([1e4, 1.0, 1e-3]), np.diag([1.0, 10.0, 1e3])

    def norm(d):
        parts = rate * d / d[:, None], X / np.outer(d, d), Y * np.outer(d, d)
        return 2 * np.sum(parts[0] ** 2) + np.sum(parts[1] ** 2) + np.sum(parts[2] ** 2)

    d = balancing(rate, X, Y, power=2)
    for i in range(3):
        for factor in (0.25, 4.0):  # d is rounded to powers of two
            assert norm(d) < norm(d * np.where(np.arange(3) == i, factor, 1.0))


def test_a_chain_that_is_not_seen_gets_the_size_of_what_drives_it():
    rate = np.array([[0.0, 2.0**10], [0.0, 0.0]])  # x1' = 2^10 x2, x2 driven by noise 2^8
    d = balancing(rate, np.diag([0.0, 2.0**8]), np.zeros((2, 2)))
    np.testing.assert_array_equal(d, [2.0**14, 2.0**4])
    up = balancing(rate.T, np.zeros((2, 2)), np.diag([0.0, 2.0**8]))  # seen only: the mirror image
    np.testing.assert_array_equal(up, [2.0**-14, 2.0**-4])


def test_entries_that_are_not_finite_leave_the_units_alone():
    np.testing.assert_array_equal(balancing(np.full((2, 2), np.inf), np.eye(2), np.eye(2)), [1.0, 1.0])


def test_units_keep_what_does_not_depend_on_them_and_are_undone_to_the_last_bit():
    rng = np.random.default_rng(7)
    units = StateUnits(2.0 ** rng.integers(-40, 40, size=3))
    A, S, R, C, B, x = (rng.normal(size=s) for s in [(3, 3), (3, 3), (3, 3), (2, 3), (3, 2), (3,)])
    back = units.inverse
    for value, there, undo in (
        (A, units.map, back.map), (S, units.covariance, back.covariance), (R, units.weight, back.weight),
        (C, units.out_of, back.out_of), (B, units.into, back.into), (x, units.vector, back.vector),
    ):  # fmt: skip
        np.testing.assert_array_equal(undo(there(value)), value)
    assert np.trace(units.weight(R) @ units.covariance(S)) == pytest.approx(np.trace(R @ S), rel=1e-13)
    np.testing.assert_allclose(units.out_of(C) @ units.map(A) @ units.into(B), C @ A @ B, rtol=1e-12)
    np.testing.assert_allclose(units.out_of(C) @ units.covariance(S) @ units.out_of(C).T, C @ S @ C.T, rtol=1e-12)
    np.testing.assert_allclose(units.out_of(C) @ units.vector(x), C @ x, rtol=1e-12)


@pytest.mark.parametrize(
    "signal",
    [
        as_signal([[1.5, 2.0], [0.3, -1.0]]),
        as_signal([["sin(t)", 2.0], ["0.3*t", -1.0]]),
        TableSignal(np.array([0.0, 1.0]), np.arange(8.0).reshape(2, 2, 2)),
    ],
    ids=["constant", "formulas", "table"],
)
def test_a_scaled_signal_is_of_its_kind_and_exact(signal):
    left, right, times = np.array([4.0, 0.5]), np.array([2.0**-20, 8.0]), np.array([0.0, 0.3, 1.0])
    found = scaled(scaled(signal, left, np.ones(2)), np.ones(2), right)
    np.testing.assert_array_equal(found.sample(times), signal.sample(times) * np.outer(left, right))
    np.testing.assert_array_equal(found.at(0.3), signal.at(0.3) * np.outer(left, right))
    assert isinstance(found, type(signal)) and found.constant == signal.constant
    np.testing.assert_array_equal(found.breaks(0.0, 1.0), signal.breaks(0.0, 1.0))
    if isinstance(found, ExpressionSignal):
        again = pickle.loads(pickle.dumps(found))
        np.testing.assert_array_equal(again.sample(times), found.sample(times))

"""Words and their values: gradients, convexity, tangents, cycles for ever, all against code of another kind."""

from __future__ import annotations

from decimal import Decimal, localcontext

import numpy as np
import pytest

from occontrol.core.errors import InfeasibleError
from occontrol.scheduling.periodic.kernels import below, evaluate, minimise
from occontrol.scheduling.periodic.letters import Letters, smallest_covariance
from occontrol.scheduling.periodic.matrices import eigen, solve
from occontrol.scheduling.periodic.potential import costates, cycle_of, potentials
from tests.decimal_recursion import DIGITS, exact, inverse
from tests.plain_cycles import discrete, mean_cost, on_off, random_plant, unstable, vehicle


def in_units(letters: Letters) -> tuple[Letters, np.ndarray]:
    """The letters in units in which the smallest covariance is the identity, and that covariance."""
    S = smallest_covariance(letters.F[0], letters.Q[0], np.sum(letters.L, axis=0))
    return letters.in_units(np.linalg.cholesky(S)), S


def information(seed: int, n: int) -> np.ndarray:
    """A random matrix between 0 and the identity."""
    g = np.random.default_rng(seed)
    Q, _ = np.linalg.qr(g.standard_normal((n, n)))
    return (Q * g.uniform(0.05, 1.0, n)) @ Q.T


@pytest.mark.parametrize("make", [vehicle, unstable, lambda: random_plant(4, 3, 3)])
def test_the_gradient_of_a_word_is_the_quotient_of_differences(make) -> None:
    letters, _ = in_units(make())
    n, g = letters.states, np.random.default_rng(0)
    word = np.array([0, 1, letters.count - 1, 0])
    Z, after, U = information(1, n), 2 * information(2, n), 0.9 * information(3, n)
    G, H = np.empty((n, n)), np.empty((n, n))
    evaluate(*letters.arrays, word, Z, after, U, G)
    D = g.standard_normal((n, n))
    D = (D + D.T) / 2
    up, down = (evaluate(*letters.arrays, word, Z, after, U + s * 1e-6 * D, H)[0] for s in (1, -1))
    assert (up - down) / 2e-6 == pytest.approx(np.vdot(G, D), rel=1e-6)


@pytest.mark.parametrize("make", [vehicle, on_off, unstable, lambda: random_plant(5), lambda: random_plant(6)])
def test_a_tangent_bounds_a_word_everywhere_from_below(make) -> None:
    letters, _ = in_units(make())
    n, word = letters.states, np.array([0, 1, 1, 0, 1])
    Z, G = information(1, n), np.empty((n, n))
    for seed in range(6):
        U = information(seed, n)
        value = evaluate(*letters.arrays, word, Z, Z, U, G)[0]
        least = below(value, U, G.copy())
        tangent = G.copy()
        for other in range(20, 50):
            V = information(other, n)
            there = evaluate(*letters.arrays, word, Z, Z, V, np.empty((n, n)))[0]
            assert there >= value + np.vdot(tangent, V - U) - 1e-10 * abs(value)
            assert there >= least - 1e-10 * abs(value)


def test_the_minimum_of_a_word_lies_between_its_bound_and_its_value() -> None:
    letters, _ = in_units(unstable())
    word, Z = np.array([2, 3, 0]), 20 * information(7, 3)
    bound, value, allowance, _ = minimise(*letters.arrays, word, Z, Z, 0.5 * np.eye(3), np.inf, 200, 1e-9)
    from scipy.optimize import minimize

    def objective(x: np.ndarray) -> float:
        W = x.reshape(3, 3)
        values, vectors = np.linalg.eigh(W @ W.T)
        U = (vectors * (values / (1 + values))) @ vectors.T + 1e-12 * np.eye(3)  # between 0 and 1
        return evaluate(*letters.arrays, word, Z, Z, (U + U.T) / 2, np.empty((3, 3)))[0]

    other = min(minimize(objective, np.random.default_rng(s).standard_normal(9)).fun for s in range(3))
    assert bound <= value and bound - allowance <= other + 1e-9
    assert other == pytest.approx(bound, rel=1e-5)


def exact_tangent(letters: Letters, word: list[int], Z: np.ndarray, U: np.ndarray) -> float:
    """The bound of a word by its tangent at U in 60 digits, the gradient by differences in all directions."""
    n, Zx, e = letters.states, exact(Z), Decimal(10) ** -15

    def value(Y: np.ndarray) -> Decimal:
        total = np.sum(Zx * Y)
        for a in word:
            for seen, weight in zip(letters.seen[a], letters.weight[a], strict=True):
                total += np.sum(exact(weight) * inverse(Y + exact(seen)))
            total += Decimal(float(letters.constant[a]))
            F = exact(letters.F[a])
            Y = inverse(F @ inverse(Y + exact(letters.L[a])) @ F.T + exact(letters.Q[a]))
        return total - np.sum(Zx * Y)

    with localcontext() as context:
        context.prec = DIGITS
        Y, G = exact(U), np.zeros((n, n), dtype=object)
        for i in range(n):
            for j in range(i + 1):
                D = exact(np.zeros((n, n)))
                D[i, j] = D[j, i] = e
                G[i, j] = G[j, i] = (value(Y + D) - value(Y - D)) / (2 * e) / (1 if i == j else 2)
        tangent = value(Y) - np.sum(G * Y)
        negative = np.sum(np.minimum(np.linalg.eigvalsh(G.astype(float)), 0.0))
        return float(tangent + Decimal(float(negative)))


@pytest.mark.parametrize("make", [vehicle, unstable, lambda: random_plant(7), lambda: random_plant(20, 3, 2)])
def test_the_allowance_covers_what_rounding_does_to_a_bound(make) -> None:
    letters, _ = in_units(make())
    n = letters.states
    for word in ([1], [0, 1, 0, 1, 1], [0, 0, 1, 1, 0, 0, 1, 1]):
        Z = 3 * information(2, n)
        array = np.array(word)
        bound, _, allowance, where = minimise(*letters.arrays, array, Z, Z, 0.5 * np.eye(n), np.inf, 30, 0.0)
        assert bound - allowance <= exact_tangent(letters, word, Z, where)
        assert allowance <= 1e-6 * abs(bound)


def test_accurate_sensors_do_not_put_a_bound_above_what_is_exact() -> None:
    """Of random plants the one on which rounding weighs most."""
    letters, _ = in_units(random_plant(14, 3, 2))
    cycle = cycle_of(letters, np.array([0]))
    assert cycle is not None
    Z = potentials(letters, cycle)["harmonic mean of the cycle"][0]
    for word in ([1, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0], [1, 0, 0, 0, 1, 0, 0, 0, 0]):
        bound, _, allowance, where = minimise(*letters.arrays, np.array(word), Z, Z, 0.5 * np.eye(3), np.inf, 60, 0.0)
        assert bound - allowance <= exact_tangent(letters, word, Z, where)


@pytest.mark.parametrize("seed", range(6))
def test_a_cycle_costs_what_a_filter_that_is_iterated_says(seed: int) -> None:
    letters = random_plant(seed, 2 + seed % 2, 2 + seed % 2)
    scaled, _ = in_units(letters)
    for word in ([0], [1], [0, 1], [0, 0, 1], [1, 0, 1, 1, 0]):
        cycle, cost = cycle_of(scaled, np.array(word)), mean_cost(letters, word)
        if cycle is None:
            assert cost > 1e5
        else:
            assert cycle.cost == pytest.approx(cost, rel=1e-9)


def test_a_word_that_does_not_see_what_grows_has_no_cost() -> None:
    F, eye = np.diag([1.2, 1.1]), np.eye(2)
    letters = discrete(F, eye, [eye[:1], eye[1:]], [np.eye(1)] * 2, eye)
    scaled, _ = in_units(letters)
    assert cycle_of(scaled, np.array([0, 0, 0])) is None and cycle_of(scaled, np.array([1])) is None
    assert cycle_of(scaled, np.array([0, 1])) is not None
    walk = discrete(np.diag([0.5, 1.0]), eye, [eye[:1], eye[1:]], [np.eye(1)] * 2, eye)
    assert cycle_of(in_units(walk)[0], np.array([0])) is None  # it grows without end, though only in proportion to time


def test_plants_that_have_no_limit_are_refused_with_the_reason() -> None:
    eye = np.eye(2)
    with pytest.raises(InfeasibleError, match=r"no sensor sees a mode of the plant that stays \(growth a step: 1.2\)"):
        smallest_covariance(np.diag([1.2, 0.5]), eye, np.diag([0.0, 1.0]))
    with pytest.raises(InfeasibleError, match=r"does not reach every state \(x2\)"):
        smallest_covariance(np.diag([0.9, 0.5]), np.diag([1.0, 0.0]), eye)


def test_potentials_are_what_information_at_the_start_is_worth() -> None:
    letters, _ = in_units(vehicle())
    cycle = cycle_of(letters, np.array([0, 1, 0, 1, 1]))
    assert cycle is not None
    P = costates(letters, cycle)
    D = np.diag([1.0, -0.5, 0.3, 0.2])

    def later(S: np.ndarray) -> float:
        total = 0.0
        for k in range(300):
            S, charge = letters.step(S, int(cycle.word[k % 5]))
            total += charge
        return total

    slope = (later(cycle.priors[0] + 1e-4 * D) - later(cycle.priors[0] - 1e-4 * D)) / 2e-4
    assert np.vdot(P[0], D) == pytest.approx(slope, rel=1e-6)
    for Z in potentials(letters, cycle).values():
        assert np.min(np.linalg.eigvalsh(Z)) > 0


def test_small_matrices_agree_with_lapack() -> None:
    g = np.random.default_rng(3)
    for n in (1, 2, 5, 9):
        A, B = g.standard_normal((n, n)), g.standard_normal((n, 3))
        assert solve(A.copy(), B) == pytest.approx(np.linalg.solve(A, B), rel=1e-9)
        S, V = A + A.T, np.empty((n, n))
        values = eigen(S, V)
        assert np.sort(values) == pytest.approx(np.linalg.eigvalsh(S), abs=1e-12 * np.linalg.norm(S))
        assert (V * values) @ V.T == pytest.approx(S, abs=1e-12 * np.linalg.norm(S))

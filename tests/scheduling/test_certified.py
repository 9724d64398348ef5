"""The square-root pass against the plain sweep, against 60 digits, and what the proof makes of rounding."""

from __future__ import annotations

from decimal import Decimal

import numpy as np
import pytest

from occontrol.families.athans.balanced import balanced
from occontrol.families.athans.discretise import discretise, feasible_set
from occontrol.scheduling import certified
from occontrol.scheduling.certified import Roots, Term, square_root_pass
from occontrol.scheduling.proof import Judged, prove
from occontrol.scheduling.sweep import Sweep
from tests.decimal_problems import as_problem, proven
from tests.decimal_recursion import REGIMES, Data, Judge, random_data


def random_policy(rng: np.random.Generator, upper: np.ndarray) -> np.ndarray:
    v = rng.random(upper.shape) * (upper > 0) * (rng.random(upper.shape) < 0.7) + 1e-3 * (upper > 0)
    return v / v.sum(axis=1, keepdims=True)


@pytest.mark.parametrize("seed", range(6))
def test_cost_and_gradient_are_those_of_the_sweep(seed):
    rng = np.random.default_rng(seed)
    recursion = discretise(as_problem(random_data(rng, "plain")))
    weights = random_policy(rng, recursion.available)
    J, g = Sweep(recursion).cost_and_gradient(weights)
    found = square_root_pass(Roots.of(recursion), weights)
    assert found.cost == pytest.approx(J, rel=1e-13)
    assert found.below == 0.0
    np.testing.assert_allclose(found.gradient, g, rtol=1e-11, atol=1e-12 * np.max(np.abs(g)))


def test_the_gradient_is_the_slope_of_the_cost():
    rng = np.random.default_rng(11)
    roots = Roots.of(discretise(as_problem(random_data(rng, "plain"))))
    v = random_policy(rng, roots.recursion.available) + 0.05
    g = square_root_pass(roots, v).gradient
    for k, j in [(0, 0), (1, 1), (2, 0)]:
        up, down = v.copy(), v.copy()
        up[k, j] += 1e-5
        down[k, j] -= 1e-5
        slope = (square_root_pass(roots, up).cost - square_root_pass(roots, down).cost) / 2e-5
        assert g[k, j] == pytest.approx(slope, rel=1e-7, abs=1e-9)


def test_stretches_that_do_not_fit_into_memory_give_the_same_bits(monkeypatch):
    rng = np.random.default_rng(3)
    for _ in range(3):
        recursion = discretise(as_problem(random_data(rng, "plain")))
        weights = random_policy(rng, recursion.available)
        whole = square_root_pass(Roots.of(recursion), weights)
        with monkeypatch.context() as patch:
            patch.setattr(certified, "BYTES", 1)  # one interval at a time
            parts = square_root_pass(Roots.of(recursion), weights)
        assert parts.cost == pytest.approx(whole.cost, rel=1e-15)
        np.testing.assert_array_equal(parts.gradient, whole.gradient)


@pytest.mark.parametrize("regime", REGIMES)
def test_cost_and_bound_lie_within_the_allowance_of_sixty_digits(regime):
    rng = np.random.default_rng(2024)
    for _ in range(2):
        data = random_data(rng, regime)
        weights, proof = proven(as_problem(data))
        judge = Judge(data)
        true, best = judge.cost(weights), judge.optimum()[0]
        J = proof.certificate.cost
        assert float(abs(true - Decimal(J))) <= proof.allowance
        assert Decimal(proof.certificate.lower_bound) <= best
        assert proof.allowance <= 1e-6 * J


def test_the_square_root_form_keeps_digits_that_the_sweep_loses():
    """A prior of 1e14, two nearly parallel rows: the covariance itself loses the small direction."""
    rng = np.random.default_rng(1)
    worse = 0
    for _ in range(10):
        data = random_data(rng, "prior")
        recursion = discretise(balanced(as_problem(data))[0])
        weights = np.zeros(recursion.available.shape)
        weights[np.arange(len(weights)), np.arange(len(weights)) % 2] = 1.0
        true = Judge(data).cost(weights)
        found, plain = square_root_pass(Roots.of(recursion), weights).cost, Sweep(recursion).cost(weights)
        assert float(abs(Decimal(found) / true - 1)) < 1e-9
        worse += abs(plain - float(true)) > 10 * abs(found - float(true)) + 1e-15 * float(true)
    assert worse >= 2


def test_growth_beyond_double_precision_is_said():
    A = np.array([[20.0, 1.0], [0.0, -20.0]])
    sensors = [(np.array([[1e-9, 1.0]]), 1e-8 * np.eye(1), 0.0), (np.zeros((0, 2)), np.zeros((0, 0)), 0.0)]
    data = Data(A, np.eye(2), np.eye(2), sensors, np.array([[0.0, 1.0]]), np.linspace(0, 3, 4))
    _, proof = proven(as_problem(data))
    tiny = proof.allowance / abs(proof.certificate.cost) / 10
    assert not proof.resolved(tiny)
    assert "Rounding alone may move cost and bound by" in proof.remark(tiny)
    assert "more than the target gap" in proof.remark(tiny)
    assert proof.remark(1.0) == ""


def test_an_error_that_is_no_rounding_lowers_the_bound_by_itself():
    """Of two evaluations that differ by a stated error alone, the bounds differ by just that; a known bound stands."""
    problem = balanced(as_problem(random_data(np.random.default_rng(7), "plain")))[0]
    recursion, allowed = discretise(problem), feasible_set(problem)
    weights = allowed.uniform()
    J, g = Sweep(recursion).cost_and_gradient(weights)
    own = allowed.bound(J, weights, g)
    assert 0 < own < J
    error = 0.25 * own
    exact, rough = (
        prove([Judged(weights, J, g, [Term(1.0, recursion)], e)], allowed).certificate for e in (0.0, error)
    )
    assert exact.lower_bound == pytest.approx(own, rel=1e-10)
    assert exact.lower_bound - rough.lower_bound == pytest.approx(error, rel=1e-10)
    known = prove([Judged(weights, J, g, [Term(1.0, recursion)], error)], allowed, 0.9 * own).certificate
    assert known.lower_bound == pytest.approx(0.9 * own, rel=1e-10)

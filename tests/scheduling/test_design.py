"""Designs of experiments without a prior: known optima, all designs enumerated, derivatives by differences."""

from itertools import combinations

import numpy as np
import pytest

from occontrol.scheduling.criteria import LargestEigenvalue, LogDeterminant
from occontrol.scheduling.criterion import TraceCriterion
from occontrol.scheduling.design import Design, exchanged, minimise_design
from occontrol.scheduling.feasible_set import IntervalPolytopes
from occontrol.scheduling.relaxation import RelaxedOptions

TIMES = np.array([0, 0.166, 0.333, 0.5, 0.666, 1, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10, 12, 24, 30, 48])
A = TraceCriterion(np.eye(3))
D = LogDeterminant(np.eye(3))
E = LargestEigenvalue(np.eye(3))


def sensitivities(t: np.ndarray) -> np.ndarray:
    """Of a compartment model to its three parameters, (K, 3)."""
    a, b, c = 0.05884, 4.298, 21.80
    return np.column_stack([-c * t * np.exp(-a * t), c * t * np.exp(-b * t), np.exp(-a * t) - np.exp(-b * t)])


def information(t: np.ndarray) -> np.ndarray:
    g = sensitivities(t)
    return (g[:, :, None] * g[:, None, :])[None]


def six() -> IntervalPolytopes:
    return IntervalPolytopes(np.ones((1, 19)), 6)


def enumerated(measure) -> tuple[float, list[float]]:
    designs = np.array(list(combinations(range(19), 6)))
    F = np.sum(information(TIMES)[0][designs], axis=1)
    values = measure(np.linalg.svd(F, compute_uv=False))
    best = int(np.argmin(values))
    return float(values[best]), [float(TIMES[k]) for k in designs[best]]


CASES = {
    "A": (A, lambda s: np.sum(1 / s, axis=1), 0.822240785533346, 0.80888835967),
    "D": (D, lambda s: -np.sum(np.log(s), axis=1), np.log(3.736997226694786e-6), np.log(3.73254950737e-6)),
    "E": (E, lambda s: 1 / s[:, -1], 0.609438998343452, 0.60904416377),
}
CHOSEN = {
    "A": [0.166, 0.333, 1, 1.5, 2, 24],
    "D": [0.166, 0.333, 1.5, 2, 12, 24],
    "E": [0.166, 1, 1.5, 2, 2.5, 24],
}


@pytest.mark.parametrize("name", CASES)
def test_six_assays_without_a_prior(name):
    criterion, measure, known, shared = CASES[name]
    best, times = enumerated(measure)
    assert best == pytest.approx(known, rel=1e-11) and times == CHOSEN[name]
    smooth = criterion.smoothed(1e-6 * known) if name == "E" else criterion
    found = minimise_design(
        Design(information(TIMES), smooth), six(), options=RelaxedOptions(1e-8 if name != "E" else 3e-6)
    )
    assert found.status == "certified"
    assert found.lower_bound <= shared * (1 + 1e-9 * np.sign(shared)) and found.lower_bound <= best
    assert found.cost == pytest.approx(shared, rel=5e-6 if name == "E" else 1e-8)
    largest = np.zeros((1, 19))
    largest[0, np.argsort(-found.weights[0])[:6]] = 1
    design, cost = exchanged(Design(information(TIMES), criterion), six(), largest)
    assert cost == pytest.approx(known, rel=1e-11)
    assert [float(t) for t in TIMES[design[0] > 0.5]] == times


def test_the_support_of_the_continuous_volume_design():
    """Three times share equally, and by general equivalence no time is more sensitive than 3."""
    t = np.concatenate(
        [np.arange(0.18, 0.28, 0.01), np.arange(1.3, 1.5, 0.01), np.arange(18.2, 18.7, 0.01), [0.05, 5, 40]]
    )
    allowed = IntervalPolytopes(np.ones((1, len(t))), 1)
    problem = Design(information(t), D)
    found = minimise_design(problem, allowed, options=RelaxedOptions(absolute_gap=1e-8))
    assert found.status == "certified"
    v = found.weights[0]
    for at, near in ((0.228772, 0.23), (1.388586, 1.39), (18.416838, 18.42)):
        close = np.abs(t - near) < 0.3 * max(near, 0.1)
        assert np.sum(v[close]) == pytest.approx(1 / 3, abs=1e-4)
        assert t[close][np.argmax(v[close])] == pytest.approx(near, abs=1e-9)
        assert np.sum(v[close] * t[close]) / np.sum(v[close]) == pytest.approx(at, abs=6e-3)
    assert np.max(-found.gradient) == pytest.approx(3, abs=1e-6)


@pytest.mark.parametrize("criterion", [A, D, LargestEigenvalue(np.eye(3), 0.4)], ids=["A", "D", "E"])
def test_derivatives(criterion):
    rng = np.random.default_rng(1)
    H = rng.normal(size=(2, 4, 2, 3))
    L = np.swapaxes(H, 2, 3) @ H
    problem = Design(L, criterion, prior=0.1 * np.eye(3), cost=rng.uniform(size=(2, 4)))
    v, d, e = rng.uniform(0.2, 0.8, (2, 4)), rng.normal(size=(2, 4)), 1e-5
    J, g, hessian = problem.derivatives(v)
    up, down = problem.derivatives(v + e * d), problem.derivatives(v - e * d)
    assert J == problem.cost(v)
    assert np.vdot(g, d) == pytest.approx((up[0] - down[0]) / (2 * e), rel=1e-7)
    np.testing.assert_allclose(hessian @ d.ravel(), (up[1] - down[1]).ravel() / (2 * e), rtol=1e-5, atol=1e-8)


def test_a_direction_that_nothing_sees():
    problem = Design(information(TIMES[1:3]), A)
    assert problem.cost(np.ones((1, 2))) == np.inf
    with pytest.raises(ValueError, match="not seen"):
        problem.cost_and_gradient(np.ones((1, 2)))

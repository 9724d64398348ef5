"""The convex function that stands for a criterion under rules: below the true one, convex, with its own gradient."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from occontrol.families.athans.discretise import discretise
from occontrol.scheduling.criteria import LargestEigenvalue, LogDeterminant
from occontrol.scheduling.criterion_sweep import CriterionSweep
from occontrol.scheduling.information import InformationObjective
from occontrol.scheduling.peak import PeakSweep, Watched
from occontrol.scheduling.rules.model import CriterionModel
from occontrol.scheduling.seen import Seen
from tests.families.athans.random_problems import random_problem


def models(seed: int) -> dict[str, CriterionModel]:
    problem = random_problem(seed, states=3, intervals=4, rows=1)
    r, D = discretise(problem), problem.output.at(0.0)
    at = np.arange(len(r.steps))
    peak = PeakSweep(r, Watched(at, np.repeat((D.T @ D)[None], len(at), axis=0), np.zeros(len(at))))
    peak.cost(np.full(peak.shape, 1.0 / peak.shape[1]))
    limit, lost = 1.05 * peak.criterion_value, 1e-2 * peak.criterion_value
    return {
        "volume": CriterionModel(CriterionSweep(r, LogDeterminant(D)), 0.1),
        "axis": CriterionModel(CriterionSweep(r, LargestEigenvalue(D)), lost),
        "peak": CriterionModel(peak, lost),
        "limit": CriterionModel(peak, lost, limit, 3.0),
    }


def policies(model: CriterionModel, seed: int, count: int) -> list[np.ndarray]:
    rng, (N, M) = np.random.default_rng(seed), model.shape
    return [rng.dirichlet(np.full(M, 0.4), N) if i % 2 else np.eye(M)[rng.integers(0, M, N)] for i in range(count)]


@pytest.mark.parametrize("name", ["volume", "axis", "peak", "limit"])
@pytest.mark.parametrize("seed", range(3))
def test_the_model_is_convex_and_nowhere_above_the_criterion(name: str, seed: int) -> None:
    model, smooth = models(seed)[name], name != "volume"
    each = policies(model, seed, 12)
    values, true = [model.cost(v) for v in each], [model.true_cost(v) for v in each]
    size = 1.0 + max(abs(x) for x in true if np.isfinite(x))
    assert np.any(np.isfinite(true))
    for value, J in zip(values, true, strict=True):
        assert value <= J + 1e-12 * size
        if name in ("axis", "peak"):
            assert value >= J - model.lost - 1e-12 * size
    for i in range(0, 12, 2):
        middle = model.cost((each[i] + each[i + 1]) / 2)
        assert middle <= (values[i] + values[i + 1]) / 2 + 1e-10 * (1 + abs(values[i]) + abs(values[i + 1]))
    v = 0.5 * each[1] + 0.5 / model.shape[1]
    value, g = model.cost_and_gradient(v)
    assert value == pytest.approx(model.cost(v), rel=1e-12)
    step = np.random.default_rng(seed).standard_normal(v.shape)
    e = 1e-5 if smooth else 1e-4
    slope = (model.cost(v + e * step) - model.cost(v - e * step)) / (2 * e)
    assert float(np.vdot(g, step)) == pytest.approx(slope, rel=2e-4, abs=1e-6 * size)
    for tangent in model.tangents(v):
        for w, J in zip(each, true, strict=True):
            assert tangent.cost + float(np.vdot(tangent.gradient, w - v)) <= J + 1e-9 * size
    judged = model.judged(each[0])
    if np.isfinite(true[0]):
        assert judged.cost == pytest.approx(true[0], rel=1e-12, abs=1e-12)


def test_other_prices_change_the_linear_part_alone() -> None:
    for model in models(0).values():
        v = policies(model, 5, 2)[1]
        prices = model.recursion.cost + 1.0
        more = model.with_prices(prices).cost(v) - model.cost(v)
        assert more == pytest.approx(float(np.sum(v)), rel=1e-9)


def test_what_is_all_but_unseen_has_a_finite_cost_below_the_true_one() -> None:
    """Without a prior an infinite cost must not become a bound, nor outputs that rounding makes dependent an error."""
    rows = np.zeros((4, 2, 1, 2))
    rows[:, 0, 0, 0], rows[:, 1, 0, 1] = 1.0, [0.5, 1.0, 2.0, 1.0]
    D = np.array([[1.0, 1.0], [1.0, -1.0]])
    recursion = discretise(random_problem(0, states=2, intervals=4, rows=1))  # for whoever asks for its decisions
    true = InformationObjective(Seen(rows, D, np.eye(2)), LogDeterminant(D), np.full((4, 2), 0.01), recursion)
    model = CriterionModel(true, 0.0, vague=1e-16 * np.eye(2))
    words = [np.eye(2)[list(w)] for w in itertools.product(range(2), repeat=4)]
    costs = [model.true_cost(w) for w in words]
    assert np.sum(np.isfinite(costs)) == 14  # all but those that use one sensor alone
    for v in words:
        J, g = model.cost_and_gradient(v)
        assert np.isfinite(J) and model.cost(v) == J
        for w, cost in zip(words, costs, strict=True):
            assert J + np.vdot(g, w - v) <= cost + 1e-9

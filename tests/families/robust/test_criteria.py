"""Ellipsoid sizes as criteria, the exact slots as an objective, and interruption of their relaxation."""

import numpy as np
import pytest

from occontrol.core.monitor import Monitor
from occontrol.families.robust import bound as bounds
from occontrol.families.robust.bound import ExactSweep, relaxed_policy, shares, walk
from occontrol.families.robust.criteria import Smoothed, Supported
from occontrol.families.robust.ellipsoid_size import Size
from occontrol.families.robust.search import _Layer, _refine, search
from occontrol.families.robust.tails import _child
from tests.families.robust.test_search import random_problem

SIZES = [{"trace": 1.0}, {"volume": 1.0}, {"longest-axis": 1.0}, {"trace": 0.5, "volume": 0.2, "longest-axis": 1.0}]


def shape(seed, n=3):
    G = np.random.default_rng(seed).normal(size=(n, n))
    return G @ G.T + 0.1 * np.eye(n)


@pytest.mark.parametrize("terms", SIZES, ids=str)
def test_gradients_and_smoothing_of_sizes(terms):
    size, P, level = Size.of(terms), shape(1), 1.7
    true = float(size.value(P, level))
    rng = np.random.default_rng(0)
    for power in (8.0, 64.0):
        criterion = Smoothed(size, level, power)
        G = rng.normal(size=(3, 3))
        e, D = 1e-6, G + G.T
        difference = (criterion.value(P + e * D) - criterion.value(P - e * D)) / (2 * e)
        assert np.sum(criterion.gradient(P) * D) == pytest.approx(difference, rel=1e-6)
        np.testing.assert_allclose(criterion.gradient(P), criterion.gradient(P).T, rtol=1e-13)
        assert criterion.smoothing_error(P) == pytest.approx(criterion.value(P) - true, abs=1e-15)
        assert criterion.smoothing_error(P) >= -1e-12 * true
    rough, fine = (Smoothed(size, level, power).smoothing_error(np.eye(3)) for power in (4.0, 64.0))
    assert (rough > 2 * fine > 0) == size.has_kink
    below = Supported(size, level)
    assert below.value(P) == pytest.approx(true, rel=1e-12) and below.smoothing_error(P) == 0.0
    # a supporting function: its tangent in the inverse stays below the size
    for seed in range(2, 12):
        Q = shape(seed)
        slope = -P @ below.gradient(P) @ P
        assert below.value(P) + np.sum(slope * (np.linalg.inv(Q) - np.linalg.inv(P))) <= size.value(Q, level) + 1e-9


def test_the_exact_slots_are_an_objective():
    table, _, _ = random_problem(np.random.default_rng(4), 4)
    sweep = ExactSweep(table, table.start)
    assert sweep.shape == shares(table).shape == (4, table.sensors) and sweep.states == table.flow.n
    v = np.random.default_rng(0).dirichlet(np.ones(table.sensors), 4)
    _, g = sweep.cost_and_gradient(v)
    e = 1e-6
    for k, j in ((0, 0), (3, 1)):
        up, down = v.copy(), v.copy()
        up[k, j] += e
        down[k, j] -= e
        assert g[k, j] == pytest.approx((sweep.cost(up) - sweep.cost(down)) / (2 * e), rel=1e-5, abs=1e-9)
    later = ExactSweep(table, table.start, 2)
    assert later.shape == shares(table, 2).shape == (2, table.sensors)


def test_an_interruption_reaches_the_relaxation(monkeypatch):
    table, _, _ = random_problem(np.random.default_rng(8), 12, (3,), (3,))
    monitor, calls = Monitor(), []
    real = ExactSweep.cost_and_gradient

    def counted(self, weights):
        calls.append(1)
        if len(calls) == 2:
            monitor.interrupted = 2  # Ctrl-C in the middle of the relaxation on the exact slots
        return real(self, weights)

    monkeypatch.setattr(bounds.ExactSweep, "cost_and_gradient", counted)
    _, _, interrupted = relaxed_policy(table, monitor=monitor)
    stopped = len(calls)
    monitor.interrupted = 0
    _, _, whole = relaxed_policy(table, monitor=monitor)
    assert len(calls) - stopped > 3 * stopped
    assert interrupted <= whole + 1e-9  # a bound all the same
    monitor.interrupted = 2
    before = len(calls)
    assert search(table, monitor=monitor).limit == "interrupted"
    assert len(calls) - before <= 3  # one look each, no iteration
    assert monitor.history and all(record["stage"] == "" for record in monitor.history)


def test_an_interruption_reaches_later_planes_and_tails(monkeypatch):
    table, _, _ = random_problem(np.random.default_rng(8), 6, (3,), (3,))
    v, calls, real = shares(table).uniform(), [], ExactSweep.cost_and_gradient
    monkeypatch.setattr(ExactSweep, "cost_and_gradient", lambda self, w: (calls.append(1), real(self, w))[1])
    N = walk(table, v, table.start).ordinary
    layer = _Layer(N[2][None], np.zeros(1), np.zeros(1), np.zeros((1, 2), dtype=np.int16))
    parent = bounds.Plane(np.zeros(7), np.zeros((7, *table.start.shape)))

    class Parent:
        choices, weights, planes, bound = (), v, (parent,), -np.inf

    for work in (lambda m: _refine(table, layer, v, 2, m), lambda m: _child(table, Parent, 0, 1, m)):
        counts = []
        for monitor in (Monitor(), Monitor(interrupted=2)):
            calls.clear()
            work(monitor)
            counts.append(len(calls))
            assert not monitor.history
        assert counts[0] > 3 and counts[1] == 1, counts

"""Another criterion in the place of the trace: gradients, bounds, and the trace itself as an object."""

import itertools
from dataclasses import dataclass

import numpy as np
import pytest

from occontrol.families.athans.discretise import discretise, feasible_set
from occontrol.scheduling.criterion import TraceCriterion
from occontrol.scheduling.hminimal import polish
from occontrol.scheduling.relaxation import RelaxedOptions, minimise_relaxed
from occontrol.scheduling.sweep import Sweep
from tests.families.athans.random_problems import random_policy, random_problem


@dataclass(frozen=True)
class LogDet:
    """log det S: convex in the information."""

    signed = True

    def value(self, covariance):
        return float(np.linalg.slogdet(covariance)[1])

    def gradient(self, covariance):
        inverse = np.linalg.inv(covariance)
        return (inverse + inverse.T) / 2

    def smoothing_error(self, covariance):
        return 0.0


FEATURES = [{}, {"running": True}, {"rows": 2, "varying": True}]


@pytest.mark.parametrize("features", FEATURES, ids=str)
@pytest.mark.parametrize("small", [0, 1000], ids=["blas", "loops"])
def test_the_gradient_of_another_criterion(features, small):
    problem = random_problem(4, **features)
    sweep = Sweep(discretise(problem), small=small, criterion=LogDet())
    rng = np.random.default_rng(0)
    e = 1e-5
    for _ in range(3):  # the weight follows the policy
        v, w = random_policy(problem, rng), random_policy(problem, rng)
        _, g = sweep.cost_and_gradient(0.5 * (v + w))
        difference = sweep.cost((0.5 + e) * v + (0.5 - e) * w) - sweep.cost((0.5 - e) * v + (0.5 + e) * w)
        assert np.vdot(g, v - w) == pytest.approx(difference / (2 * e), rel=1e-5, abs=1e-9)


@pytest.mark.parametrize("features", FEATURES, ids=str)
def test_the_trace_as_an_object_is_the_trace_of_the_loops(features):
    problem = random_problem(4, **features)
    r = discretise(problem)
    v = random_policy(problem, np.random.default_rng(0))
    criterion = TraceCriterion(r.terminal)
    (J, g), (J_object, g_object) = Sweep(r).cost_and_gradient(v), Sweep(r, criterion=criterion).cost_and_gradient(v)
    assert J_object == pytest.approx(J, rel=1e-13)
    np.testing.assert_allclose(g_object, g, rtol=1e-11, atol=1e-13 * np.max(np.abs(g)))
    assert criterion.smoothing_error(np.eye(r.states)) == 0.0


@pytest.mark.parametrize("seed", range(4))
def test_bounds_and_polish_hold_for_another_criterion(seed):
    problem = random_problem(seed, intervals=5, idle=True)
    sweep, allowed = Sweep(discretise(problem), criterion=LogDet()), feasible_set(problem)
    best = min(sweep.cost(np.eye(4)[list(choice)]) for choice in itertools.product(range(4), repeat=5))
    relaxed = minimise_relaxed(sweep, allowed, options=RelaxedOptions(1e-5))
    assert relaxed.status == "certified" and relaxed.lower_bound <= best + 1e-9 * abs(best)
    assert not sweep.foresees_exchanges
    rounded = allowed.round(relaxed.weights)
    polished = polish(sweep, allowed, rounded)
    assert best - 1e-9 * abs(best) <= polished.cost <= sweep.cost(rounded)

"""Certificates say NO when the numbers contradict themselves."""

import numpy as np
import pytest

from occontrol.core.solution import Status
from occontrol.families.athans.discretise import discretise, feasible_set
from occontrol.scheduling.bounds import at_least_zero, policy_certificate
from occontrol.scheduling.feasible_set import IntervalPolytopes
from occontrol.scheduling.relaxation import minimise_relaxed
from occontrol.scheduling.sweep import Sweep
from tests.families.athans.random_problems import random_policy, random_problem


class Liar:
    """A concave cost: its gradients prove nothing, and their bounds lie above costs."""

    shape, states = (2, 2), 1

    def __init__(self):
        self.forward_count = self.backward_count = 0

    def cost(self, weights):
        return 1.0 - float(np.sum(weights**2))

    def cost_and_gradient(self, weights):
        return self.cost(weights), -2.0 * weights


def test_the_bound_of_a_cost_that_is_not_convex_is_refused():
    allowed = IntervalPolytopes(np.ones((2, 2)), 1)
    start = np.array([[0.6, 0.4], [0.5, 0.5]])
    known = policy_certificate(Liar(), allowed, np.full((2, 2), 0.5), floor=0.0).lower_bound
    certificate = policy_certificate(Liar(), allowed, np.eye(2), known)
    assert known == 0.0 and certificate.cost == -1.0
    assert certificate.contradicts and "lies above the cost" in certificate.text
    found = minimise_relaxed(Liar(), allowed, start)
    assert found.status is Status.DISAGREES
    assert found.lower_bound > found.cost  # shown as it is, not hidden


@pytest.mark.parametrize("features", [{}, {"running": True}, {"windows": True, "idle": True, "select": 2}], ids=str)
def test_a_policys_own_bound_is_its_linear_program(features):
    from scipy.optimize import linprog

    problem = random_problem(9, **features)
    sweep, allowed = Sweep(discretise(problem)), feasible_set(problem)
    v = random_policy(problem, np.random.default_rng(0))
    J, g = sweep.cost_and_gradient(v)
    least = sum(
        linprog(g[k], A_eq=np.ones((1, len(g[k]))), b_eq=[problem.select], bounds=[(0, u) for u in upper]).fun
        for k, upper in enumerate(problem.upper)
    )
    own = J - np.vdot(g, v) + least
    certificate = policy_certificate(sweep, allowed, v, floor=sweep.floor)
    assert certificate.cost == J and certificate.lower_bound == pytest.approx(max(own, 0.0), rel=1e-9, abs=1e-12)
    better = 0.5 * (certificate.lower_bound + J)
    assert policy_certificate(sweep, allowed, v, better).lower_bound == better
    assert policy_certificate(sweep, allowed, v, J * (1 + 1e-12)).lower_bound == J  # rounding


def test_bounds_below_zero_are_raised_to_it():
    assert at_least_zero(-3.0, 2.0) == 0.0
    assert at_least_zero(1.0, 2.0) == 1.0
    assert at_least_zero(-3.0, -1e-20) == -3.0  # a cost below zero shows that a weight is: no bound is raised above it

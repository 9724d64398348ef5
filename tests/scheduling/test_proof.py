"""What a proof makes of costs, bounds and errors that do not fit together."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from occontrol.families.athans.discretise import discretise, feasible_set
from occontrol.scheduling import certified
from occontrol.scheduling.bounds import at_least_zero, policy_certificate
from occontrol.scheduling.certified import Roots, Term, square_root_pass
from occontrol.scheduling.proof import Judged, prove
from occontrol.scheduling.relaxation import RelaxedOptions, minimise_relaxed
from occontrol.scheduling.sweep import Sweep
from tests.families.athans.random_problems import random_policy, random_problem


def judged(seed: int = 3, **changes):
    """A policy near the optimum and a bad one, as solvers hand them over, and their set."""
    problem = random_problem(seed, **changes)
    r, allowed = discretise(problem), feasible_set(problem)
    sweep, found = Sweep(r), []
    best = minimise_relaxed(sweep, allowed, options=RelaxedOptions(1e-6))
    for weights in (best.weights, random_policy(problem, np.random.default_rng(0))):
        found.append(Judged(weights, *sweep.cost_and_gradient(weights), [Term(1.0, r)]))
    return found, allowed, best.lower_bound


def test_the_best_of_all_bounds_counts():
    (near, far), allowed, known = judged()
    alone, both, told = prove([far], allowed), prove([far, near], allowed), prove([far], allowed, known)
    assert alone.certificate.cost == both.certificate.cost == pytest.approx(far.cost, rel=1e-12)
    assert alone.certificate.lower_bound < 0.999 * known
    for proof in (both, told):
        assert known * (1 - 2e-6) < proof.certificate.lower_bound <= near.cost
        assert not proof.certificate.contradicts


@pytest.mark.parametrize("off", [1e-6, -1e-6])
def test_a_bound_of_an_arithmetic_that_is_off_is_lowered_by_twenty_times_that(off):
    (_, far), allowed, known = judged()
    wrong = dataclasses.replace(far, cost=far.cost + off, gradient=far.gradient)
    proof = prove([wrong], allowed, known)
    assert proof.certificate.lower_bound == pytest.approx(known - 20e-6, abs=1e-9)
    assert proof.difference >= 1e-6
    assert proof.certificate.cost == pytest.approx(far.cost, rel=1e-12)
    assert not proof.resolved(1e-7 / far.cost) and "arithmetic was off by" in proof.remark(1e-7 / far.cost)


def test_a_bound_may_lie_above_the_cost_by_five_errors_and_not_by_more():
    (near, _), allowed, _ = judged()
    error = 1e-3 * near.cost
    for errors, contradicts in ((4.9, False), (5.1, True)):
        stated = dataclasses.replace(near, error=error)
        assert bool(prove([stated], allowed, near.cost + errors * error).certificate.contradicts) is contradicts


def test_nothing_is_raised_to_zero_where_a_cost_is_below():
    assert at_least_zero(-1.0, 2.0) == at_least_zero(-1.0, 0.0) == 0.0
    assert at_least_zero(-1.0, -0.5) == -1.0 and at_least_zero(0.3, 2.0) == 0.3


def test_a_certificate_takes_the_bound_that_is_known_already():
    (near, far), allowed, known = judged()
    sweep = Sweep(far.terms[0].recursion)
    own = policy_certificate(sweep, allowed, far.weights)
    assert own.lower_bound < 0.999 * known
    assert policy_certificate(sweep, allowed, far.weights, known).lower_bound == known
    assert policy_certificate(sweep, allowed, near.weights, 0.0).lower_bound > 0.999 * known


def test_rounding_of_two_meshes_is_that_of_their_factors_without_signs(monkeypatch):
    """4/3 of one cost less 1/3 of another rounds like 5/3 of a cost, not like one."""
    monkeypatch.setattr(certified, "FACTOR", 1e6)  # so that the constant part does not matter
    (_, far), allowed, _ = judged()
    r = far.terms[0].recursion
    one = certified.certified([Term(1.0, r)], allowed, far.weights)
    two = certified.certified([Term(4 / 3, r), Term(-1 / 3, r)], allowed, far.weights)
    constant = certified.FACTOR * certified.ULP * r.states * np.sqrt(len(r.steps)) * far.cost
    assert two.cost == pytest.approx(one.cost, rel=1e-12)
    assert (two.cost_allowance - constant) / (one.cost_allowance - constant) == pytest.approx(5 / 3, rel=1e-6)


def below_zero(seed: int = 1):
    """A problem whose running weight has an eigenvalue slightly below zero, and a policy."""
    problem = random_problem(seed, running=True)
    r = discretise(problem)
    r = dataclasses.replace(r, running=r.running - np.diag([0.0, 0.0, 0.2 + 1e-3])[None])
    return r, feasible_set(problem), random_policy(problem, np.random.default_rng(0))


def test_what_a_running_weight_has_below_zero_is_taken_from_cost_and_bound():
    r, allowed, weights = below_zero()
    found = certified.certified([Term(1.0, r)], allowed, weights)
    assert not found.convex and found.below > 0
    assert found.cost == pytest.approx(Sweep(r).cost(weights), rel=1e-11)
    roots = Roots.of(r)
    passed = square_root_pass(roots, weights)
    most = square_root_pass(roots, np.zeros_like(weights)).below
    assert most > passed.below == pytest.approx(found.below, rel=1e-12)
    assert found.lower_bound == pytest.approx(allowed.bound(passed.cost, weights, passed.gradient) - most, rel=1e-11)


def test_where_the_cost_is_not_convex_no_bound_from_outside_is_believed():
    r, allowed, weights = below_zero()
    policy = Judged(weights, *Sweep(r).cost_and_gradient(weights), [Term(1.0, r)])
    alone = prove([policy], allowed)
    assert prove([policy], allowed, 0.99 * policy.cost).certificate.lower_bound == alone.certificate.lower_bound
    assert "running weight is slightly below zero" in alone.remark(1.0)

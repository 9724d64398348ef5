"""Several steps to one decision: gradient, cost and bounds against plain code and finite differences."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from occontrol.families.athans.discretise import discretise
from occontrol.scheduling import baselines
from occontrol.scheduling.feasible_set import IntervalPolytopes
from occontrol.scheduling.hminimal import h_minimal, polish
from occontrol.scheduling.path import step_path
from occontrol.scheduling.relaxation import RelaxedOptions, minimise_relaxed
from occontrol.scheduling.sweep import Sweep
from tests.families.athans.random_problems import random_problem

FEATURES = [{}, {"running": True}, {"rows": 2, "varying": True}, {"running": True, "rows": 2, "varying": True}]
OWNER = np.array([0, 0, 0, 1, 2, 2, 3, 3, 3])  # uneven on purpose: no decision has the mean number of steps


def shared(seed, owner=OWNER, closed=(), **features):
    """A recursion whose steps share decisions as `owner` says, and the policies that it allows."""
    fine = discretise(random_problem(seed, intervals=len(owner), idle=True, **features))
    upper = np.ones((owner[-1] + 1, fine.sensors))
    for place in closed:
        upper[place] = 0.0
    return replace(fine, available=upper, owner=owner), IntervalPolytopes(upper, 1)


@pytest.mark.parametrize("features", FEATURES, ids=str)
@pytest.mark.parametrize("small", [0, 1000], ids=["blas", "loops"])
def test_the_gradient_of_shared_decisions_is_the_finite_difference(features, small):
    r, allowed = shared(3, **features)
    sweep = Sweep(r, small=small)
    v = np.random.default_rng(1).dirichlet(np.ones(r.sensors), size=4)
    J, g = sweep.cost_and_gradient(v)
    assert g.shape == allowed.shape == sweep.shape == (4, 4)
    assert sweep.cost(v) == J
    e = 1e-6
    for k, j in itertools.product(range(4), range(4)):
        up, down = v.copy(), v.copy()
        up[k, j] += e
        down[k, j] -= e
        assert g[k, j] == pytest.approx((sweep.cost(up) - sweep.cost(down)) / (2 * e), rel=1e-5, abs=1e-8)


@pytest.mark.parametrize("features", FEATURES, ids=str)
def test_shared_decisions_cost_what_the_same_rows_repeated_cost(features):
    r, _ = shared(5, **features)
    v = np.random.default_rng(2).dirichlet(np.ones(r.sensors), size=4)
    J, g = Sweep(r).cost_and_gradient(v)
    apart = replace(r, available=np.ones((9, r.sensors)), owner=None)
    J_apart, g_apart = Sweep(apart).cost_and_gradient(v[OWNER])
    assert J_apart == J
    by_hand = np.array([g_apart[OWNER == k].sum(axis=0) for k in range(4)])
    np.testing.assert_allclose(g, by_hand, rtol=1e-14)
    np.testing.assert_allclose(r.decision_cost, [r.cost[OWNER == k].sum(axis=0) for k in range(4)], rtol=1e-15)
    np.testing.assert_allclose(r.lengths, [r.steps[OWNER == k].sum() for k in range(4)], rtol=1e-15)
    assert Sweep(r, memory_budget=8 * r.states**2 * 3).cost_and_gradient(v)[0] == pytest.approx(J, rel=1e-14)


@pytest.mark.parametrize("small", [0, 1000], ids=["blas", "loops"])
def test_an_update_in_many_identical_parts_is_the_update_in_one(small):
    """Nothing happens between the parts, so the information adds up: the same cost, the same gradient."""
    whole = discretise(random_problem(8, intervals=3, rows=2))
    n, parts = whole.states, 4
    still = len(whole.transition)
    predict = np.concatenate([np.r_[whole.predict[k], [still] * (parts - 1)] for k in range(3)] + [whole.predict[3:]])
    divided = replace(
        whole,
        transition=np.concatenate([whole.transition, np.eye(n)[None]]),
        noise=np.concatenate([whole.noise, np.zeros((1, n, n))]),
        predict=predict,
        row_set=np.repeat(whole.row_set, parts),
        steps=np.repeat(whole.steps / parts, parts),
        cost=np.repeat(whole.cost / parts, parts, axis=0),
        running_set=np.repeat(whole.running_set, parts),
        owner=np.repeat(np.arange(3), parts),
    )
    v = np.random.default_rng(0).dirichlet(np.ones(whole.sensors), size=3)
    (J, g), (J_parts, g_parts) = (Sweep(r, small=small).cost_and_gradient(v) for r in (whole, divided))
    assert J_parts == pytest.approx(J, rel=1e-12)
    np.testing.assert_allclose(g_parts, g, rtol=1e-11)
    allowed = IntervalPolytopes(whole.available, 1)
    np.testing.assert_array_equal(baselines.greedy(divided, allowed), baselines.greedy(whole, allowed))


def test_one_step_a_decision_copies_nothing():
    r = discretise(random_problem(1))
    named = replace(r, owner=np.arange(r.intervals))
    v = np.ones((r.intervals, r.sensors)) / r.sensors
    assert named.owner is None and named.on_steps(v) is v and named.by_decision(v) is v
    one, other = Sweep(r).cost_and_gradient(v), Sweep(named).cost_and_gradient(v)
    assert one[0] == other[0] and np.array_equal(one[1], other[1])


WRONG = [[0, 0, 2, 2], [1, 1, 0, 0], [0, 1, 1], [0, 0, 0, 0], [1, 1, 2, 2], [0, 1, 0, 1]]


@pytest.mark.parametrize("owner", WRONG, ids=str)
def test_an_owner_that_leaves_a_decision_out_or_turns_back_is_refused(owner):
    r = discretise(random_problem(1, intervals=4))
    with pytest.raises(ValueError, match=r"owner must name the decisions 0 \.\. 1 in order, one for every step"):
        replace(r, available=np.ones((2, r.sensors)), owner=np.array(owner))


@pytest.mark.parametrize("features", FEATURES, ids=str)
def test_the_plain_path_has_the_costate_that_the_gradient_is_made_of(features):
    r, _ = shared(6, **features)
    v = np.random.default_rng(4).dirichlet(np.ones(r.sensors), size=4)
    J, g = Sweep(r).cost_and_gradient(v)
    path = step_path(r, v)
    charged = sum(
        r.steps[k] / 2 * np.sum(r.running[r.running_set[k]] * (path.before[k] + path.after[k]))
        for k in range(len(r.steps) if len(r.running) else 0)
    )
    assert np.vdot(r.decision_cost, v) + charged + np.sum(r.terminal * path.final) == pytest.approx(J, rel=1e-12)
    found = r.cost.copy()
    for k in range(len(r.steps)):
        rows = r.rows[r.row_set[k]] @ path.after[k]
        for j in range(r.sensors):
            own = rows[r.offsets[j] : r.offsets[j + 1]]
            found[k, j] -= r.steps[k] * np.sum((own @ path.costate[k]) * own)
    np.testing.assert_allclose(g, r.by_decision(found), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("running", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_every_solver_works_on_shared_decisions(seed, running):
    """Bounds against all 4^4 schedules; on two decisions a sensor is closed."""
    r, allowed = shared(20 + seed, closed=[(1, 0), (3, 2)], running=running)
    sweep = Sweep(r)
    costs = []
    for choice in itertools.product(range(4), repeat=4):
        v = np.eye(4)[list(choice)]
        if allowed.contains(v):
            costs.append(sweep.cost(v))
    assert len(costs) == 4 * 4 * 3 * 3
    best = min(costs)
    relaxed = minimise_relaxed(sweep, allowed, options=RelaxedOptions(1e-6))
    assert relaxed.status == "certified"
    assert relaxed.lower_bound <= best * (1 + 1e-12)
    assert not sweep.foresees_exchanges  # an exchange would change several steps at once
    for start in (baselines.greedy(r, allowed), baselines.round_robin(r, allowed), allowed.round(relaxed.weights)):
        assert allowed.contains(start)
        for found in (polish(sweep, allowed, start), h_minimal(sweep, allowed, start)):
            assert allowed.contains(found.weights) and np.array_equal(found.weights, np.round(found.weights))
            assert best * (1 - 1e-12) <= found.cost <= sweep.cost(start) * (1 + 1e-12)
            assert found.lower_bound <= best * (1 + 1e-12)


def test_a_closed_sensor_has_its_price_as_gradient():
    r, _ = shared(7, closed=[(1, 0), (3, 2)])
    v = np.tile([0.0, 1.0, 0.0, 0.0], (4, 1))
    for small in (0, 1000):
        _, g = Sweep(r, small=small).cost_and_gradient(v)
        closed = r.available == 0.0
        np.testing.assert_allclose(g[closed], r.decision_cost[closed], rtol=1e-15)
        assert np.all(g[~closed][r.decision_cost[~closed] > 0] < r.decision_cost[~closed][r.decision_cost[~closed] > 0])


def greedy_by_definition(r):
    """Price, running charge of the steps before the last, tr(W_k S+) after it: with plain inverses."""
    owner = np.arange(len(r.steps)) if r.owner is None else r.owner
    later, W = {}, r.terminal
    for k in range(len(r.steps) - 1, -1, -1):
        F = r.transition[r.predict[k + 1]]
        W = later[k] = F.T @ W @ F + r.steps[k] * r.running[r.running_set[k]]
    S, chosen = r.initial, []
    for decision in range(r.intervals):
        steps, options = np.flatnonzero(owner == decision), []
        for j in range(r.sensors):
            value, after = 0.0, S
            for k in steps:
                F, C = r.transition[r.predict[k]], r.rows[r.row_set[k]][r.offsets[j] : r.offsets[j + 1]]
                before = F @ after @ F.T + r.noise[r.predict[k]]
                after = np.linalg.inv(np.linalg.inv(before) + r.steps[k] * C.T @ C)
                weight = later[k] if k == steps[-1] else r.steps[k] * r.running[r.running_set[k]]
                value += r.cost[k, j] + np.trace(weight @ after)
            options.append((value, j, after))
        _, j, S = min(options, key=lambda option: option[0])
        chosen.append(j)
    return chosen


@pytest.mark.parametrize("seed", range(30))
def test_greedy_charges_every_step_once(seed):
    r, allowed = shared(seed, running=True)
    r = replace(r, running=r.running * 8.0)
    assert np.argmax(baselines.greedy(r, allowed), axis=1).tolist() == greedy_by_definition(r)

"""Choosers: the paper's scores, multiplicity, ties, several places, baselines."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from occontrol.core.plant import DiscretePlant
from occontrol.families.vlambda.baselines import FixedChooser, RandomChooser, RoundRobinChooser
from occontrol.families.vlambda.eigenfactor import Eigenfactors, eigenfactors_of
from occontrol.families.vlambda.sampled_plant import sample_plant
from occontrol.families.vlambda.sensor import DiscreteSensor, Region
from occontrol.families.vlambda.sensor_choice import (
    EigenspaceChooser,
    Epoch,
    TraceChooser,
    best_of,
    information_along,
    trace_removed,
    worst_eigenspace,
)


def random_epoch(seed, sensors=5, select=1, n=4, index=0):
    g = np.random.default_rng(seed)
    root = g.standard_normal((n, n))
    suite = [DiscreteSensor(f"s{j}", g.standard_normal((2, n)), np.eye(2) * g.uniform(0.1, 1)) for j in range(sensors)]
    plant = sample_plant(DiscretePlant(np.eye(n), np.eye(n), np.eye(n)), suite, 10)
    return Epoch(plant, index, 0, 10, eigenfactors_of(root @ root.T), select)


def information(epoch, j):
    H, R = epoch.plant.sensors[j].matrices(0, 1)
    return H[0].T @ np.linalg.inv(R[0]) @ H[0]


def test_scores_are_the_traces_of_the_projected_information():
    epoch = random_epoch(0)
    P = epoch.factors.covariance
    vectors = np.linalg.eigh(P)[1]
    E = np.outer(vectors[:, -1], vectors[:, -1])
    expected = [np.trace(E @ information(epoch, j)) for j in range(5)]
    choice = EigenspaceChooser().choose(epoch)
    assert choice.scores == pytest.approx(expected, rel=1e-9)
    assert choice.sensors == (int(np.argmax(expected)),)


def test_the_whole_eigenspace_counts_whatever_basis_the_solver_found():
    g = np.random.default_rng(1)
    V = np.linalg.qr(g.standard_normal((4, 4)))[0]
    turn = np.eye(4)
    turn[:3, :3] = np.linalg.qr(g.standard_normal((3, 3)))[0]
    epoch = random_epoch(2)
    deviations = np.array([2.0, 2.0, 2.0, 1.0])
    scores = [
        EigenspaceChooser().choose(Epoch(epoch.plant, 0, 0, 10, Eigenfactors(basis, deviations), 1)).scores
        for basis in (V, V @ turn)
    ]
    assert scores[0] == pytest.approx(scores[1], rel=1e-12)


@pytest.mark.parametrize(("gap", "multiplicity"), [(0.0, 3), (1e-10, 3), (1e-8, 1), (1e-3, 1)])
def test_multiplicity_goes_by_the_stated_tolerance(gap, multiplicity):
    factors = Eigenfactors(np.eye(3), np.sqrt(np.array([1.0, 1.0 - gap, 1.0 - gap])))
    assert worst_eigenspace(factors).shape == (3, multiplicity)
    assert worst_eigenspace(factors, tolerance=0.1).shape == (3, 3)


def test_ties_go_to_the_lowest_index():
    assert best_of(np.array([1.0, 2.0, 2.0]), 1) == (1,)
    assert best_of(np.array([1.0, 2.0, 2.0 + 1e-14]), 1) == (1,)
    assert best_of(np.array([3.0, 2.0, 2.0, 5.0]), 2) == (0, 3)
    assert best_of(np.array([0.0, 0.0, 0.0]), 2) == (0, 1)
    assert best_of(np.array([-np.inf, 1.0, -np.inf]), 2) == (0, 1)
    assert best_of(np.array([2.0, 2.0 + 1e-6]), 1) == (1,)


@pytest.mark.parametrize("select", [2, 3])
def test_several_places_take_the_group_with_most_information(select):
    epoch = random_epoch(5, select=select)
    basis = worst_eigenspace(epoch.factors)
    J = [information(epoch, j) for j in range(5)]
    groups = list(itertools.combinations(range(5), select))
    best = max(groups, key=lambda g: np.trace(basis.T @ sum(J[j] for j in g) @ basis))
    assert EigenspaceChooser().choose(epoch).sensors == best


@pytest.mark.parametrize("select", [1, 2, 3])
def test_trace_leaves_the_smallest_posterior_trace(select):
    for seed in range(10):
        epoch = random_epoch(seed, select=select)
        prior = np.linalg.inv(epoch.factors.covariance)
        groups = list(itertools.combinations(range(5), select))
        after = [np.trace(np.linalg.inv(prior + sum(information(epoch, j) for j in g))) for g in groups]
        choice = TraceChooser().choose(epoch)
        assert choice.sensors == groups[int(np.argmin(after))]
        alone = [np.trace(np.linalg.inv(prior + information(epoch, j))) for j in range(5)]
        assert choice.scores == pytest.approx(np.trace(epoch.factors.covariance) - np.array(alone), rel=1e-8)


def test_trace_removed_works_where_the_covariance_is_singular():
    factors = Eigenfactors(np.eye(3), np.array([2.0, 1.0, 0.0]))
    assert trace_removed(factors, np.array([[1.0, 0.0, 0.0]])) == pytest.approx(4 - 4 / 5)
    assert trace_removed(factors, np.array([[0.0, 0.0, 1.0]])) == pytest.approx(0.0)


def test_round_robin_fixed_and_random():
    names = [RoundRobinChooser().choose(random_epoch(0, select=2, index=e)).sensors for e in range(5)]
    assert names == [(0, 1), (2, 3), (0, 4), (1, 2), (3, 4)]
    assert FixedChooser((3, 1)).choose(random_epoch(0, select=2)).sensors == (1, 3)
    drawn = [RandomChooser(7).choose(random_epoch(0, select=2, index=e)).sensors for e in range(40)]
    assert drawn == [RandomChooser(7).choose(random_epoch(0, select=2, index=e)).sensors for e in range(40)]
    assert drawn != [RandomChooser(8).choose(random_epoch(0, select=2, index=e)).sensors for e in range(40)]
    assert {j for group in drawn for j in group} == set(range(5))
    assert all(len(set(group)) == 2 for group in drawn)


def test_a_movable_sensor_goes_where_it_tells_most_about_the_worst_direction():
    sensor = DiscreteSensor("arm", [["cos(p1)", "sin(p1)"]], [[0.5]], Region([[0.0, 3.0]]))
    fixed = DiscreteSensor("still", [[1.0, 0.0]], [[0.4]])
    plant = sample_plant(DiscretePlant(np.eye(2), np.eye(2), np.eye(2)), [sensor, fixed], 4)
    for angle in (0.3, 1.2, 2.5):
        v = np.array([np.cos(angle), np.sin(angle)])
        P = 0.1 * np.eye(2) + 3 * np.outer(v, v)
        choice = EigenspaceChooser().choose(Epoch(plant, 0, 0, 4, eigenfactors_of(P), 1))
        assert choice.scores == pytest.approx([2.0, 2.5 * np.cos(angle) ** 2], rel=1e-9)
        if choice.sensors == (0,):
            assert choice.locations[0] == pytest.approx([angle], abs=1e-4)
        else:
            assert choice.sensors == (1,)
            assert not choice.locations


def test_information_along_a_subspace_is_a_squared_norm():
    g = np.random.default_rng(3)
    rows, basis = g.standard_normal((6, 2, 4)), np.linalg.qr(g.standard_normal((4, 2)))[0]
    expected = [np.trace(basis @ basis.T @ C.T @ C) for C in rows]
    assert information_along(basis, rows) == pytest.approx(expected)

"""Bounds for all schedules: averaged and by trees, against every cycle and every short schedule, and checked anew."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from occontrol.core.monitor import Monitor
from occontrol.scheduling.periodic.averaged import averaged_flow, averaged_steps
from occontrol.scheduling.periodic.certificate import checked_bound, faults
from occontrol.scheduling.periodic.cycles import CycleRules, canonical, free, search
from occontrol.scheduling.periodic.letters import Letters
from occontrol.scheduling.periodic.phases import always
from occontrol.scheduling.periodic.potential import cycle_of, potentials
from occontrol.scheduling.periodic.tree import ProofTree
from tests.plain_cycles import best_by_counting, in_units, mean_cost, on_off, random_plant, unstable, vehicle


def grown(letters: Letters, gap: float, most: int) -> tuple[ProofTree, float]:
    """A tree under the best cycle's potential, and the cost of the cycle."""
    found = search(letters, 6, free(np.eye(letters.count)), Monitor()).best
    assert found is not None
    tree = ProofTree(letters, potentials(letters, found)["harmonic mean of the cycle"], found.cost)
    tree.grow(found.cost * (1 - gap), most, Monitor())
    return tree, found.cost


def test_the_vehicle_has_the_known_numbers() -> None:
    letters, _ = in_units(vehicle())
    averaged = averaged_steps(letters)
    assert averaged.lower_bound == pytest.approx(1.1488996, abs=5e-8)
    assert averaged.shares == pytest.approx([0.41087, 0.58913], abs=5e-6)
    costs = {w: cycle_of(letters, np.array([int(c) for c in w])).cost for w in ("0", "1", "01", "01011")}
    known = {"0": 1.3884684, "1": 1.2683954, "01": 1.1585311, "01011": 1.1562896}
    assert costs == pytest.approx(known, abs=5e-8)
    tree, cost = grown(letters, 1e-4, 3000)
    assert cost == costs["01011"] and 1.1561 <= tree.bound <= cost


def test_on_and_off_is_closed_and_the_unstable_plant_to_five_percent() -> None:
    letters, _ = in_units(on_off())
    tree, cost = grown(letters, 1e-5, 500)
    assert cost == pytest.approx(2.4498607134, rel=1e-10) and tree.bound >= cost * (1 - 1e-5)
    assert averaged_steps(letters).lower_bound == pytest.approx(2.26958, abs=5e-6)
    letters, _ = in_units(unstable())
    tree, cost = grown(letters, 0.05, 6000)
    assert cost == pytest.approx(17.97077, abs=5e-6) and tree.bound >= 0.95 * cost
    assert averaged_steps(letters).lower_bound == pytest.approx(7.2997, abs=5e-5)


@pytest.mark.parametrize("seed", range(8))
def test_no_bound_lies_above_any_cycle(seed: int) -> None:
    letters = random_plant(seed, 2, 2)
    best, word = best_by_counting(letters, 6)
    scaled, root = in_units(letters)
    found = search(scaled, 6, free(np.eye(2)), Monitor())
    assert found.best is not None and found.best.cost == pytest.approx(best, rel=1e-9)
    assert canonical(tuple(found.best.word)) == canonical(word)
    averaged = averaged_steps(scaled)
    tree, _ = grown(scaled, 1e-3, 600)
    assert averaged.lower_bound <= best and tree.bound <= best
    assert np.isfinite(averaged.lower_bound) and tree.bound >= 0.5 * best
    checked = checked_bound(tree.proof(root), letters, root @ root.T)
    assert checked == pytest.approx(tree.bound, rel=1e-9)


def test_finite_horizons_from_the_smallest_covariance_bound_cycles_and_come_near_the_proof() -> None:
    """By order, no schedule of T steps costs less than the best one from the smallest covariance."""
    letters, _ = in_units(vehicle())
    best, least = {(): (0.0, np.eye(4))}, []
    for length in range(1, 13):
        following = {}
        for word, (cost, S) in best.items():
            for a in range(2):
                after, charge = letters.step(S, a)
                following[(*word, a)] = (cost + charge, after)
        best = following
        least.append(min(c for c, _ in best.values()) / length)
    tree, cost = grown(letters, 1e-3, 2000)
    assert all(x <= cost for x in least) and np.all(np.diff(least) > 0)
    # what is missing falls as 1/T, so that twice T comes twice as near, and the proof is nearer
    missing = cost - np.array(least)
    assert missing[11] == pytest.approx(missing[5] / 2, rel=0.2) and tree.bound > least[-1]


@pytest.mark.parametrize("gain", [0.7, 1.0, 1.3])
def test_one_sensor_is_the_riccati_equation(gain: float) -> None:
    control = pytest.importorskip("control")
    letters = random_plant(11, 3, 1)
    letters = replace(letters, F=letters.F * gain)
    values, vectors = np.linalg.eigh(letters.L[0])
    H = (vectors * np.sqrt(np.maximum(values, 0.0))).T
    S = control.dare(letters.F[0].T, H.T, letters.Q[0], np.eye(3))[0]
    scaled, root = in_units(letters)
    averaged, cycle = averaged_steps(scaled), cycle_of(scaled, np.zeros(1))
    assert cycle is not None
    assert root @ cycle.priors[0] @ root.T == pytest.approx(S, rel=1e-9, abs=1e-9 * np.max(np.abs(S)))
    price = float(letters.constant[0])
    expected = np.trace(S) + price  # seed 11 is charged before the reading
    assert cycle.cost == pytest.approx(expected, rel=1e-9) and averaged.cost == pytest.approx(expected, rel=1e-9)


def test_the_averaged_gradient_is_the_quotient_of_differences_and_its_bound_the_minimum() -> None:
    letters, _ = in_units(random_plant(14, 3, 3))
    averaged = averaged_steps(letters)
    grid = [np.array([a, b, 1 - a - b]) for a in np.linspace(0.01, 0.97, 12) for b in np.linspace(0.01, 0.98 - a, 12)]

    def f(v: np.ndarray) -> float:
        """The steady charge of shares, by iterating the plain filter."""
        mixed = [np.tensordot(v, x, 1)[None] for x in (letters.F, letters.Q, letters.L, letters.seen, letters.weight)]
        return mean_cost(Letters(*mixed, np.array([v @ letters.constant])), [0])

    assert f(averaged.shares) == pytest.approx(averaged.cost, rel=1e-9)
    assert averaged.lower_bound <= min(f(v) for v in grid) and averaged.cost - averaged.lower_bound < 1e-8


def test_the_averaged_flow_is_the_scalar_formula() -> None:
    """One state, one sensor and idle with a price: a + sqrt(a^2 + Xi L v) over L v, minimised by a scan."""
    a, xi, L, price = 0.3, 0.7, 2.0, 1.1
    one = np.eye(1)
    found = averaged_flow(a * one, xi * one, np.array([L * one, 0 * one]), one, np.array([price, 0.0]))
    v = np.linspace(1e-4, 1, 400_001)
    f = (a + np.sqrt(a * a + xi * L * v)) / (L * v) + price * v
    assert found.cost == pytest.approx(np.min(f), rel=1e-9)
    assert found.cost * (1 - 1e-8) <= found.lower_bound <= found.cost
    assert found.shares[0] == pytest.approx(v[np.argmin(f)], abs=1e-4)


def test_a_spoilt_proof_is_told_from_a_good_one() -> None:
    letters = vehicle()
    scaled, root = in_units(letters)
    tree, _ = grown(scaled, 1e-3, 2000)
    proof, smallest = tree.proof(root), root @ root.T
    assert faults(proof, letters) == []
    assert checked_bound(proof, letters, smallest) == pytest.approx(tree.bound, rel=1e-9)
    code = "the words of the proof do not stand for all schedules: they are no complete prefix code"
    for words in (proof.words[1:], np.vstack([proof.words[1:], proof.words[1:2]])):
        points = proof.points[: len(words)]
        assert faults(replace(proof, words=words, points=points, starts=proof.starts[: len(words)]), letters) == [code]
    shorter = proof.words.copy()
    shorter[0, np.sum(shorter[0] >= 0) - 1] = -1
    assert faults(replace(proof, words=shorter), letters) == [code]
    negative, foreign = replace(proof, potential=-proof.potential), replace(proof, words=proof.words + 2)
    assert faults(negative, letters) == ["the potential of the proof is not positive semidefinite"]
    assert faults(foreign, letters) == ["a word of the proof has a letter that there is not"]
    # other points and potentials still prove something, but less, never more than a cycle costs
    for other in (replace(proof, points=0.7 * proof.points), replace(proof, potential=0.5 * proof.potential)):
        assert checked_bound(other, letters, smallest) < tree.bound
    # a tangent belongs to its own word
    assert checked_bound(replace(proof, points=proof.points[::-1]), letters, smallest) < tree.bound


def test_the_search_keeps_rules_and_longer_cycles_come_from_shorter_ones() -> None:
    letters, _ = in_units(vehicle())
    never = np.full(2, 1 << 30)
    dwell = search(letters, 8, CycleRules(np.eye(2), np.full(2, 2), never), Monitor()).best
    assert dwell is not None
    word = dwell.word
    runs = [k for k in range(len(word)) if word[k] != word[k - 1]]
    assert all((b - a) % len(word) >= 2 for a, b in zip(runs, [*runs[1:], runs[0]], strict=True))
    rare = search(letters, 8, CycleRules(np.eye(2), np.ones(2), np.array([1, 1 << 30])), Monitor()).best
    assert rare is not None and np.sum(rare.word == 0) <= 1
    letters, _ = in_units(unstable())
    from occontrol.scheduling.periodic import cycles

    found = cycles.Found()
    for p in (1, 2):
        cycles._all_of(letters, p, always(4), free(np.eye(4)), found, Monitor())
    cycles._longer(letters, 8, always(4), free(np.eye(4)), found, Monitor(), 1)
    assert found.best is not None and found.best.cost <= 18.2023 and len(found.best.word) > 2

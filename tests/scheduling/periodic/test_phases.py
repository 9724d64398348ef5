"""Windows that come again: cycles, shares and proofs against every cycle that keeps to them, counted one by one."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from occontrol.core.monitor import Monitor
from occontrol.scheduling.periodic import cycles
from occontrol.scheduling.periodic.averaged import averaged_steps
from occontrol.scheduling.periodic.certificate import checked_bound, faults
from occontrol.scheduling.periodic.cycles import CycleRules, free, search
from occontrol.scheduling.periodic.phases import Phases
from occontrol.scheduling.periodic.potential import potentials
from occontrol.scheduling.periodic.tree import ProofTree
from tests.plain_cycles import in_units, mean_cost, random_plant, vehicle

OPENED = np.array([[1, 1], [1, 0], [0, 1]], dtype=bool)


def counted(letters, opened, longest, keeps=lambda word: True) -> tuple[float, tuple[int, ...]]:
    """The best cycle that keeps to the windows, and its cost, every one looked at."""
    P, best = len(opened), (np.inf, ())
    for p in range(P, longest + 1, P):
        for word in product(*(np.flatnonzero(opened[k % P]) for k in range(p))):
            if keeps(word) and (cost := mean_cost(letters, word)) < best[0] - 1e-11:
                best = cost, tuple(int(a) for a in word)
    return best


def proven(scaled, phases: Phases, found, gap: float, most: int) -> ProofTree:
    """A tree under the cycle's potentials."""
    Z = potentials(scaled, found, phases.count)["harmonic mean of the cycle"]
    tree = ProofTree(scaled, Z, found.cost, phases=phases)
    tree.grow(found.cost * (1 - gap), most, Monitor())
    return tree


@pytest.mark.parametrize("seed", range(6))
def test_cycles_and_bounds_keep_to_the_windows(seed: int) -> None:
    letters, opened = random_plant(seed, 1 + seed % 3, 2), OPENED if seed % 2 else OPENED[:2]
    phases, (scaled, root) = Phases(opened), in_units(letters)
    best, word = counted(letters, opened, 6)
    found = search(scaled, 6, free(np.eye(2)), Monitor(), phases=phases)
    assert found.best is not None and found.complete_to == 6
    assert found.best.cost == pytest.approx(best, rel=1e-9)
    assert phases.canonical(tuple(int(a) for a in found.best.word)) == phases.canonical(word)
    averaged = averaged_steps(scaled, phases)
    share = np.mean(opened[:, 0] & ~opened[:, 1])  # where the first is alone it is used
    assert share - 1e-9 <= averaged.shares[0] <= np.mean(opened[:, 0]) + 1e-9
    assert averaged_steps(scaled).lower_bound <= averaged.lower_bound * (1 + 1e-9)
    tree = proven(scaled, phases, found.best, 1e-4, 1500)
    assert averaged.lower_bound <= best and 0.97 * best <= tree.bound <= best
    proof = tree.proof(root)
    assert faults(proof, letters, phases) == []
    # each is lowered by what rounding may have done to it, 1e-15 of the size of what was added up
    assert checked_bound(proof, letters, root @ root.T) == pytest.approx(tree.bound, rel=1e-8)


def test_the_averaged_bound_with_windows_is_the_minimum_over_a_grid_of_shares() -> None:
    letters = random_plant(14, 3, 2)
    scaled, _ = in_units(letters)
    averaged, least = averaged_steps(scaled, Phases(OPENED)), np.inf
    for x in np.linspace(0, 1, 101):
        v = np.array([1 + x, 2 - x]) / 3  # x is the share of the first where both are open
        mixed = [np.tensordot(v, a, 1)[None] for a in (letters.F, letters.Q, letters.L, letters.seen, letters.weight)]
        least = min(
            least,
            mean_cost(
                replace(letters, **dict(zip(NAMES, mixed, strict=True)), constant=letters.constant @ v[:, None]), [0]
            ),
        )
    assert averaged.cost - 1e-9 <= least <= averaged.cost * (1 + 1e-4)
    assert averaged.cost * (1 - 1e-8) <= averaged.lower_bound <= averaged.cost


NAMES = ("F", "Q", "L", "seen", "weight")


def test_a_proof_stands_for_the_windows_it_was_made_for() -> None:
    letters, phases = vehicle(), Phases(OPENED)
    scaled, root = in_units(letters)
    found = search(scaled, 6, free(np.eye(2)), Monitor(), phases=phases).best
    assert found is not None
    proof = proven(scaled, phases, found, 1e-3, 3000).proof(root)
    assert faults(proof, letters, phases) == []
    code = ["the words of the proof do not stand for all schedules: they are no complete prefix code"]
    assert faults(proof, letters, Phases(np.ones((3, 2)))) == code
    assert faults(proof, letters, Phases(OPENED[[1, 2, 0]])) == code
    assert faults(replace(proof, starts=(proof.starts + 1) % 3), letters, phases) == code
    assert faults(proof, letters) == ["the tree of the proof has the wrong sizes"]
    beyond = replace(proof, starts=proof.starts + 1)
    assert faults(beyond, letters, phases) == ["a word of the proof begins at a phase that there is not"]
    # a potential belongs to its phase
    moved = replace(proof, potential=proof.potential[[1, 2, 0]])
    assert checked_bound(moved, letters, root @ root.T) < checked_bound(proof, letters, root @ root.T)


def test_rules_of_a_cycle_hold_within_windows() -> None:
    letters, opened, never = random_plant(8, 2, 2), np.array([[1, 1], [1, 1], [1, 0]], dtype=bool), 1 << 30
    scaled, _ = in_units(letters)

    def keeps(word) -> bool:
        """At most three uses of the first, and the second stays on for two steps at least."""
        p = len(word)
        alone = [k for k in range(p) if word[k] == 1 and word[k - 1] == 0 and word[(k + 1) % p] == 0]
        return word.count(0) <= 3 and not alone

    rules = CycleRules(np.eye(2), np.array([1, 2]), np.array([3, never]))
    best, _ = counted(letters, opened, 6, keeps)
    found = search(scaled, 6, rules, Monitor(), phases=Phases(opened)).best
    assert found is not None and found.cost == pytest.approx(best, rel=1e-9)
    assert best > counted(letters, opened, 6)[0] * (1 + 1e-6)


def test_long_rounds_are_searched_near_the_best(monkeypatch) -> None:
    letters, opened = random_plant(3, 2, 2), np.tile(np.array([[1, 1], [1, 1], [1, 0]], dtype=bool), (2, 1))
    opened[1, 0] = False
    scaled, _ = in_units(letters)
    best, _ = counted(letters, opened, 6)
    monkeypatch.setattr(cycles, "ALL", 1)
    monkeypatch.setattr(cycles, "PHASED_TRIES", 300)
    found = search(scaled, 6, free(np.eye(2)), Monitor(), phases=Phases(opened))
    assert found.complete_to == 0 and found.best is not None
    assert found.best.cost == pytest.approx(best, rel=1e-9)


def test_a_phase_without_a_letter_is_refused() -> None:
    with pytest.raises(ValueError, match="every phase has a letter"):
        Phases(np.array([[1, 0], [0, 0]]))

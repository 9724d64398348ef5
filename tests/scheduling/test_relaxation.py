"""Pairs of curvature that one relaxed problem hands to the next, which differs by prices."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from occontrol.core.solution import Status
from occontrol.families.athans.discretise import discretise, feasible_set
from occontrol.scheduling.relaxation import RelaxedOptions, RelaxedOutcome, memory_for, minimise_relaxed
from occontrol.scheduling.sweep import Sweep
from tests.families.athans.random_problems import random_problem

ROUNDING = 1e-9


def solved(seed: int, handed: bool) -> tuple[list[RelaxedOutcome], int]:
    """Six problems whose prices move a little, one after the other, and all their sweeps."""
    problem = random_problem(seed, states=4, sensors=4, intervals=60, running=True)
    recursion, allowed = discretise(problem), feasible_set(problem)
    rng, start, found = np.random.default_rng(seed), None, []
    memory = memory_for(Sweep(recursion), recursion.cost.size)
    for _ in range(6):
        prices = recursion.cost * rng.uniform(0.9, 1.1, recursion.cost.shape)
        sweep = Sweep(replace(recursion, cost=prices))
        options = RelaxedOptions(relative_gap=1e-6)
        found.append(minimise_relaxed(sweep, allowed, start, options, curvature=memory if handed else None))
        start = found[-1].weights
    return found, sum(each.sweeps["gradients"] for each in found)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_pairs_of_another_price_save_sweeps_and_change_no_bound(seed: int) -> None:
    (fresh, alone), (warm, together) = solved(seed, False), solved(seed, True)
    for a, b in zip(fresh, warm, strict=True):
        assert a.status is Status.CERTIFIED and b.status is Status.CERTIFIED
        room = ROUNDING * abs(a.cost)
        assert a.lower_bound <= b.cost + room and b.lower_bound <= a.cost + room
        assert abs(a.cost - b.cost) <= 2e-6 * abs(a.cost)
    assert together < 0.85 * alone


def test_a_bound_does_not_depend_on_the_pairs() -> None:
    """Pairs of quite another problem may cost steps, never the bound's truth."""
    problem, other = (random_problem(seed, states=3, sensors=3, intervals=20) for seed in (4, 5))
    memory = memory_for(Sweep(discretise(other)), discretise(other).cost.size)
    minimise_relaxed(Sweep(discretise(other)), feasible_set(other), curvature=memory)
    plain, misled = (
        minimise_relaxed(Sweep(discretise(problem)), feasible_set(problem), curvature=pairs) for pairs in (None, memory)
    )
    room = ROUNDING * abs(plain.cost)
    assert misled.lower_bound <= plain.cost + room and plain.lower_bound <= misled.cost + room
    assert misled.status is Status.CERTIFIED

"""Pruning: prices of removals, stopping rules, refusals for detectability, and the exact search against brute force."""

from itertools import combinations

import numpy as np
import pytest

from occontrol.core.errors import ProblemError
from occontrol.core.solution import Status
from occontrol.families.precision.moments import Moments
from occontrol.families.precision.program import Program, solve_program
from occontrol.families.precision.pruning import Pruning, active, best_set, prune

RNG = np.random.default_rng(4)
ANOMALIES = RNG.standard_normal((3 + 8, 14))
ANOMALIES[:3] = 0.6 * ANOMALIES[:3] + 0.7 * ANOMALIES[3:6]
JOINT = ANOMALIES @ ANOMALIES.T
PROGRAM = Program(Moments(JOINT[:3, :3], JOINT[:3, 3:], JOINT[3:, 3:]), 0.65 * JOINT[:3, :3])
FIRST = solve_program(PROGRAM)
SINGLES = [np.array([i]) for i in range(8)]


def test_removals_are_priced_and_never_lower_the_objective():
    pruned = prune(PROGRAM, solve_program, FIRST, SINGLES, Pruning())
    costs = [FIRST.objective, *(r.objective for r in pruned.removals)]
    assert np.all(np.diff(costs) >= -1e-6 * FIRST.objective)
    prices = [r.price for r in pruned.removals]
    assert np.isclose(sum(prices), pruned.result.objective - FIRST.objective, rtol=1e-9, atol=1e-9)
    assert pruned.result.relative_margin >= -1e-8
    assert np.all(pruned.result.precisions[pruned.dropped] == 0)
    # one more is too many, or there is only one left
    left = active(PROGRAM, pruned.result.precisions)
    weakest = left[np.argmin((PROGRAM.prices * pruned.result.precisions)[left])]
    without = PROGRAM.without(np.append(pruned.dropped, weakest))
    assert len(left) == 1 or solve_program(without).status is Status.INFEASIBLE


def test_stops_at_a_stated_number_and_at_a_stated_rise():
    few = prune(PROGRAM, solve_program, FIRST, SINGLES, Pruning(sensors=4))
    assert len(active(PROGRAM, few.result.precisions)) <= 4
    cheap = prune(PROGRAM, solve_program, FIRST, SINGLES, Pruning(rise=1.01))
    assert cheap.result.objective <= 1.01 * FIRST.objective
    assert "rise above its limit" in cheap.reason


def test_several_at_once_end_where_single_steps_may_end():
    pruned = prune(PROGRAM, solve_program, FIRST, SINGLES, Pruning(together=3))
    assert pruned.result.precisions is not None and pruned.result.relative_margin >= -1e-8
    left = active(PROGRAM, pruned.result.precisions)
    weakest = left[np.argmin(pruned.result.precisions[left])]
    assert solve_program(PROGRAM.without(np.append(pruned.dropped, weakest))).status is Status.INFEASIBLE


def test_groups_leave_together():
    pairs = [np.array([0, 4]), np.array([1, 5]), np.array([2, 6]), np.array([3, 7])]
    pruned = prune(PROGRAM, solve_program, FIRST, pairs, Pruning(by="sensor", sensors=2))
    off = set(range(8)) - set(active(PROGRAM, pruned.result.precisions).tolist())
    assert all(off >= set(pairs[g].tolist()) for r in pruned.removals for g in r.groups)


def test_what_the_plant_needs_is_kept():
    asked = []

    def spared(left):
        asked.append(left)
        return 2 in left and 5 in left

    pruned = prune(PROGRAM, solve_program, FIRST, SINGLES, Pruning(), spared)
    assert {2, 5} & set(pruned.dropped.tolist()) == set() and asked
    assert set(pruned.refused) <= {2, 5}


@pytest.mark.parametrize("count", [3, 4, 5])
def test_exact_search_against_brute_force(count):
    best = np.inf
    for keep in combinations(range(8), count):
        found = solve_program(PROGRAM.without(np.setdiff1d(np.arange(8), keep)))
        best = min(best, found.objective if found.precisions is not None else np.inf)
    exact = best_set(PROGRAM, solve_program, SINGLES, count)
    if np.isinf(best):
        assert exact is None
        return
    assert exact.proven and abs(exact.result.objective - best) < 1e-6 * best
    greedy = prune(PROGRAM, solve_program, FIRST, SINGLES, Pruning(sensors=count))
    if len(active(PROGRAM, greedy.result.precisions)) <= count:
        assert exact.result.objective <= greedy.result.objective * (1 + 1e-6)


def test_smallest_possible_set():
    exact = best_set(PROGRAM, solve_program, SINGLES, None)
    count = len(active(PROGRAM, exact.result.precisions))
    assert count >= exact.result.feasibility.least_active
    assert count == 1 or best_set(PROGRAM, solve_program, SINGLES, count - 1) is None


@pytest.mark.parametrize(
    ("options", "words"),
    [({"sensors": 0}, "at least 1"), ({"by": "group"}, "use | sensor"), ({"rise": 0.5}, "at least 1")],
)
def test_refusals(options, words):
    with pytest.raises(ProblemError, match=words.replace("|", r"\|")):
        Pruning(**options)

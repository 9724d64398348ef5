"""The bound on whole looks: below the enumerated optimum, near it, and wrong where it must be wrong."""

from __future__ import annotations

import dataclasses
import pickle
from pathlib import Path

import numpy as np
import pytest

from occontrol.core.monitor import Monitor
from occontrol.families.athans.targets.fill import fill
from occontrol.families.athans.targets.whole import whole_looks
from occontrol.scheduling.blocks.relaxation import relax
from occontrol.scheduling.whole.bound import SPACING, Effort, WholeLooks, relaxed_prices
from occontrol.scheduling.whole.certificate import Chunk, answer, combined, real_cost, visit_counts
from occontrol.scheduling.whole.forgetful import cost_of, plan
from occontrol.scheduling.whole.prefixes import beginnings
from occontrol.scheduling.whole.tables import tables
from occontrol.scheduling.whole.tree import search
from tests.plain_looks import optimum, small
from tests.target_problems import read, tracking

EXACT = 400_000
ROUNDING = 1e-9


def asked(document: dict, folder: Path, exact: int = 0):
    """The problem filled, its sweep, its relaxation, and its targets ready to be asked."""
    problem = read(document, folder)
    filled = fill(problem, document["horizon"]["substeps"])
    sweep = filled.sweep()
    relaxed = relax(sweep, filled.allowed, 1e-4, 2000, Monitor())
    return filled, sweep, relaxed, whole_looks(filled, sweep, relaxed.weights, Effort(40, 1e-3, exact))


@pytest.mark.parametrize("seed", [2, 5, 12, 17, 21, 35, 37, 41, 53, 56])
def test_the_bounds_lie_below_the_enumerated_optimum_and_the_tree_meets_it(seed: int, tmp_path: Path) -> None:
    document = small(seed)
    best = optimum(document)
    filled, sweep, relaxed, rough = asked(document, tmp_path)
    start = relaxed_prices(relaxed.gradient, filled.allowed)
    assert relaxed.lower_bound <= best * (1 + ROUNDING)
    bound = rough.bound(start).bound
    assert bound <= best * (1 + ROUNDING)
    assert bound >= relaxed.lower_bound * (1 - 1e-3)
    exact = WholeLooks(rough.chunk.courses, filled.allowed, rough.chunk.tangents, Effort(40, 1e-3, EXACT))
    found = exact.bound(start)
    assert exact.chunk.exactly and bound * (1 - 2e-3) <= found.bound <= best * (1 + ROUNDING)
    known = sweep.cost(filled.allowed.round(relaxed.weights))
    done = search(exact.chunk.known, exact.stretch, exact.capacity, found.prices, known, 1e-9, 1_000_000)
    assert done.finished and done.bound <= best * (1 + ROUNDING)
    assert min(done.cost, known) == pytest.approx(best, rel=1e-9)
    assert done.bound >= 0.98 * best
    if done.looks is not None:  # and its schedule is one
        v = np.zeros(filled.allowed.shape)
        v[done.looks] = 1.0
        v[filled.allowed.rest, 0] = filled.allowed.capacity - np.add.reduceat(v[:, 0], filled.allowed.starts[:-1])
        assert not filled.allowed.check(v) and sweep.cost(v) == pytest.approx(done.cost, rel=1e-9)


def test_a_tree_that_is_cut_short_still_proves_a_bound(tmp_path: Path) -> None:
    document = small(41)
    best = optimum(document)
    filled, sweep, relaxed, exact = asked(document, tmp_path, EXACT)
    prices = 0.5 * relaxed_prices(relaxed.gradient, filled.allowed)  # poor ones, so that there is much to try
    known = sweep.cost(filled.allowed.round(relaxed.weights))
    bounds = []
    for most in (0, 10, 100, 1_000_000):
        done = search(exact.chunk.known, exact.stretch, exact.capacity, prices, known, 1e-9, most)
        assert done.nodes <= most and done.bound <= best * (1 + ROUNDING)
        bounds.append(done.bound)
    assert bounds[0] < best * (1 - 1e-3) and bounds[-1] == pytest.approx(best, rel=1e-8)


def scalar(start: float, tmp_path: Path):
    """A target that is known well at first and drifts away, and one that asks for the other looks."""
    document = small(0)
    model = {
        "A": [[0.0]], "noise": [[1.0]], "running": [[1.0]], "output": [[0.0]], "initial": {"covariance": [[start]]}
    }  # fmt: skip
    document["resources"] = [{"name": "east", "capacity": 1, "windows": [[0, 6]]}]
    document["looks"] = [{"resource": "east", "C": [[1.0]], "cost": 0.0}]
    document["horizon"] = {"start": 0, "end": 6, "intervals": 12, "substeps": 1}
    document["target_models"] = {"m0": model, "m1": model}
    document["targets"] = [{"name": f"t{i}", "model": f"m{i}", "noise": {"east": [[20.0]]}} for i in range(2)]
    document["objective"]["cost_weight"] = 0.0
    return document


def test_a_floor_that_forgets_the_start_is_no_bound(tmp_path: Path) -> None:
    """Covariances after a visit lie above those of visits all the time from the same start.

    Above the steady ones of visits all the time they lie only after a transient: where the start is small in some
    direction, floors from the steady state are too high, and the bound from them lies above the optimum.
    """
    document = scalar(1e-3, tmp_path)
    best = optimum(document)
    _, _, relaxed, ready = asked(document, tmp_path)
    from_steady = scalar(4.47, tmp_path)  # sqrt(20): the steady covariance with looks all the time
    _, _, _, other = asked(from_steady, tmp_path)
    prices = relaxed_prices(relaxed.gradient, ready.allowed)
    assert ready.bound(prices).bound <= best * (1 + ROUNDING)
    totals = []
    for shift in (False, True):
        total = -prices @ ready.capacity
        for course, known, steady in zip(ready.chunk.courses, ready.chunk.known, other.chunk.known, strict=True):
            T, visit = known.T.copy(), known.visit.copy()
            if shift:
                T[:, :-1], visit[:, :-1] = steady.T[:, :-1], steady.visit[:, :-1]
            table = dataclasses.replace(known, T=T, visit=visit)
            total += plan(course, table, course.dues(prices[ready.stretch])).bound
        totals.append(total)
    assert totals[0] <= best * (1 + ROUNDING)
    assert totals[1] > best * (1 + 1e-3)


@pytest.mark.parametrize("seed", [3, 21, 24, 56])
def test_what_forgets_lies_below_the_exact_minimum(seed: int, tmp_path: Path) -> None:
    """One target: the floor, levels, and all beginnings, at prices of every size; and the line of the mixture."""
    _, _, _, ready = asked(small(seed), tmp_path)
    rng = np.random.default_rng(seed)
    near = []
    for course in ready.chunk.courses:
        tree, known = beginnings(course), [tables(course), tables(course, (1, 2, 4)), tables(course, (1, 2, 3, 4, 6))]
        assert tree is not None
        others = [course.dues(0.3 * rng.uniform(0, 1, len(ready.stretch))) for _ in range(4)]
        for scale in (0.0, 0.03, 0.3, 3.0):
            due = course.dues(scale * rng.uniform(0, 1, len(ready.stretch)))
            exact, visits = tree.best(due)
            assert cost_of(course, visits) + np.sum(due[visits]) == pytest.approx(exact, rel=1e-10)
            found = [plan(course, table, due) for table in known]
            for one, table in zip(found, known, strict=True):
                assert one.bound <= exact * (1 + ROUNDING)
                assert cost_of(course, one.visits) + float(np.sum(due[one.visits])) >= exact * (1 - ROUNDING)
                for other in others:  # concave in prices, and the mixture of plans says how it grows
                    line = one.bound + (other - due) @ one.often
                    assert plan(course, table, other).bound <= line + ROUNDING * abs(exact)
            assert found[0].bound <= min(found[1].bound, found[2].bound) * (1 + ROUNDING)
            near.append([(exact - one.bound) / exact for one in found])
    assert np.max(near) < 0.1


def test_levels_bring_what_the_floor_forgets(tmp_path: Path) -> None:
    """Targets looked at again and again: how far the bounds lie below the cost of a plan that is there."""
    _, _, _, ready = asked(tracking(2, 60, 1, 20.0, 0.05), tmp_path)
    far = []
    for course in ready.chunk.courses:
        for price in (0.1, 0.3):
            due = course.dues(np.full(len(ready.stretch), price))
            found = plan(course, tables(course), due)
            every = {1, *(max(1, round(x * 60 / (len(found.visits) + 1))) for x in SPACING)}
            levels = plan(course, tables(course, tuple(sorted(every))), due)
            cost = min(cost_of(course, x.visits) + float(np.sum(due[x.visits])) for x in (found, levels))
            far.append([(cost - x.bound) / cost for x in (found, levels)])
    assert np.min(far) > -ROUNDING
    floor, levels = np.mean(far, axis=0)
    assert levels < 0.6 * floor


def test_chunks_of_targets_answer_anywhere(tmp_path: Path) -> None:
    """Two chunks through pickle prove what all targets together prove, and count the same looks."""
    _, _, relaxed, ready = asked(small(8), tmp_path)
    prices = 1.5 * relaxed_prices(relaxed.gradient, ready.allowed)
    whole = ready.chunk
    parts = [Chunk(whole.courses[a:z], whole.numbers[a:z], whole.stretch, whole.tangents) for a, z in ((0, 1), (1, 3))]
    answers = [answer(pickle.loads(pickle.dumps(part)), prices) for part in parts]
    together = answer(whole, prices)
    assert combined(answers, prices, ready.capacity) == combined([together], prices, ready.capacity)
    counts = visit_counts(answers, len(prices))
    assert np.array_equal(counts, visit_counts([together], len(prices)))
    assert np.sum(counts) == sum(len(plan.at) for plan in together.plans) > 0


def test_costs_of_targets_add_up_to_what_the_blocks_cost(tmp_path: Path) -> None:
    """Random schedules, with substeps, two sites and costs of looks, by the loops over one target and by the lanes."""
    for seed in (1, 6, 31):
        filled, sweep, _, ready = asked(small(seed), tmp_path)
        rng = np.random.default_rng(seed)
        for _ in range(3):
            v = filled.allowed.vertex(rng.standard_normal(filled.allowed.shape))
            total = 0.0
            for course in ready.chunk.courses:
                taken, visits = set(np.flatnonzero(v[course.entry, 0] > 0.5).tolist()), []
                for p in range(len(course.interval)):
                    here = range(course.visit[p], course.visit[p + 1])
                    sets = [set(course.look[course.member[w] : course.member[w + 1]].tolist()) for w in here]
                    best = max((len(x & taken), -len(x - taken), w) for x, w in zip(sets, here, strict=True))
                    if best[0] and not best[1]:
                        visits.append(best[2])
                total += real_cost(course, np.array(visits, dtype=np.int64))
            assert total == pytest.approx(sweep.cost(v), rel=1e-11)

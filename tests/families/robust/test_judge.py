"""The independent integration of the robust family must be able to say no to the span elements."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from occontrol.core.claims import Claims
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Status
from occontrol.families.robust import bound, certify, check, search
from occontrol.families.robust.certify import claims_of
from occontrol.families.robust.family import FAMILY
from occontrol.families.robust.slots import Slots, table_of
from tests.families.robust.test_certify import oscillator

GIVEN = Schedule(np.arange(5.0), np.eye(2)[[0, 1, 1, 0]], ("one", "two"))


def noisier(table: Slots) -> tuple:
    F, Q, R = table.element
    return F, 1.05 * Q, R


def transposed(table: Slots) -> tuple:
    F, Q, R = table.element
    return np.ascontiguousarray(np.swapaxes(F, -1, -2)), Q, R


def stepless(table: Slots) -> tuple:
    element = tuple(part.copy() for part in table.element)
    for part, empty in zip(element, (np.eye(2), 0.0, 0.0), strict=True):
        part[2] = empty
    return element


def blind(table: Slots) -> tuple:
    F, Q, R = table.element
    return F, Q, 0.95 * R


@pytest.mark.parametrize("spoil", [noisier, transposed, stepless, blind])
def test_a_recursion_spoilt_on_purpose_disagrees(spoil, monkeypatch):
    assert FAMILY.certify(oscillator(), GIVEN).status is Status.FEASIBLE

    def spoilt(problem):
        table = table_of(problem)
        return dataclasses.replace(table, element=spoil(table))

    monkeypatch.setattr(certify, "table_of", spoilt)
    found = FAMILY.certify(oscillator(), GIVEN)
    assert found.status is Status.DISAGREES and found.message.startswith("direct integration gives ")


@pytest.mark.parametrize("rate", ["shape_rate", "center_weight_rate"])
def test_a_judge_that_integrates_something_else_disagrees(rate, monkeypatch):
    """Both equations count: the shape's, and the center's that sets the level."""
    honest = getattr(check, rate)
    monkeypatch.setattr(check, rate, lambda *given: 1.1 * honest(*given))
    assert FAMILY.certify(oscillator(), GIVEN).status is Status.DISAGREES


def test_the_two_numbers_agree_far_better_than_is_asked_for():
    numbers = FAMILY.certify(oscillator(), GIVEN).numbers
    assert numbers.independent.cost == pytest.approx(numbers.cost, rel=1e-9)
    assert numbers.independent.level == pytest.approx(numbers.level, rel=1e-9)


def test_a_bound_above_the_best_sequence_is_refuted_though_the_schedule_costs_more():
    mine = FAMILY.certify(oscillator(), GIVEN)
    best = FAMILY.solve(oscillator()).cost
    assert mine.cost > 1.001 * best
    claims = dataclasses.replace(claims_of(mine), lower_bound=(mine.cost + best) / 2, relative_gap=None)
    found = FAMILY.certify(oscillator(), GIVEN, claims)
    assert found.status is Status.DISAGREES
    assert f"is not one: a known policy costs {best:.10g}" in found.message
    assert FAMILY.certify(oscillator(), GIVEN, claims_of(mine)).status is Status.FEASIBLE
    false = FAMILY.certify(oscillator(), GIVEN, Claims(parts={"level": 1.001 * mine.numbers.level}))
    assert false.status is Status.DISAGREES and false.message.startswith("the stated level is ")


@pytest.mark.parametrize("method", ["optimal", "one-step", "relaxed"])
def test_a_bound_above_the_cost_is_shown_and_not_cut_to_the_cost(method, monkeypatch):
    honest = bound.relaxed_policy
    size = FAMILY.solve(oscillator(), "optimal").cost

    def spoilt(*words, **more):
        weights, plane, _ = honest(*words, **more)
        return weights, plane, 10 * size

    for place in (bound, search):
        monkeypatch.setattr(place, "relaxed_policy", spoilt)
    found = FAMILY.solve(oscillator(), method)
    assert found.status is Status.DISAGREES and found.status.exit_code == 7
    assert f"the lower bound {10 * size:.10g} lies above the cost {found.cost:.10g}" in found.message
    assert found.numbers.lower_bound == 10 * size and found.numbers.relative_gap < 0

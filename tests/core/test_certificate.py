"""A certificate forgives rounding and nothing else."""

import math

import pytest

from occontrol.core.solution import Certificate


@pytest.mark.parametrize("cost", [1.0, -1.0, 1e-12, 1e12])
def test_rounding_becomes_the_cost_and_more_is_a_contradiction(cost):
    assert Certificate(cost, cost + 0.5e-9 * abs(cost)).lower_bound == cost
    assert not Certificate(cost, cost + 0.5e-9 * abs(cost)).contradicts
    wrong = Certificate(cost, cost + 2e-9 * abs(cost))
    assert wrong.contradicts and wrong.lower_bound > cost and wrong.gap < 0 and wrong.relative_gap < 0
    assert wrong.text.startswith("the lower bound ") and "lies above the cost" in wrong.text


def test_the_allowance_is_stated_by_whoever_knows_the_numbers():
    assert not Certificate(1.0, 1.005, allowance=1e-2).contradicts
    assert Certificate(1.0, 1.005, allowance=1e-2).lower_bound == 1.0
    assert Certificate(1.0, 1.0 + 1e-15, allowance=0.0).contradicts


def test_an_honest_certificate_is_left_alone():
    honest = Certificate(2.0, 1.5)
    assert (honest.lower_bound, honest.gap, honest.relative_gap) == (1.5, 0.5, 0.25)
    assert not honest.contradicts and honest.text == ""
    assert honest.as_dict() == {"cost": 2.0, "lower_bound": 1.5, "relative_gap": 0.25}
    assert Certificate(0.0, 0.0).relative_gap == 0.0
    assert Certificate(0.0, -1.0).relative_gap == math.inf
    assert Certificate(0.0, 1e-300).contradicts

"""What is said about stated numbers when they are computed again."""

from __future__ import annotations

import math

import pytest

from occontrol.core.claims import Claims, false_claims

PARTS = {"prediction_error": 0.5}


@pytest.mark.parametrize(
    ("claims", "words"),
    [
        (Claims(cost=1 + 2e-8), "the stated cost is 1.00000002, the schedule costs 1"),
        (Claims(cost=1 - 2e-8), "the stated cost is 0.99999998, the schedule costs 1"),
        (Claims(cost=math.nan), "the stated cost is nan, the schedule costs 1"),
        (Claims(lower_bound=0.9 + 2e-8), "the stated lower bound 0.90000002 is not one: a known policy costs 0.9"),
        (Claims(lower_bound=math.nan), "the stated lower bound nan is not one: a known policy costs 0.9"),
        (Claims(continuous_bound=1.1 + 2e-6), "lower bound 1.100002 is not one: this policy costs 1.1"),
        (Claims(continuous_bound=math.nan), "the stated continuous lower bound nan is not one"),
        (Claims(1.0, 0.9, relative_gap=0.1 - 2e-6), "the stated relative gap is 0.099998, its cost and bound give 0.1"),
        (Claims(1.0, 0.9, relative_gap=math.nan), "the stated relative gap is nan"),
        (Claims(parts={"prediction_error": 0.5 + 2e-6}), "the stated prediction error is 0.500002, recomputed 0.5"),
        (Claims(parts={"prediction_error": math.nan}), "the stated prediction error is nan, recomputed 0.5"),
    ],
)
def test_one_false_number_is_one_sentence(claims: Claims, words: str) -> None:
    (sentence,) = false_claims(claims, 1.0, 0.9, 1.1, PARTS)
    assert words in sentence


@pytest.mark.parametrize(
    "claims",
    [
        Claims(),
        Claims(cost=1 + 5e-9),
        Claims(lower_bound=0.9 + 5e-9),
        Claims(lower_bound=-math.inf),
        Claims(continuous_bound=1.1 + 5e-7),
        Claims(1.0, 0.9, relative_gap=0.1 + 5e-7),
        Claims(parts={"prediction_error": 0.5 + 5e-7, "what nobody computed": 7.0}),
    ],
)
def test_true_numbers_and_their_rounding_are_left_alone(claims: Claims) -> None:
    assert false_claims(claims, 1.0, 0.9, 1.1, PARTS) == []

"""A printed bound is the largest number of so many digits that is not above the bound."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest

from occontrol.core.printed import rounded_down


@pytest.mark.parametrize(
    ("bound", "digits", "text"),
    [
        (1.23456789, 6, "1.23456"),
        (-1.23456789, 6, "-1.23457"),
        (0.1, 6, "0.1"),
        (403.772169999, 8, "403.77216"),
        (1e-300, 3, "1e-300"),
        (9.9999999e22, 4, "9.999e+22"),
        (0.0, 5, "0"),
        (None, 5, "-"),
        (-math.inf, 5, "-inf"),
    ],
)
def test_texts(bound, digits, text):
    assert rounded_down(bound, digits) == text


def test_never_above_and_nearest_from_below():
    random = np.random.default_rng(7)
    for _ in range(2000):
        bound = float(random.normal() * 10.0 ** random.integers(-20, 20))
        digits = int(random.integers(1, 11))
        printed = Fraction(rounded_down(bound, digits))
        assert printed <= Fraction(repr(bound))
        unit = Fraction(10) ** (math.floor(math.log10(abs(bound))) - digits + 1)
        assert Fraction(repr(bound)) - printed < unit * Fraction(10001, 10000) * (10 if bound < 0 else 1)

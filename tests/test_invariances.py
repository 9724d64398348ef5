"""Clocks, units, costs, order: what must not change a whole solve, on a few random problems.

scripts/campaign_invariances.py does the same on hundreds.
"""

from __future__ import annotations

import numpy as np
import pytest

from scripts.campaign_invariances import of_athans
from tests.invariances_others import OTHERS

PLAIN, SCALES, SHORT, LONG, UNIX, GROWTH = 5, 13, 6, 16, 26, 477


def wrong(found: dict[str, str | None]) -> dict[str, str | None]:
    return {name: what for name, what in found.items() if what is not None}


@pytest.mark.slow
@pytest.mark.parametrize("seed", [PLAIN, SCALES, SHORT, LONG, UNIX, GROWTH])
def test_athans(seed: int) -> None:
    found = of_athans(seed)
    assert len(found) >= 7 and not wrong(found)


@pytest.mark.parametrize(("family", "seeds"), [("vlambda", 30), ("robust", 3), ("hybrid", 30), ("precision", 30)])
def test_other_families(family: str, seeds: int) -> None:
    for seed in range(seeds):
        found = OTHERS[family](np.random.default_rng(seed))
        assert found and not wrong(found), seed

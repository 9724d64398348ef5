"""Problems of readings against the enumeration of all their schedules by a textbook filter."""

import numpy as np
import pytest

from scripts.campaign_readings import judged
from tests.plain_readings import random_document

MOST = 800  # schedules of one problem


@pytest.mark.parametrize("seed", range(18))
def test_costs_and_bounds_agree_with_enumeration(seed):
    rng = np.random.default_rng(1000 + seed)
    while True:
        result = judged(random_document(rng, most_readings=5, budget=seed % 3 == 0), MOST)
        if result is not None:
            break
    if result["infeasible"]:
        assert result["right"]
        return
    assert result["status"] in {"certified", "feasible"}  # which one says only how far the relaxation came
    assert result["legal"]
    assert result["off"] <= 1e-12
    assert result["above"] <= 1e-9
    assert result["relaxed above"] <= 1e-9
    assert result["excess"] <= 1e-9

"""The short form of scripts/campaign_definiteness.py: no discrete filter loses the definiteness of its covariance."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from scripts import campaign_definiteness as campaign


@pytest.mark.parametrize("name", campaign.FILTERS)
@pytest.mark.parametrize("plant", campaign.PLANTS)
def test_covariances_stay_definite_and_symmetric_and_innovations_positive(name: str, plant: str) -> None:
    wrong, worst = campaign.count(name, plant, 240, seed=3)
    assert wrong == 0 and worst >= -campaign.PROMISE


def test_the_plain_form_fails_there() -> None:
    """The case is hard: a covariance from which a product is subtracted becomes indefinite."""
    P, F = campaign.PRIOR, expm(campaign.STEP * campaign.PLANTS["drifting"])
    worst = 0.0
    for k in range(60):
        C, R = map(np.array, campaign.SENSORS[("sum", "pair")[k % 2]])
        P = P - P @ C.T @ np.linalg.solve(C @ P @ C.T + R, C @ P)
        P = (P + P.T) / 2
        values = np.linalg.eigvalsh(P)
        worst = min(worst, values[0] / values[-1])
        P = F @ P @ F.T + campaign.STEP * campaign.NOISE
    assert worst < -1e6 * campaign.PROMISE
